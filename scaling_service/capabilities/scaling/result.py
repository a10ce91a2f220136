"""What scaling by one or several methods found, in memory."""

from __future__ import annotations

import dataclasses
import math
from collections import abc
from functools import cached_property
from html import escape
from pathlib import Path

import numpy as np

from scaling_service.capabilities.motion.kinematic_error import KinematicError
from scaling_service.capabilities.motion.result import TrackedTrial
from scaling_service.capabilities.motion.stops import describe_stops
from scaling_service.capabilities.motion.tables import tabulate_coordinates
from scaling_service.capabilities.scaling import clinical_gait
from scaling_service.capabilities.scaling.comparison import evidence
from scaling_service.capabilities.scaling.comparison import geometry as geometries
from scaling_service.capabilities.scaling.comparison.verdict import judge
from scaling_service.capabilities.scaling.methods.table import METHODS
from scaling_service.capabilities.scaling.muscles.compare import MuscleComparison
from scaling_service.capabilities.scaling.muscles.surface import MovedAttachments
from scaling_service.capabilities.scaling.options import ComparisonOptions
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.capabilities.subject.preparing import Loaded
from scaling_service.core.tables import ResultTable
from scaling_service.documents.results import VerdictDocument
from scaling_service.model.results import Calibration, Motion
from scaling_service.model.subject import Session
from scaling_service.numerics.multibody.laws import Array

_MM = 1e3
_WHOSE = ("another_person", "scale", "mass")  # codes of what leaves open whose body it is, or how large


@dataclasses.dataclass(frozen=True, slots=True, eq=False, repr=False, kw_only=True)
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
    angle_sds : mapping of str to mapping
        By the joint posterior: trial to joint angle to its standard deviation, RMS over frames, rad.
    deviations : mapping of str to array
        Of a method with a posterior: trial to each coordinate's deviation, (n_frames, n_coordinates).
    inverse_kinematics_s : float
        Wall time of all motions, s.
    osim : str, optional
        The text of the model's file for OpenSim, where it is made already.
    attachments : mapping of str to MovedAttachments
        Segment to its muscles' attachments, where they follow the person's bone.
    followed : mapping of str to TrackedTrial
        Recordings of rotations without markers, which nothing is compared on, by their names.

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
    motions: abc.Mapping[str, Motion]
    errors: abc.Mapping[str, KinematicError]
    geometry: geometries.Geometry
    angle_sds: abc.Mapping[str, abc.Mapping[str, float]] = dataclasses.field(default_factory=dict)
    deviations: abc.Mapping[str, Array] = dataclasses.field(default_factory=dict)
    inverse_kinematics_s: float = 0.0
    osim: str | None = None
    attachments: abc.Mapping[str, MovedAttachments] = dataclasses.field(default_factory=dict)
    followed: abc.Mapping[str, TrackedTrial] = dataclasses.field(default_factory=dict)

    def __repr__(self) -> str:
        numbers = len(self.calibration.parameters)
        return f"Scaling by {self.calibration.method}, {numbers} numbers fitted: {self.calibration.model!r}"


