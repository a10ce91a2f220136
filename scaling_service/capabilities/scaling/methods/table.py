"""The table of methods: each one a small frozen value in a file of its own; a new method is a new row.

Other distributions add methods by entry points of the group ``scaling_service.methods``: an entry's name is
the method's, and what it names is a :class:`.method.Method`.
"""

from __future__ import annotations

from collections import abc
from importlib.metadata import entry_points
from types import MappingProxyType

from scaling_service.capabilities.scaling.methods import optimised
from scaling_service.capabilities.scaling.methods.fitting import Progress
from scaling_service.capabilities.scaling.methods.image_based import ImageBased
from scaling_service.capabilities.scaling.methods.marker_based import MarkerBased
from scaling_service.capabilities.scaling.methods.method import Method
from scaling_service.capabilities.scaling.methods.posterior import JointPosterior
from scaling_service.capabilities.shared import settings as shared_settings
from scaling_service.core.errors import SubjectInvalid, TrialUnusable
from scaling_service.model.results import Calibration
from scaling_service.model.subject import Session

GROUP = "scaling_service.methods"
"""Of the entry points."""

_OURS: abc.Mapping[str, Method] = MappingProxyType(
    {
        "MB": MarkerBased(),
        "MB_lam": optimised.Optimised(
            name="MB_lam",
            title="lengths, knee axes and selected marker coordinates fitted to movement",
            needs="MB",
            freedom=optimised.Freedom(lengths=True, all_markers=False),
        ),
        "MB_am": optimised.Optimised(
            name="MB_am",
            title="knee axes and all marker coordinates fitted to movement",
            needs="MB",
            freedom=optimised.Freedom(lengths=False, all_markers=True),
        ),
        "EB": ImageBased(),
        "EB_am": optimised.Optimised(
            name="EB_am",
            title="knee axes and all marker coordinates of the image-based model fitted to movement",
            needs="EB",
            freedom=optimised.Freedom(lengths=False, all_markers=True),
            needs_images=True,
        ),
        "MAP": JointPosterior(),
    }
)
METHODS: abc.Mapping[str, Method] = MappingProxyType(
    {**_OURS} | {point.name: point.load() for point in entry_points(group=GROUP) if point.name not in _OURS}
)
"""Our methods, then those of other distributions; a name that is taken stays ours."""


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
    Raises SubjectInvalid: there is no such method. TrialUnusable: it is fitted to markers that there are not.
    """
    check_methods([method])
    # Others than ours say themselves what they need
    if method in _OURS and method != "MB" and session.unmarked:
        raise TrialUnusable(
            f"{method} is fitted to markers on skin, and the recordings hold none",
            field="method",
            remedy="Choose MB, which then sizes the model by sex, stature and joint centres that are told; "
            "or name a standing trial with markers under `trials:`",
        )
    done = {} if known is None else known
    if method not in done:
        row = METHODS[method]
        start = None if row.needs is None else calibrate(session, row.needs, settings, done)
        done[method] = row.calibrate(session, start, settings, progress)
    return done[method]
