"""What `ik` finds: motions with their uncertainty in memory, and ``ik.json``, which tells of them.

A service describes the document and computes nothing: what computes is imported by who is asked.
"""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import Field

from scaling_service.capabilities.motion.options import MotionOptions
from scaling_service.core.tables import MotionTable, ResultTable
from scaling_service.documents.base import Known, Part, Rounded
from scaling_service.documents.results import Provenance
from scaling_service.recording.settings import ProcessingSettings

if TYPE_CHECKING:
    from scaling_service.capabilities.motion.clinical_angles import ClinicalAngles
    from scaling_service.capabilities.motion.kinematic_error import KinematicError
    from scaling_service.capabilities.motion.uncertainty import CoordinateSd
    from scaling_service.capabilities.subject.preparing import Loaded
    from scaling_service.model.body import BodyModel
    from scaling_service.model.results import Motion


class KinematicErrorDocument(Part):
    """Distances between measured and model markers over one trial, mm; null where it has no marker."""

    mean: Known = Field(description="Over frames and markers.")
    rms: Known
    max: Known
    per_marker: dict[str, Rounded] = Field(description="Marker to mean distance.")


class CoordinateSummary(Part):
    """A coordinate over one trial, in its unit."""

    mean: Rounded
    mean_sd: Known = Field(
        description="Standard deviation of the mean, hardly less than a frame's: a misplaced marker is off "
        "in all. Null where the model's own deviations are not known."
    )
    range: Rounded = Field(description="The largest less the least value, what skin adds to it included.")


class TrackedTrialDocument(Part):
    """How a model follows one trial."""

    kinematic_error_mm: KinematicErrorDocument
    not_determined: list[str] = Field(
        description="Coordinates that the markers determine in no frame: they stand at their default."
    )
    frames_not_determined: dict[str, int] = Field(
        description="Further coordinates to the number of frames that do not determine them: NaN there."
    )
    frames_at_range_end: dict[str, int] = Field(
        description="Coordinates to the number of frames in which they stand at the end of the model's "
        "range. It decides there, so their standard deviation is NaN."
    )
    marker_noise_mm: dict[str, Rounded] = Field(
        description="Standard deviation of one coordinate of each marker about the model, from this trial's "
        "residuals; the standard deviations of the coordinates come from it and from the motion of skin."
    )
    rotation_error_deg: dict[str, Rounded] = Field(
        default={},
        description="Measured rotation to the RMS angle between it and the model's, mounting included.",
    )
    frames: int
    summary: dict[str, CoordinateSummary] = Field(
        default={}, description="Of coordinates that are determined in any frame; locked ones apart."
    )


class MotionDocument(Provenance):
    """``ik.json``."""

    subject: str = Field(default="", description="Empty where recordings were given without a subject.")
    model: str = Field(description="The model used: a built-in name or a file.")
    locked: list[str] = Field(description="Coordinates that the model locks; their standard deviation is 0.")
    units: dict[str, Literal["deg", "m"]] = Field(
        default={}, description="Coordinate to the unit of its column in `_ik.mot` and `_ik_sd.mot`."
    )
    ranges: dict[str, tuple[float, float]] = Field(
        default={}, description="Coordinates that the model keeps within a range to its ends, in their unit."
    )
    axes: str = Field(description="Which laboratory axes were taken for up and forward.")
    trials: dict[str, TrackedTrialDocument]
    warnings: list[str]
    files: list[str] = Field(description="What was written beside this document.")
    wall_s: float


