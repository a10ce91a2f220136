"""The table of methods: each one a small frozen value in a file of its own; a new method is a new row.

Other distributions add methods by entry points of the group ``scaling_service.methods``: an entry's name is
the method's, and what it names is a :class:`Method`.
"""

from __future__ import annotations

from collections import abc
from importlib.metadata import entry_points
from types import MappingProxyType
from typing import Protocol

from scaling_service.capabilities.scaling.methods import optimised
from scaling_service.capabilities.scaling.methods.fitting import Progress
from scaling_service.capabilities.scaling.methods.image_based import EB
from scaling_service.capabilities.scaling.methods.marker_based import MB
from scaling_service.capabilities.scaling.methods.posterior import MAP
from scaling_service.capabilities.scaling.sizes import without_markers
from scaling_service.capabilities.shared import settings as shared_settings
from scaling_service.core.errors import SubjectInvalid
from scaling_service.model.results import Calibration
from scaling_service.model.subject import Session

GROUP = "scaling_service.methods"
"""Of the entry points."""


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


def _with_others(own: abc.Mapping[str, Method]) -> abc.Mapping[str, Method]:
    """Our methods, then those of other distributions; a name that is taken stays ours."""
    others = {point.name: point.load() for point in entry_points(group=GROUP) if point.name not in own}
    return MappingProxyType({**own, **others})


_OURS: abc.Mapping[str, Method] = MappingProxyType(
    {
        "MB": MB,
        "MB_lam": optimised.MB_LAM,
        "MB_am": optimised.MB_AM,
        "EB": EB,
        "EB_am": optimised.EB_AM,
        "MAP": MAP,
    }
)
METHODS: abc.Mapping[str, Method] = _with_others(_OURS)


def check_methods(methods: abc.Iterable[str]) -> None:
    """Refuse a method that there is not (SubjectInvalid)."""
    for method in methods:
        if method not in METHODS:
            raise SubjectInvalid(
                f"there is no method '{method}'", field="method", remedy=f"Methods are {', '.join(METHODS)}"
            )


def calibrate(
    session: Session,
    method: str,
    settings: shared_settings.CalibrationSettings = shared_settings.PAPER,
    known: dict[str, Calibration] | None = None,
    progress: Progress | None = None,
) -> Calibration:
    """Scale a session's model by one method.

    ``method``: a key of :data:`METHODS`.
    ``known``: calibrations done already; a method's first guess is taken from here, and what is done is
        added.
    ``progress``: called with the step's number and the cumulative kinematic error (m2).
    Raises SubjectInvalid: there is no such method.
    """
    check_methods([method])
    if method in _OURS and without_markers.has_no_markers(session):  # others say themselves what they need
        without_markers.refuse_without_markers(method)
    done = {} if known is None else known
    if method not in done:
        row = METHODS[method]
        start = None if row.needs is None else calibrate(session, row.needs, settings, done)
        done[method] = row.calibrate(session, start, settings, progress)
    return done[method]
