"""What a gait laboratory reads from one model's motions: angles over cycles, profile, score, documents."""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from scaling_service.capabilities.motion import clinical_angles, saving
from scaling_service.capabilities.scaling.comparison import gait_cycles
from scaling_service.core.arrays import Array
from scaling_service.core.errors import InputError
from scaling_service.documents import results
from scaling_service.documents.service import GaitAngleWord
from scaling_service.documents.writing import CYCLES_TABLE
from scaling_service.model.anatomy import frames
from scaling_service.model.body import BodyModel
from scaling_service.model.reference import find_reference_folder, read_reference
from scaling_service.model.results import Motion
from scaling_service.model.trial import Trial
from scaling_service.numerics.statistics.waveforms import NODES

VARIABLES = (
    "pelvis_anterior_tilt",
    "pelvis_obliquity_up",
    "pelvis_internal_rotation",
    "hip_flexion",
    "hip_adduction",
    "hip_internal_rotation",
    "knee_flexion",
    "ankle_dorsiflexion",
    "foot_internal_progression",
)
"""The nine angles of the score, in the order of the profile."""


@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """One angle of a reference population over the gait cycle.

    ``mean``, ``sd`` ((n_nodes,), rad): equally spaced from 0 to 100 %; ``sd`` is between persons.
    """

    mean: Array
    sd: Array

    @property
    def typical(self) -> float:
        """RMS distance of the population's members from its mean, rad."""
        return float(np.sqrt(np.mean(self.sd**2)))


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """The curves of a reference population.

    ``bands``: angle to its band, all of one length.
    """

    source: str
    population: str
    bands: abc.Mapping[str, Band]


@dataclass(frozen=True, slots=True)
class GaitProfile:
    """How far a gait is from the reference, for one person.

    ``variable_scores``: side to angle to its Gait Variable Score, rad: the Movement Analysis Profile.
    ``side_scores``: side to its Gait Profile Score over nine variables, rad; a side that lacks one has none.
    ``score`` (rad): of both sides: six variables of each, and the pelvis' as in the cycles of the left (Baker
        2009).
    """

    variable_scores: abc.Mapping[frames.Side, abc.Mapping[str, float]]
    side_scores: abc.Mapping[frames.Side, float]
    score: float | None


@cache
def read_schwartz2008() -> Reference:
    """Walking at free speed of children and adolescents (Schwartz et al. 2008, J Biomech 41:1639)."""
    document = read_reference(find_reference_folder() / "gait_bands_schwartz2008.yaml")
    bands = {
        name: Band(np.radians(curve["mean"]), np.radians(curve["sd"]))
        for name, curve in document["curves"].items()
    }
    return Reference(document["source"], document["population"], bands)


def compute_gait_variable_score(cycles: Array, mean: Array) -> float:
    """RMS difference from a reference's mean over the cycle, averaged over cycles.

    ``cycles`` ((n_cycles, n_nodes), rad): cycles with NaN do not count.
    ``mean`` ((n_reference_nodes,), rad): every reference node is one of the cycles' nodes: 51 and 101, or
        equally many.
    Returns rad, NaN without a cycle.
    Raises InputError: nodes that do not fall on each other.

    Examples
    --------
    >>> round(compute_gait_variable_score(np.full((2, 101), 0.3), np.full(51, 0.2)), 9)
    0.1
    """
    step, rest = divmod(cycles.shape[1] - 1, len(mean) - 1)
    if rest or not step:
        raise InputError(
            f"a curve of {cycles.shape[1]} nodes has none at those of a reference of {len(mean)}",
            field="reference",
            remedy=f"Give curves of {len(mean)} nodes, or of a whole multiple of its intervals",
        )
    whole = cycles[np.isfinite(cycles).all(axis=1)]
    if not len(whole):
        return float("nan")
    return float(np.sqrt(np.mean((whole[:, ::step] - mean) ** 2, axis=1)).mean())