@dataclass(frozen=True, slots=True, eq=False)
class TrackedTrial:
    """One trial as a model tracks it."""

    motion: Motion
    uncertainty: CoordinateSd
    error: KinematicError
    angles: ClinicalAngles | None = None  # conventional ones with their standard deviations, if asked for


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Tracked:
    """How a model tracks recordings, trial by trial, and where both came from.

    Attributes
    ----------
    loaded : Loaded
        The model and the recordings, and how their labels and axes were understood.
    trials : mapping of str to TrackedTrial
        By the recording's name: motion (rad, m), standard deviations (rad, m) and kinematic error (m).
    options : MotionOptions
        What was chosen.
    wall_s : float
        Wall time, s.

    Examples
    --------
    >>> import scaling_service as ss
    >>> tracked = ss.ik("compared/MB/model.json", ["lab/gait_1.trc"])
    >>> isinstance(tracked, ss.Tracked)
    True
    >>> knee = tracked.coordinates("gait_1").to_frame()["knee_angle_r_deg"]
    >>> round(float(knee.max() - knee.min()), -1)  # degrees
    50.0
    """

    loaded: Loaded
    trials: abc.Mapping[str, TrackedTrial]
    options: MotionOptions = field(default_factory=MotionOptions)
    wall_s: float = 0.0

    def coordinates(self, trial: str) -> MotionTable:
        """Coordinates of a trial over time with their standard deviations, degrees and m.

        What markers do not show is NaN, its deviation infinite.

        Raises KeyError: no recording is called so.
        """
        from scaling_service.capabilities.motion.tables import tabulate_coordinates

        tracked = self.trials[trial]
        return tabulate_coordinates(
            trial, tracked.motion, self.loaded.session.model, tracked.uncertainty.sd, system="markers"
        )

    @property
    def errors(self) -> ResultTable:
        """Kinematic error of every trial, mm."""
        rows = tuple(
            (name, *(1e3 * value for value in (t.error.mean, t.error.rms, t.error.max)))
            for name, t in self.trials.items()
        )
        return ResultTable("Kinematic error", ("trial", "mean_mm", "rms_mm", "max_mm"), rows)

    @property
    def tables(self) -> dict[str, ResultTable]:
        """The errors, and the coordinates of every trial by its name."""
        return {"errors": self.errors, **{f"motion_{name}": self.coordinates(name) for name in self.trials}}

    def make_document(self, files: abc.Sequence[str] = ()) -> MotionDocument:
        """``ik.json``, errors in mm. ``files``: what is written beside it."""
        from scaling_service.capabilities.motion.stops import describe_stops
        from scaling_service.capabilities.subject.provenance import record_provenance
        from scaling_service.model.compile import list_kept_ranges

        loaded, session, options = self.loaded, self.loaded.session, self.options
        processing = ProcessingSettings.smoothed(options.smooth_hz).resolved()
        settings = options.resolved() | {"processing": processing}
        return MotionDocument(
            **record_provenance(loaded, session.evaluation, settings),
            model=Path(session.subject.model).name,
            axes=loaded.axes,
            units={c.name: "deg" if c.kind == "rotation" else "m" for c in session.model.coordinates},
            ranges=list_kept_ranges(session.model),
            locked=[c.name for c in session.model.coordinates if c.locked],
            trials={name: make_trial_document(trial, session.model) for name, trial in self.trials.items()},
            warnings=[
                *session.warnings,
                *describe_stops(session.model, {n: t.motion for n, t in self.trials.items()}),
            ],
            files=list(files),
            wall_s=round(self.wall_s, 3),
        )

    def __repr__(self) -> str:
        return f"Tracked by model '{self.loaded.session.model.name}'\n{self.errors!r}"

    def _repr_html_(self) -> str:
        return self.errors._repr_html_()


def make_trial_document(tracked: TrackedTrial, model: BodyModel) -> TrackedTrialDocument:
    """One trial's part of ``ik.json``."""
    from scaling_service.capabilities.motion.unshown import list_unshown_names

    motion, spread = tracked.motion, tracked.uncertainty
    unshown = list_unshown_names(motion, model)
    error, summary = tracked.error, dict[str, CoordinateSummary]()
    kinds = {c.name: c.kind for c in model.coordinates if not c.locked}
    for k, name in enumerate(motion.coordinates):
        known = motion.q[:, k][np.isfinite(motion.q[:, k])]
        if name not in kinds or name not in motion.estimated or not len(known):
            continue
        unit = 180.0 / np.pi if kinds[name] == "rotation" else 1.0
        summary[name] = CoordinateSummary(
            mean=unit * known.mean(),
            mean_sd=None if spread.mean is None else unit * spread.mean[k],
            range=unit * np.ptp(known),
        )
    return TrackedTrialDocument(
        kinematic_error_mm=KinematicErrorDocument(
            mean=1e3 * error.mean,
            rms=1e3 * error.rms,
            max=1e3 * error.max,
            per_marker={name: 1e3 * value for name, value in error.per_marker.items()},
        ),
        not_determined=[name for name in motion.coordinates if name in unshown],
        frames_not_determined=_count_undetermined(
            motion.coordinates, np.isnan(motion.q).sum(axis=0).tolist()
        ),
        frames_at_range_end=_count_undetermined(motion.coordinates, spread.at_range_end.sum(axis=0).tolist()),
        marker_noise_mm={
            name: 1e3 * sd
            for name, sd in zip(motion.markers, spread.noise.tolist(), strict=True)
            if np.isfinite(sd)
        },
        rotation_error_deg={
            label: np.degrees(np.sqrt(np.nanmean(np.square(angles))))
            for label, angles in motion.turns.items()
            if np.isfinite(angles).any()
        },
        frames=len(motion.times),
        summary=summary,
    )


def _count_undetermined(names: abc.Sequence[str], counts: abc.Sequence[int]) -> dict[str, int]:
    return {name: count for name, count in zip(names, counts, strict=True) if count}
