"""What a method of scaling is to the table, to the command line and to the service."""

from __future__ import annotations

from typing import Protocol

from scaling_service.capabilities.scaling.methods.fitting import Progress
from scaling_service.capabilities.shared import settings as shared_settings
from scaling_service.model.results import Calibration
from scaling_service.model.subject import Session


class Method(Protocol):
    """One way to scale a model."""

    @property
    def title(self) -> str:
        """What is fitted, in plain words."""

    @property
    def needs(self) -> str | None:
        """The method that gives the first guess, if any."""

    @property
    def needs_images(self) -> bool:
        """Whether it can only be done where bones were imaged; its lengths are then the image's."""

    @property
    def needs_movements(self) -> bool:
        """Whether it fits its model to calibration trials."""

    def calibrate(
        self,
        session: Session,
        start: Calibration | None,
        settings: shared_settings.CalibrationSettings,
        progress: Progress | None,
    ) -> Calibration:
        """Scale the session's model; ``start`` is the first guess where the method needs one."""