def compute_gait_profile(
    curves: abc.Mapping[frames.Side, abc.Mapping[str, Array]], reference: Reference
) -> GaitProfile:
    """Scores of both sides.

    ``curves``: side to angle to its cycles, (n_cycles, n_nodes), rad. Sides, angles and cycles may be
    missing.
    """
    scores = {
        side: {
            name: compute_gait_variable_score(angles[name], reference.bands[name].mean)
            for name in VARIABLES
            if name in angles and np.isfinite(angles[name]).all(axis=1).any()
        }
        for side, angles in curves.items()
    }
    complete = {side: by for side, by in scores.items() if len(by) == len(VARIABLES)}
    both = None
    if "r" in complete and "l" in complete:
        once = [score for name, score in complete["r"].items() if name not in frames.PELVIS]
        both = _compute_rms([*once, *complete["l"].values()])
    return GaitProfile(scores, {side: _compute_rms(list(by.values())) for side, by in complete.items()}, both)


def compute_typical_score(reference: Reference) -> float:
    """RMS distance of the reference's members from its mean over the nine variables, rad."""
    return _compute_rms([reference.bands[name].typical for name in VARIABLES])


def _compute_rms(scores: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(scores))))


@dataclass(frozen=True, slots=True, eq=False)
class ClinicalGait:
    """The conventional angles of one model of one person.

    ``recordings``: trial to its angles, of every trial that the model follows.
    ``cycles``: side to its gait cycles; sides without one are absent.
    ``held_out``: whether the cycles are from trials that were not fitted.
    ``reason``: why there is no cycle, one sentence without a full stop; empty where there is one.
    """

    recordings: abc.Mapping[str, clinical_angles.ClinicalAngles]
    cycles: abc.Mapping[frames.Side, clinical_angles.ClinicalCycles]
    held_out: bool
    reason: str = ""

    @property
    def profile(self) -> GaitProfile:
        """Scores over these cycles, against Schwartz 2008."""
        return compute_gait_profile(
            {side: found.values for side, found in self.cycles.items()}, read_schwartz2008()
        )

    @property
    def left_out(self) -> tuple[str, ...]:
        """Which angles are not there and why."""
        return tuple(dict.fromkeys(said for angles in self.recordings.values() for said in angles.left_out))

    @property
    def doubtful(self) -> tuple[str, ...]:
        """Which angles are there but rest on little."""
        return tuple(dict.fromkeys(said for angles in self.recordings.values() for said in angles.doubtful))


def compute_clinical_gait(
    model: BodyModel,
    motions: abc.Mapping[str, Motion],
    trials: abc.Sequence[Trial],
    fitted: abc.Container[str] = (),
) -> ClinicalGait:
    """The conventional angles of a model over its motions, and over the gait cycles that the markers show.

    ``motions``: trial to motion; trials without one are passed over.
    ``trials``: processed: gait cycles are found in their markers.
    ``fitted``: trials that the model was fitted to: their cycles count only where no other trial shows one.
    """
    followed = [trial for trial in trials if trial.name in motions]
    placed = clinical_angles.find_clinical_landmarks(model)
    recordings = {
        trial.name: clinical_angles.compute_clinical_angles(model, motions[trial.name], placed)
        for trial in followed
    }
    held_out = [trial for trial in followed if trial.name not in fitted]
    cycles = _cut_cycles(recordings, held_out)
    of_held_out = bool(cycles)
    if not cycles:
        cycles = _cut_cycles(recordings, [trial for trial in followed if trial.name in fitted])
    why = ""
    if not cycles and followed:
        why = gait_cycles.explain_no_cycles(followed) or "no whole stride is followed"
    elif not cycles:
        why = "no movement was recorded"
    return ClinicalGait(recordings, cycles, of_held_out, why)


