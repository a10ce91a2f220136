"""What scaling by one or several methods found, in memory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from itertools import combinations
from pathlib import Path

import numpy as np

from scaling_service.capabilities.motion.kinematic_error import KinematicError
from scaling_service.capabilities.scaling.comparison.evidence import (
    Evidence,
    MethodEvidence,
    Verdict,
    average_errors,
)
from scaling_service.capabilities.scaling.comparison.geometry import (
    Geometry,
    estimate_usual_lengths,
    list_joint_angles,
)
from scaling_service.capabilities.scaling.comparison.verdict import judge
from scaling_service.capabilities.scaling.methods.table import METHODS
from scaling_service.capabilities.scaling.muscles.compare import MuscleComparison
from scaling_service.capabilities.scaling.muscles.surface import MovedAttachments
from scaling_service.capabilities.scaling.options import PLAIN, ComparisonOptions
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.capabilities.subject.loading import Loaded
from scaling_service.core.tables import ResultTable
from scaling_service.model.results import Calibration, Motion
from scaling_service.model.subject import Session

_MM = 1e3


@dataclass(frozen=True, slots=True, eq=False, repr=False, kw_only=True)
class Scaling:
    """One method's model of a person, and how it follows the recordings.

    Attributes
    ----------
    calibration : Calibration
        The model, its scale factors, and every fitted number with its standard deviation.
    motions : mapping of str to Motion
        Of each calibration and evaluation trial, by its name: coordinates in rad and m.
    errors : mapping of str to KinematicError
        Of the same trials, m.
    geometry : Geometry
        Segment lengths, joint centres and marker shifts in m, knee axes in rad.
    inverse_kinematics_s : float
        Wall time of all motions, s.
    osim : str, optional
        The text of the model's file for OpenSim, where it is made already.
    attachments : mapping of str to MovedAttachments
        Segment to its muscles' attachments, where they follow the person's bone.

    Examples
    --------
    >>> import scaling_service as ss
    >>> scaling = ss.scale("lab/subject.json", "MB").scalings["MB"]
    >>> isinstance(scaling, ss.Scaling)
    True
    >>> scaling.motions["gait_1"].q.shape  # frames, coordinates
    (278, 14)
    """

    calibration: Calibration
    motions: Mapping[str, Motion]
    errors: Mapping[str, KinematicError]
    geometry: Geometry
    inverse_kinematics_s: float = 0.0
    osim: str | None = None
    attachments: Mapping[str, MovedAttachments] = field(default_factory=dict)

    def __repr__(self) -> str:
        numbers = len(self.calibration.parameters)
        return f"Scaling by {self.calibration.method}, {numbers} numbers fitted: {self.calibration.model!r}"


@dataclass(frozen=True, slots=True, eq=False, repr=False, kw_only=True)
class Results:
    """What one or several methods made of a subject.

    Attributes
    ----------
    loaded : Loaded
        The model and the recordings, and how their labels and axes were understood.
    settings : Settings
        What was chosen.
    scalings : mapping of str to Scaling
        By method, in the order computed.
    warnings : tuple of str
        What concerns all methods.
    wall_s : float
        Wall time, s.
    subject_file : Path, optional
        Where the subject came from.
    options : ComparisonOptions
        What else was asked for.
    muscles : MuscleComparison, optional
        Where it was asked for.

    Examples
    --------
    >>> import scaling_service as ss
    >>> results = ss.scale("lab/subject.json", "MB")
    >>> isinstance(results, ss.Results)
    True
    >>> results
    Results of MB for subject 'example'
    MB was the only method computed: nothing here confirms it.
    >>> results.held_out
    ('gait_1', 'gait_2')
    """

    loaded: Loaded
    settings: Settings
    scalings: Mapping[str, Scaling]
    warnings: tuple[str, ...] = ()
    wall_s: float = 0.0
    subject_file: Path | None = None
    options: ComparisonOptions = PLAIN
    muscles: MuscleComparison | None = None

    @property
    def session(self) -> Session:
        """The model and the recordings that were used."""
        return self.loaded.session

    @property
    def held_out(self) -> tuple[str, ...]:
        """The trials that no method was fitted to."""
        fitted = {trial.name for trial in self.session.calibration}
        return tuple(trial.name for trial in self.session.dynamic if trial.name not in fitted)

    @property
    def errors(self) -> ResultTable:
        """Kinematic error of every method in every trial, mm."""
        columns = ("method", "trial", "role", "mean_mm", "sd_mm", "rms_mm", "max_mm")
        rows = tuple(
            (
                method,
                trial,
                "held out" if trial in self.held_out else "used to fit",
                *(_MM * value for value in (error.mean, error.sd, error.rms, error.max)),
            )
            for method, scaling in self.scalings.items()
            for trial, error in scaling.errors.items()
        )
        return ResultTable("Kinematic error", columns, rows)

    @property
    def lengths(self) -> ResultTable:
        """Segment lengths by every method, mm."""
        rows = tuple(
            (method, segment, _MM * length)
            for method, scaling in self.scalings.items()
            for segment, length in scaling.geometry.lengths.items()
        )
        return ResultTable("Segment lengths", ("method", "segment", "length_mm"), rows)

    @property
    def parameters(self) -> ResultTable:
        """Every number that a method fitted, rad and m, and whether the recordings determine it."""
        columns = ("method", "name", "value", "unit", "sd", "at_bound", "identifiable")
        rows = tuple(
            (method, p.name, p.value, p.unit, p.sd, p.at_bound, p.identifiable)
            for method, scaling in self.scalings.items()
            for p in scaling.calibration.parameters
        )
        return ResultTable("Fitted numbers", columns, rows)

    @property
    def verdict(self) -> Verdict:
        """Which model to use for this person, why, and how far to trust it."""
        return judge(gather_evidence(self))

    def __repr__(self) -> str:
        said = f"\n{self.verdict.headline}" if self.scalings else ""
        return f"Results of {', '.join(self.scalings)} for subject '{self.session.subject.id}'{said}"

    def _repr_html_(self) -> str:
        return f"<p>{escape(repr(self))}</p>{self.errors._repr_html_()}{self.lengths._repr_html_()}"


def gather_evidence(results: Results) -> Evidence:
    """What a verdict on the methods computed rests on."""
    session = results.session
    fitted = [trial.name for trial in session.calibration]
    names = {name for scaling in results.scalings.values() for name in scaling.geometry.lengths}
    return Evidence(
        tuple(
            _gather_method_evidence(scaling, fitted, results.held_out)
            for scaling in results.scalings.values()
        ),
        frozenset() if session.images is None else frozenset(session.images.centres),
        estimate_usual_lengths(session.subject.height_m, sorted(names)),
        find_angles_apart(results.scalings, results.held_out or fitted),
    )


def _gather_method_evidence(
    scaling: Scaling, fitted: Sequence[str], held_out: Sequence[str]
) -> MethodEvidence:
    calibration, shape = scaling.calibration, scaling.geometry
    method, parameters = METHODS[calibration.method], calibration.parameters
    return MethodEvidence(
        method=calibration.method,
        start=method.needs,
        from_images=method.needs_images,
        fits_lengths=method.fits_lengths,
        fitted=average_errors(scaling.errors, fitted),
        held_out=average_errors(scaling.errors, held_out),
        parameters=len(parameters),
        undetermined=sum(not p.identifiable for p in parameters),
        at_bounds=sum(p.at_bound for p in parameters),
        lengths=shape.lengths,
        hip_centres={
            name: at for name, (_, at) in shape.joint_centres.items() if name.partition("_")[0] == "hip"
        },
        knee_axes=shape.knee_axes,
        length_sds={
            size.dimension: size.sd * shape.lengths[size.dimension]
            for size in calibration.sizes.values()
            if size.dimension in shape.lengths
        },
        inferred=tuple(name for name, size in calibration.sizes.items() if not size.own),
    )


def find_angles_apart(
    scalings: Mapping[str, Scaling], trials: Sequence[str]
) -> dict[tuple[str, str], tuple[str, float]]:
    """For every two methods the joint angle in which they differ most, and its RMS difference, rad.

    Over the frames of ``trials`` in which both methods know the angle.
    """
    found = {}
    for first, second in combinations(scalings, 2):
        gaps = _compute_gaps(scalings[first], scalings[second], trials)
        if gaps:
            worst = max(gaps, key=lambda name: gaps[name])
            found[first, second] = (worst, gaps[worst])
    return found


def _compute_gaps(first: Scaling, second: Scaling, trials: Sequence[str]) -> dict[str, float]:
    """Joint angle to the RMS difference of two methods, rad."""
    both = [
        (first.motions[t], second.motions[t]) for t in trials if t in first.motions and t in second.motions
    ]
    gaps = {}
    for name in list_joint_angles(first.calibration.model):
        squares = [
            (a.column(name) - b.column(name)) ** 2
            for a, b in both
            if name in a.estimated and name in b.estimated
        ]
        known = np.concatenate(squares) if squares else np.empty(0)
        known = known[np.isfinite(known)]
        if known.size:
            gaps[name] = float(np.sqrt(known.mean()))
    return gaps
