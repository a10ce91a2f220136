"""Muscle-tendon lengths and moment arms, through OpenSim, and joint moments over trials, by every method."""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scaling_service.capabilities.kinetics import forces as kinetics_forces
from scaling_service.capabilities.kinetics import inverse_dynamics
from scaling_service.capabilities.subject.preparing import Loaded
from scaling_service.core import errors
from scaling_service.core.arrays import Array
from scaling_service.core.progress import Progress
from scaling_service.documents import results
from scaling_service.files import sto
from scaling_service.files.osim import muscles
from scaling_service.model.body import BodyModel
from scaling_service.model.results import Motion
from scaling_service.recording.settings import DYNAMICS_CUTOFF_HZ

MOST_FRAMES = 2000
"""Of one trial that OpenSim looks at, equally spaced. Chosen: a minute of it for 80 muscles; what is between
differs little from its neighbours."""

MOST_ROWS = 10
"""Differences of each method and quantity that are shown, largest first. Chosen: what one looks through."""

UNITS: abc.Mapping[results.MuscleQuantity, tuple[float, str]] = {
    "moment arm": (1e3, "mm"),
    "length": (1e3, "mm"),
    "joint moment": (1.0, "N m"),
}

_TOLD = 2  # of each method and quantity, in words; chosen: the tables have the rest


@dataclass(frozen=True, slots=True, eq=False)
class MuscleCourses:
    """One method's muscles and joints over one trial."""

    times: Array  # (n_frames,), s
    angles: abc.Mapping[str, Array]  # rotational coordinate to (n_frames,), rad
    geometry: muscles.MuscleGeometry
    moments: abc.Mapping[str, Array]
    """Coordinate to its generalised force, (n_frames,), N m; NaN where forces do not determine it. Empty
    without forces."""

    def courses(self, quantity: results.MuscleQuantity) -> dict[tuple[str, str], Array]:
        """Muscle and coordinate, either may be empty, to the quantity's course, (n_frames,), m or N m."""
        if quantity == "length":
            names = [(muscle, "") for muscle in self.geometry.muscles]
            return dict(zip(names, self.geometry.lengths.T, strict=True))
        if quantity == "moment arm":
            return dict(self.geometry.arms)
        return {("", coordinate): values for coordinate, values in self.moments.items()}


@dataclass(frozen=True, slots=True, eq=False)
class MuscleComparison:
    """What the methods make of the muscles."""

    reference: str  # the method that the others are held against
    courses: abc.Mapping[str, abc.Mapping[str, MuscleCourses]]  # method to trial to its courses
    differences: tuple[results.MuscleDifference, ...]
    """Of each method and quantity the largest, in descending order; a muscle or joint comes once for each
    coordinate."""
    notes: tuple[str, ...] = ()  # what is not compared, and why