@dataclasses.dataclass(frozen=True, eq=False, repr=False, kw_only=True)
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
    MB is one estimate of several: compute MAP to know how far to trust it.
    >>> results.held_out
    ('gait_1', 'gait_2')
    """

    loaded: Loaded
    settings: Settings
    scalings: abc.Mapping[str, Scaling]
    warnings: tuple[str, ...] = ()
    wall_s: float = 0.0
    subject_file: Path | None = None
    options: ComparisonOptions = ComparisonOptions()
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
    def tables(self) -> dict[str, ResultTable]:
        """All of these, and the coordinates of every method's motions, by name."""
        motions = {
            f"motion_{method}_{trial}": tabulate_coordinates(
                trial, motion, scaling.calibration.model, system=method
            )
            for method, scaling in self.scalings.items()
            for trial, motion in [
                *scaling.motions.items(),
                *((name, one.motion) for name, one in scaling.followed.items()),
            ]
        }
        return {"errors": self.errors, "lengths": self.lengths, "parameters": self.parameters, **motions}

    @cached_property
    def verdict(self) -> VerdictDocument:
        """Which model to use for this person, why, and how far to trust it."""
        return judge(gather_evidence(self))

    @cached_property
    def gait(self) -> abc.Mapping[str, clinical_gait.ClinicalGait]:
        """What each method's model says in a gait laboratory's terms."""
        fitted = {trial.name for trial in self.session.calibration}
        return {
            method: clinical_gait.compute_clinical_gait(
                scaling.calibration.model, scaling.motions, self.session.dynamic, fitted
            )
            for method, scaling in self.scalings.items()
        }

    def __repr__(self) -> str:
        said = f"\n{self.verdict.headline}" if self.scalings else ""
        return f"Results of {', '.join(self.scalings)} for subject '{self.session.subject.id}'{said}"

    def _repr_html_(self) -> str:
        return f"<p>{escape(repr(self))}</p>{self.errors._repr_html_()}{self.lengths._repr_html_()}"


def gather_evidence(results: Results) -> evidence.Evidence:
    """What a verdict on the methods computed rests on."""
    session = results.session
    fitted = [trial.name for trial in session.calibration]
    names = {name for scaling in results.scalings.values() for name in scaling.geometry.lengths}
    # By which recordings and images look like more than one body, or none.
    contradictions = [str(note) for note in session.notes if note.code in _WHOSE]
    for scaling in results.scalings.values():
        contradictions += scaling.calibration.contradictions
    errors = {name: scaling.errors for name, scaling in results.scalings.items()}
    contradictions += geometries.list_doubts(errors, {}, None)
    return evidence.Evidence(
        tuple(
            _gather_method_evidence(scaling, fitted, results.held_out)
            for scaling in results.scalings.values()
        ),
        frozenset() if session.images is None else frozenset(session.images.centres),
        geometries.estimate_usual_lengths(session.subject.height_m, sorted(names)),
        tuple(dict.fromkeys(contradictions)),
    )


def _gather_method_evidence(
    scaling: Scaling, fitted: abc.Sequence[str], held_out: abc.Sequence[str]
) -> evidence.MethodEvidence:
    calibration, shape = scaling.calibration, scaling.geometry
    posterior, parameters = calibration.model.posterior, calibration.parameters
    # Where and when a marker is farthest from the model's.
    found: list[evidence.Moment] = []
    for trial, motion in scaling.motions.items():
        distances = motion.distances
        if np.isfinite(distances).any():
            frame, column = np.unravel_index(int(np.nanargmax(distances)), distances.shape)
            time, away = float(motion.times[frame]), float(distances[frame, column])
            found.append(evidence.Moment(motion.markers[column], trial, time, away))
    # Joint angle to its root mean square deviation over trials, rad
    trials = held_out or fitted
    known: dict[str, list[float]] = {}
    for trial in trials:
        for name, sd in scaling.angle_sds.get(trial, {}).items():
            known.setdefault(name, []).append(sd)
    return evidence.MethodEvidence(
        method=calibration.method,
        from_images=METHODS[calibration.method].needs_images,
        skin=None if posterior is None else posterior.skin,
        worst=max(found, key=lambda moment: moment.distance, default=None),
        fitted=evidence.average_errors(scaling.errors, fitted),
        held_out=evidence.average_errors(scaling.errors, held_out),
        lengths=shape.lengths,
        length_sds={
            size.dimension: size.sd * shape.lengths[size.dimension]
            for size in calibration.sizes.values()
            if size.dimension in shape.lengths
        },
        centre_sds={name: math.hypot(*centre.sd) for name, centre in calibration.centres.items()},
        angle_sds={name: float(np.sqrt(np.mean(np.square(values)))) for name, values in known.items()},
        by_people=()
        if posterior is None
        else tuple(p.name for p in parameters if p.group in ("length", "centre") and not p.identifiable),
        stops=tuple(describe_stops(calibration.model, scaling.motions)),
    )
