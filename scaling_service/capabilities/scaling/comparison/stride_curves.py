"""Joint angles over the strides of one subject, every method on the same strides."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from scaling_service.capabilities.scaling.comparison.gait_cycles import Cycle, Side, find_gait_cycles
from scaling_service.core.errors import TrialUnusable
from scaling_service.model.body import BodyModel
from scaling_service.model.results import Array, Motion
from scaling_service.model.trial import Trial
from scaling_service.numerics.statistics.cycles import NODES, normalised_cycles

_JOINTS = ("hip", "knee", "ankle")
"""How the names of a leg's coordinates begin. Puchaud 2019 (section 2.3) compares hips and knees."""

Motions = Mapping[str, Mapping[str, Motion]]
"""Method to trial to motion."""


@dataclass(frozen=True, slots=True, eq=False)
class StrideCurves:
    """Mean curves of one subject.

    Parameters
    ----------
    curves : mapping
        Method to coordinate to its mean over strides, shape (n_nodes,), rad.
    strides : mapping
        ``r``, ``l`` to the number of strides.
    reasons : mapping
        ``r``, ``l`` to why there are none, where there are none.
    """

    curves: Mapping[str, Mapping[str, Array]]
    strides: Mapping[str, int]
    reasons: Mapping[str, str]


def leg_coordinates(model: BodyModel, side: Side) -> tuple[str, ...]:
    """The rotations of hip, knee and ankle of one side, by their OpenSim-like names (``hip_flexion_r``)."""
    return tuple(
        c.name
        for c in model.coordinates
        if c.kind == "rotation" and c.name.startswith(_JOINTS) and c.name.endswith(f"_{side}")
    )


def stride_curves(trials: Sequence[Trial], motions: Motions, model: BodyModel) -> StrideCurves:
    """Cut every method's joint angles at the strides that the markers show, and average them.

    Parameters
    ----------
    trials : sequence of Trial
        Processed; those that show no walking add nothing.
    motions : mapping
        Method to trial to motion; every method has every trial.
    model : BodyModel
        Names the coordinates.

    Notes
    -----
    A stride counts for all methods or for none: one in which any method's angle is not determined is left
    out. Coordinates that some recording does not determine at all are no curves.
    """
    curves: dict[str, dict[str, Array]] = {method: {} for method in motions}
    strides: dict[str, int] = {}
    reasons: dict[str, str] = {}
    for side in ("r", "l"):
        names = _determined(leg_coordinates(model, side), motions)
        cut, why = _all_strides(trials, motions, names, side) if names else ([], ["no angle of this leg"])
        strides[side] = len(cut)
        if not cut:
            reasons[side] = "; ".join(dict.fromkeys(why)) or "there is no trial"
            continue
        means = np.mean(cut, axis=0)
        for method, of_method in zip(motions, means, strict=True):
            curves[method].update(zip(names, of_method, strict=True))
    return StrideCurves(curves, strides, reasons)


def _determined(names: Sequence[str], motions: Motions) -> tuple[str, ...]:
    every = [motion for by_trial in motions.values() for motion in by_trial.values()]
    return tuple(name for name in names if all(name in motion.estimated for motion in every))


def _all_strides(
    trials: Sequence[Trial], motions: Motions, names: Sequence[str], side: Side
) -> tuple[list[Array], list[str]]:
    """Each stride's curves, (n_methods, n_curves, n_nodes), and why trials or strides gave none."""
    cut: list[Array] = []
    why: list[str] = []
    for trial in trials:
        found = find_gait_cycles(trial, side)
        if found.reason:
            why.append(f"{trial.name}: {found.reason}")
        for cycle in found.cycles:
            try:
                cut.append(_stride([by_trial[trial.name] for by_trial in motions.values()], names, cycle))
            except TrialUnusable as error:
                why.append(error.problem)
    return cut, why


def _stride(motions: Sequence[Motion], names: Sequence[str], cycle: Cycle) -> Array:
    """One stride under all methods, (n_methods, n_curves, n_nodes)."""
    curves = np.empty((len(motions), len(names), NODES))
    for k, motion in enumerate(motions):
        columns = [motion.coordinates.index(name) for name in names]
        curves[k] = normalised_cycles(motion.times, motion.q[:, columns], [cycle], names, trial=motion.trial)[
            0
        ]
    return curves