def compare_muscles(
    loaded: Loaded,
    models: abc.Mapping[str, tuple[BodyModel, str]],
    motions: abc.Mapping[str, abc.Mapping[str, Motion]],
    trials: abc.Sequence[str],
    progress: Progress,
) -> MuscleComparison:
    """Compare what methods make of the muscles of an OpenSim model.

    ``models``: method to its model and the text of its file. ``motions``: method to trial to its motion.
    ``trials``: those that are looked at.
    Raises SubjectInvalid: the model is none of OpenSim, or has no muscles, or no movement was recorded.
    """
    if not loaded.session.subject.model.lower().endswith(".osim"):
        raise _report_no_muscles("is no .osim model")
    if not trials:
        raise errors.SubjectInvalid(
            "muscles are compared over movements, and none was recorded",
            field="trials",
            remedy="Name evaluation trials",
        )
    forces, notes = _gather_forces(loaded, trials)
    found: dict[str, dict[str, MuscleCourses]] = {}
    for k, (method, (model, text)) in enumerate(models.items()):
        found[method] = {}
        for trial in trials:
            progress(f"{method}: muscles in {trial}", k / len(models))
            motion = motions[method][trial]
            ground = forces.get(trial)
            stride = -(-len(motion.times) // MOST_FRAMES)
            rows = slice(None, None, stride)
            order = [motion.coordinates.index(name) for name in model.coordinate_names]
            moments: dict[str, Array] = {}
            if ground is not None:
                dynamics = inverse_dynamics.solve_inverse_dynamics(model, motion, ground.loads)
                judged = inverse_dynamics.find_judged_frames(dynamics, ground.contacts, DYNAMICS_CUTOFF_HZ)
                values = np.where(judged[:, None], dynamics.forces, np.nan)[rows]
                # Rotations that joints between segments leave free; those of the root carry residuals.
                root = {
                    t.coordinate for s in model.segments[:1] for joint in s.joints for t in joint.law.terms
                }
                moments = {
                    c.name: values[:, dynamics.coordinates.index(c.name)]
                    for c in model.coordinates
                    if c.kind == "rotation" and not c.locked and c.name not in root
                }
            found[method][trial] = MuscleCourses(
                motion.times[rows],
                {c.name: motion.column(c.name)[rows] for c in model.coordinates if c.kind == "rotation"},
                muscles.measure_muscles(text, model, motion.q[rows][:, order]),
                moments,
            )
    first = next(iter(next(iter(found.values())).values()))
    if not first.geometry.muscles:
        raise _report_no_muscles("has no muscles")
    reference = "MB" if "MB" in found else next(iter(found))
    differences = [
        peak
        for method in found
        if method != reference
        for quantity in UNITS
        for peak in _list_largest(_list_peaks(found[reference], found[method], quantity, (reference, method)))
    ]
    return MuscleComparison(reference, found, tuple(differences), notes)


def _report_no_muscles(what: str) -> errors.SubjectInvalid:
    return errors.SubjectInvalid(
        f"muscles cannot be compared: the subject's model {what}",
        field="model",
        remedy="Give an .osim model with muscles, or compare without them",
    )


def _gather_forces(
    loaded: Loaded, trials: abc.Sequence[str]
) -> tuple[dict[str, kinetics_forces.TrialForces], tuple[str, ...]]:
    """The forces on the feet of those trials that have some, and why others have no joint moments."""
    try:
        read = kinetics_forces.read_movement_forces(loaded.session.subject, loaded.plates)
        found, unusable = kinetics_forces.assign_forces(
            loaded, {path: read[path] for path in read if path.stem in trials}, lambda _: DYNAMICS_CUTOFF_HZ
        )
    except errors.InputError as error:
        return {}, (f"joint moments are not compared: {error}",)
    without = [trial for trial in trials if trial not in found]
    said = f"joint moments are not compared in {', '.join(without)}: there are no forces"
    return found, (*unusable, said) if without else unusable


def _list_largest(peaks: abc.Iterable[results.MuscleDifference]) -> list[results.MuscleDifference]:
    """The largest of all trials for each muscle and coordinate, the largest first."""
    found: dict[tuple[str, str], results.MuscleDifference] = {}
    for peak in peaks:
        known = found.get((peak.muscle, peak.coordinate))
        if known is None or abs(peak.difference) > abs(known.difference):
            found[peak.muscle, peak.coordinate] = peak
    return sorted(found.values(), key=lambda peak: -abs(peak.difference))[:MOST_ROWS]


def _list_peaks(
    reference: abc.Mapping[str, MuscleCourses],
    method: abc.Mapping[str, MuscleCourses],
    quantity: results.MuscleQuantity,
    names: tuple[str, str],
) -> abc.Iterator[results.MuscleDifference]:
    """Where a method differs most from the reference in each trial, for each muscle and coordinate."""
    factor, unit = UNITS[quantity]
    for trial, own in method.items():
        theirs = reference[trial].courses(quantity)
        for (muscle, coordinate), values in own.courses(quantity).items():
            against = theirs.get((muscle, coordinate), np.zeros_like(values))  # no arm where it is left out
            difference = values - against
            if not np.isfinite(difference).any():
                continue
            at = int(np.nanargmax(np.abs(difference)))
            yield results.MuscleDifference(
                method=names[1],
                against=names[0],
                quantity=quantity,
                muscle=muscle,
                coordinate=coordinate,
                trial=trial,
                time_s=round(float(own.times[at]), 4),
                angle_deg=round(float(np.degrees(own.angles[coordinate][at])), 2) if coordinate else None,
                value=round(factor * float(values[at]), 4),
                reference=round(factor * float(against[at]), 4),
                difference=round(factor * float(difference[at]), 4),
                rms=round(factor * float(np.sqrt(np.nanmean(difference**2))), 4),
                unit=unit,
            )


def make_muscle_document(found: MuscleComparison) -> results.MuscleDocument:
    """The part of ``comparison.json``."""
    grouped: dict[tuple[str, str], list[results.MuscleDifference]] = {}
    for each in found.differences:
        grouped.setdefault((each.method, each.quantity), []).append(each)
    return results.MuscleDocument(
        reference=found.reference,
        trials=list(found.courses[found.reference]),
        differences=list(found.differences),
        summary=[each.sentence for rows in grouped.values() for each in rows[:_TOLD]],
        notes=list(found.notes),
    )


def write_courses(folder: Path, courses: abc.Mapping[str, MuscleCourses]) -> None:
    """Write ``TRIAL_muscle_lengths.sto``, ``TRIAL_moment_arms.sto``, ``TRIAL_joint_moments.sto``; m, N m.

    A moment arm's column is ``MUSCLE.COORDINATE``; joint moments only where there are forces.
    """
    for trial, own in courses.items():
        tables = {
            "muscle_lengths": {muscle: column for (muscle, _), column in own.courses("length").items()},
            "moment_arms": {".".join(pair): column for pair, column in own.courses("moment arm").items()},
            "joint_moments": {f"{name}_moment": column for name, column in own.moments.items()},
        }
        for what, columns in tables.items():
            if columns:
                data = np.column_stack([own.times, *columns.values()])
                name, heads = f"{trial} {what}", ("time", *columns)
                table = sto.Table(name=name, columns=heads, data=data, in_degrees=False)
                sto.write_sto(folder / f"{trial}_{what}.sto", table)
