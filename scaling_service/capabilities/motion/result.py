"""What `ik` finds: motions with their uncertainty in memory."""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from scaling_service.capabilities.motion import clinical_angles, stops, unshown
from scaling_service.capabilities.motion import kinematic_error as kinematic_errors
from scaling_service.capabilities.motion import uncertainty as uncertainties
from scaling_service.capabilities.motion.document import (
    CoordinateSummary,
    KinematicErrorDocument,
    MotionDocument,
    TrackedTrialDocument,
)
from scaling_service.capabilities.motion.options import MotionOptions
from scaling_service.capabilities.motion.tables import tabulate_coordinates
from scaling_service.capabilities.subject.preparing import Loaded
from scaling_service.capabilities.subject.provenance import record_provenance
from scaling_service.core.tables import MotionTable, ResultTable
from scaling_service.model import body
from scaling_service.model import compile as compiling
from scaling_service.model.results import Motion
from scaling_service.recording.settings import ProcessingSettings


@dataclass(frozen=True, slots=True, eq=False)
class TrackedTrial:
    """One trial as a model tracks it."""

    motion: Motion
    uncertainty: uncertainties.CoordinateSd
    error: kinematic_errors.KinematicError
    angles: clinical_angles.ClinicalAngles | None = (
        None  # conventional ones with their standard deviations, if asked for
    )


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
        loaded, session, options = self.loaded, self.loaded.session, self.options
        processing = ProcessingSettings.smoothed(options.smooth_hz).resolved()
        settings = options.resolved() | {"processing": processing}
        return MotionDocument(
            **record_provenance(loaded, session.evaluation, settings),
            model=Path(session.subject.model).name,
            axes=loaded.axes,
            units={c.name: "deg" if c.kind == "rotation" else "m" for c in session.model.coordinates},
            ranges=compiling.list_kept_ranges(session.model),
            locked=[c.name for c in session.model.coordinates if c.locked],
            trials={name: make_trial_document(trial, session.model) for name, trial in self.trials.items()},
            warnings=[
                *session.warnings,
                *stops.describe_stops(session.model, {n: t.motion for n, t in self.trials.items()}),
            ],
            files=list(files),
            wall_s=round(self.wall_s, 3),
        )

    def __repr__(self) -> str:
        return f"Tracked by model '{self.loaded.session.model.name}'\n{self.errors!r}"

    def _repr_html_(self) -> str:
        return self.errors._repr_html_()


def make_trial_document(tracked: TrackedTrial, model: body.BodyModel) -> TrackedTrialDocument:
    """One trial's part of ``ik.json``."""
    motion, spread = tracked.motion, tracked.uncertainty
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
        not_determined=[n for n in motion.coordinates if n in unshown.list_unshown_names(motion, model)],
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
