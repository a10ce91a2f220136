"""Everything that can be chosen for one run."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from scaling_service.capabilities.subject.calibration_settings import CalibrationSettings
from scaling_service.recording.pipeline import ProcessingSettings


@dataclass(frozen=True, slots=True)
class Settings:
    """How recordings are processed and models fitted.

    Parameters
    ----------
    calibration : CalibrationSettings
    processing : ProcessingSettings
    up, forward : str, optional
        The laboratory's axes, such as ``"+z"`` and ``"-x"``; found from the markers unless given.
    seed : int
        Of everything random. Nothing in scaling itself is; virtual subjects are.
    """

    calibration: CalibrationSettings = field(default_factory=CalibrationSettings)
    processing: ProcessingSettings = field(default_factory=ProcessingSettings)
    up: str | None = None
    forward: str | None = None
    seed: int = 0

    def resolved(self) -> dict[str, Any]:
        """All settings with their defaults, as plain values for a document; the seed stands apart."""
        values = asdict(self)
        del values["seed"]
        return values