def _cut_cycles(
    recordings: abc.Mapping[str, clinical_angles.ClinicalAngles], trials: abc.Sequence[Trial]
) -> dict[frames.Side, clinical_angles.ClinicalCycles]:
    found = {
        side: clinical_angles.cut_clinical_cycles(
            [(recordings[trial.name], gait_cycles.find_gait_cycles(trial, side).cycles) for trial in trials],
            side,
        )
        for side in frames.SIDES
    }
    return {side: cycles for side, cycles in found.items() if cycles is not None}


def write_clinical(folder: Path, gait: ClinicalGait) -> None:
    """``<trial>_clinical.csv`` with every angle over time, and all cycles in ``clinical_angles.csv``.

    Nothing is written where the model tells none of the angles, or where there is no cycle.
    """
    for angles in gait.recordings.values():
        saving.write_clinical_angles(folder, angles)
    if gait.cycles:
        heads = ["trial", "side", "start_s", "end_s", "cycle_pct", *(f"{name}_deg" for name in frames.ANGLES)]
        found: list[list[str]] = []
        for cycles in gait.cycles.values():
            unknown = np.full((len(cycles.cycles), NODES), np.nan)
            table = np.degrees(np.stack([cycles.values.get(n, unknown) for n in frames.ANGLES], axis=2))
            for (trial, start, end), rows in zip(cycles.cycles, table, strict=True):
                begin = [trial, cycles.side, f"{start:.4f}", f"{end:.4f}"]
                numbers = enumerate(saving.format_numbers(rows))
                found.extend([*begin, str(percent), *row] for percent, row in numbers)
        saving.write_numbers(folder / CYCLES_TABLE, heads, found)


def make_clinical_document(gait: ClinicalGait) -> results.ClinicalDocument:
    """The same, summed up over cycles, as it stands in ``scaling.json``."""
    profile, reference = gait.profile, read_schwartz2008()
    return results.ClinicalDocument(
        reference=reference.source,
        population=reference.population,
        sides={
            side: results.ClinicalSide(
                cycles=[
                    results.ClinicalCycle(trial=trial, start_s=start, end_s=end)
                    for trial, start, end in cycles.cycles
                ],
                curves={name: _summarise_curve(values) for name, values in cycles.values.items()},
                gvs_deg={name: _to_degrees(score) for name, score in profile.variable_scores[side].items()},
                gps_deg=_to_degrees(profile.side_scores[side]) if side in profile.side_scores else None,
            )
            for side, cycles in gait.cycles.items()
        },
        gps_deg=None if profile.score is None else _to_degrees(profile.score),
        reference_gvs_deg={name: _to_degrees(reference.bands[name].typical) for name in VARIABLES},
        reference_gps_deg=_to_degrees(compute_typical_score(reference)),
        held_out=gait.held_out,
        left_out=list(gait.left_out),
        doubtful=list(gait.doubtful),
        reason=gait.reason,
    )


def _summarise_curve(values: Array) -> results.ClinicalCurve:
    """Mean and scatter of the cycles that are known, at every second node."""
    known = np.degrees(values[np.isfinite(values).all(axis=1)][:, ::2])
    sd = known.std(axis=0, ddof=1).round(3).tolist() if len(known) > 1 else None
    return results.ClinicalCurve(
        mean_deg=known.mean(axis=0).round(3).tolist(), sd_deg=sd, n_cycles=len(known)
    )


def _to_degrees(angle: float) -> float:
    return round(float(np.degrees(angle)), 3)


def list_gait_angles() -> list[GaitAngleWord]:
    """All angles that a gait laboratory reads: their names for people, and what is usual, deg."""
    found = []
    for name in frames.ANGLES:
        if name in frames.WAYS:
            title, negative, positive = frames.WAYS[name]
            usual = read_schwartz2008().bands.get(name)
            found.append(
                GaitAngleWord(
                    name=name,
                    title=title,
                    negative=negative,
                    positive=positive,
                    usual_deg=None if usual is None else np.degrees(usual.mean).round(3).tolist(),
                    usual_sd_deg=None if usual is None else np.degrees(usual.sd).round(3).tolist(),
                )
            )
    return found
