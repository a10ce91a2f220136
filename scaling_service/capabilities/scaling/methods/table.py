"""The table of methods: each one a small frozen value; a new method is a new row."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Protocol

from scaling_service.capabilities.scaling.methods.fitting import Progress
from scaling_service.capabilities.scaling.methods.freedom import Freedom
from scaling_service.capabilities.scaling.methods.images import image_based
from scaling_service.capabilities.scaling.methods.linear import linear
from scaling_service.capabilities.scaling.methods.optimised import optimise
from scaling_service.capabilities.subject.settings import PAPER, CalibrationSettings
from scaling_service.core.errors import SubjectInvalid
from scaling_service.model.results import Calibration
from scaling_service.model.subject import Session


class Method(Protocol):
    """One way to scale a model."""

    @property
    def needs(self) -> str | None:
        """The method that gives the first guess, if any."""

    @property
    def needs_images(self) -> bool:
        """Whether it can only be done where bones were imaged."""

    @property
    def title(self) -> str:
        """What is fitted, in plain words."""

    def calibrate(
        self,
        session: Session,
        start: Calibration | None,
        settings: CalibrationSettings,
        progress: Progress | None,
    ) -> Calibration:
        """Scale the session's model."""


@dataclass(frozen=True, slots=True)
class MarkerBased:
    """Linear scaling from marker distances."""

    title: str = "segment sizes from marker distances"
    needs: str | None = None
    needs_images: bool = False

    def calibrate(
        self,
        session: Session,
        start: Calibration | None,  # noqa: ARG002 (the table's one signature; linear scaling needs no first guess)
        settings: CalibrationSettings,
        progress: Progress | None,  # noqa: ARG002 (one step: nothing to report)
    ) -> Calibration:
        """Scale the session's model from its standing trial."""
        return linear(session, settings)


@dataclass(frozen=True, slots=True)
class Optimised:
    """Optimisation from another method's model."""

    name: str
    title: str
    needs: str
    freedom: Freedom
    needs_images: bool = False

    def calibrate(
        self,
        session: Session,
        start: Calibration | None,
        settings: CalibrationSettings,
        progress: Progress | None,
    ) -> Calibration:
        """Fit the start's model to the calibration trials."""
        if start is None:
            raise ValueError(f"{self.name} starts from {self.needs}")
        return optimise(self.name, start, session.calibration, self.freedom, settings, progress)


@dataclass(frozen=True, slots=True)
class ImageBased:
    """Joint centres, knee axes and markers from images, the rest from markers."""

    title: str = "joint centres, knee axes and markers from images"
    needs: str | None = "MB"
    needs_images: bool = True

    def calibrate(
        self,
        session: Session,
        start: Calibration | None,
        settings: CalibrationSettings,  # noqa: ARG002 (the table's one signature; nothing is fitted)
        progress: Progress | None,  # noqa: ARG002 (one step: nothing to report)
    ) -> Calibration:
        """Replace what was imaged in the start's model."""
        if start is None:
            raise ValueError("EB starts from MB")
        if session.images is None:
            raise SubjectInvalid(
                "there are no bones to scale from",
                field="bones",
                remedy="Give `bones:` in the subject file, or choose a marker-based method",
            )
        return image_based(start, session.images, session.static)


METHODS: Mapping[str, Method] = MappingProxyType(
    {
        "MB": MarkerBased(),
        "MB_lam": Optimised(
            "MB_lam",
            "lengths, knee axes and selected marker coordinates fitted to movement",
            "MB",
            Freedom(lengths=True, all_markers=False),
        ),
        "MB_am": Optimised(
            "MB_am",
            "knee axes and all marker coordinates fitted to movement",
            "MB",
            Freedom(lengths=False, all_markers=True),
        ),
        "EB": ImageBased(),
        "EB_am": Optimised(
            "EB_am",
            "knee axes and all marker coordinates of the image-based model fitted to movement",
            "EB",
            Freedom(lengths=False, all_markers=True),
            needs_images=True,
        ),
    }
)


def calibrate(
    session: Session,
    method: str,
    settings: CalibrationSettings = PAPER,
    known: Mapping[str, Calibration] | None = None,
    progress: Progress | None = None,
) -> Calibration:
    """Scale a session's model by one method.

    Parameters
    ----------
    method : str
        A key of :data:`METHODS`.
    known : mapping, optional
        Calibrations done already; a method's first guess is taken from here where it is.
    progress : callable, optional
        Called with the step's number and the cumulative kinematic error (m2).

    Raises
    ------
    SubjectInvalid
        There is no such method.
    """
    if method not in METHODS:
        raise SubjectInvalid(
            f"there is no method '{method}'", field="method", remedy=f"Methods are {', '.join(METHODS)}"
        )
    done = known or {}
    if method in done:
        return done[method]
    row = METHODS[method]
    start = calibrate(session, row.needs, settings, done) if row.needs is not None else None
    return row.calibrate(session, start, settings, progress)
