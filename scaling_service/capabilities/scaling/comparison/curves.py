"""Joint angles over the strides of one person, by every method."""

from __future__ import annotations

import dataclasses
from collections import abc
from typing import Any

import numpy as np

from scaling_service.capabilities.scaling.comparison import gait_cycles
from scaling_service.capabilities.scaling.comparison.geometry import list_joint_angles
from scaling_service.capabilities.scaling.result import Results
from scaling_service.core.arrays import Array
from scaling_service.core.errors import TrialUnusable
from scaling_service.core.streams import stream
from scaling_service.model.anatomy import frames
from scaling_service.model.body import BodyModel
from scaling_service.model.results import Motion
from scaling_service.model.trial import Trial
from scaling_service.numerics.statistics import waveforms
from scaling_service.numerics.statistics.permutation_tests import CurveTest

_JOINTS = ("hip", "knee", "ankle")
"""How the names of a leg's coordinates begin. Puchaud 2019 (section 2.3) compares hips and knees."""

TESTS = waveforms.WaveformSettings(rearrangements=2000)
"""Chosen: enough for a p of 5 % to be 5 ± 0.5 %, and a quarter of a second for all angles."""

_FEWEST_TESTED = 2

Motions = abc.Mapping[str, abc.Mapping[str, Motion]]
"""Method to trial to motion."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CycleCurves:
    """A joint angle over the gait cycle, by each method.

    ``mean``, ``sd``: method to (n_nodes,), degrees, over the cycles; 0 to 100 % of the cycle.
    ``anova``: between the methods over these cycles; None where it could not be computed.
    ``pairs``: method to its test against the reference; empty unless ``anova`` is significant.
    """

    name: str
    mean: abc.Mapping[str, Array]
    sd: abc.Mapping[str, Array]
    n_cycles: int
    anova: CurveTest | None = None
    pairs: abc.Mapping[str, CurveTest] = dataclasses.field(default_factory=dict)

    def describe(self, digits: int) -> dict[str, Any]:
        """Curves and test as documents hold them, but for the pairs."""
        return {
            "cycles": self.n_cycles,
            "mean_deg": {name: values.round(digits).tolist() for name, values in self.mean.items()},
            "sd_deg": {name: values.round(digits).tolist() for name, values in self.sd.items()},
            **describe_test(self.anova),
        }


def describe_test(test: CurveTest | None) -> dict[str, Any]:
    """What a test along the curve says, as documents hold it."""
    return {
        "p": None if test is None else test.p,
        "can_decide": test is not None and test.can_decide,
        "differ_percent": [] if test is None else test.spans,
    }


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Gait:
    """Joint angles over the gait cycles of one person.

    ``trials``: where the cycles are from.
    ``held_out``: whether none of these trials was fitted.
    ``reason``: why there are no curves; empty where there are.
    """

    curves: tuple[CycleCurves, ...] = ()
    trials: tuple[str, ...] = ()
    held_out: bool = True
    reason: str = ""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class StrideCurves:
    """Mean curves of one subject.

    ``curves``: method to coordinate to its mean over strides, (n_nodes,), rad.
    ``strides``: ``r``, ``l`` to the number of strides.
    ``reasons``: ``r``, ``l`` to why there are none, where there are none.
    """

    curves: abc.Mapping[str, abc.Mapping[str, Array]]
    strides: abc.Mapping[str, int]
    reasons: abc.Mapping[str, str]


def make_gait_curves(results: Results, reference: str) -> Gait:
    """Joint angles over the gait cycle, and where methods differ from ``reference``.

    Held-out trials are taken where they show a cycle, else those that were fitted.
    """
    trials = results.session.dynamic
    for held_out in (True, False):
        group = [trial for trial in trials if (trial.name in results.held_out) == held_out]
        curves: list[CycleCurves] = []
        used: list[str] = []
        for side in frames.SIDES:
            angles = [name for name in _list_moving(results, group) if name.endswith(f"_{side}")]
            cut, _ = _cut_strides(group, [s.motions for s in results.scalings.values()], angles, side)
            if cut:
                used += cut
                degrees = np.degrees(np.stack([stride for strides in cut.values() for stride in strides]))
                curves += [
                    _make_cycle_curves(angle, degrees[:, :, k], reference, results)
                    for k, angle in enumerate(angles)
                ]
        gait = Gait(curves=tuple(curves), trials=tuple(dict.fromkeys(used)), held_out=held_out)
        if gait.curves:
            return gait
    return Gait(reason=gait_cycles.explain_no_cycles(trials) or "no whole stride is followed")


def _make_cycle_curves(angle: str, values: Array, reference: str, results: Results) -> CycleCurves:
    """One angle's cycles, (n_cycles, n_methods, n_nodes), degrees, summed up and tested."""
    n, methods = len(values), tuple(results.scalings)
    mean, spread = values.mean(axis=0), values.std(axis=0, ddof=1 if n > 1 else 0)
    anova, pairs = None, {}
    if n >= _FEWEST_TESTED and len(methods) >= 2:
        tested = waveforms.compare_waveforms(
            waveforms.Curves(angle, tuple(f"cycle {k + 1}" for k in range(n)), methods, values),
            stream(results.settings.seed, f"report {angle}"),
            reference=reference,
            settings=TESTS,
        )
        anova = tested.anova
        pairs = {method: pair.test for pair in tested.pairs for method in pair.methods if method != reference}
    return CycleCurves(
        name=angle,
        mean=dict(zip(methods, mean, strict=True)),
        sd=dict(zip(methods, spread, strict=True)),
        n_cycles=n,
        anova=anova,
        pairs=pairs,
    )


def _list_moving(results: Results, trials: abc.Sequence[Trial]) -> list[str]:
    """The joint angles that some recording determines."""
    motions = [s.motions[t.name] for s in results.scalings.values() for t in trials]
    return [
        name
        for name in list_joint_angles(next(iter(results.scalings.values())).calibration.model)
        if any(name in motion.estimated for motion in motions)
    ]


def make_stride_curves(trials: abc.Sequence[Trial], motions: Motions, model: BodyModel) -> StrideCurves:
    """Cut every method's joint angles at the strides that the markers show, and average them.

    A stride counts for all methods or for none: one in which any method's angle is not determined is left
    out. Coordinates that some recording does not determine at all are no curves.

    ``trials``: processed; those that show no walking add nothing.
    ``motions``: method to trial to motion; every method has every trial.
    """
    curves: dict[str, dict[str, Array]] = {method: {} for method in motions}
    strides: dict[str, int] = {}
    reasons: dict[str, str] = {}
    every = [motion for of_method in motions.values() for motion in of_method.values()]
    for side in frames.SIDES:
        names = [
            n for n in list_leg_coordinates(model, side) if all(n in motion.estimated for motion in every)
        ]
        by_trial, why = _cut_strides(trials, list(motions.values()), names, side)
        cut = [stride for found in by_trial.values() for stride in found]
        strides[side] = len(cut)
        if cut:
            for method, of_method in zip(motions, np.mean(cut, axis=0), strict=True):
                curves[method].update(zip(names, of_method, strict=True))
        else:
            none = "there is no trial" if names else "no angle of this leg"
            reasons[side] = "; ".join(dict.fromkeys(why)) or none
    return StrideCurves(curves, strides, reasons)


def list_leg_coordinates(model: BodyModel, side: frames.Side) -> tuple[str, ...]:
    """The rotations of hip, knee and ankle of one side, by their OpenSim-like names (``hip_flexion_r``)."""
    return tuple(
        c.name
        for c in model.coordinates
        if c.kind == "rotation" and c.name.startswith(_JOINTS) and c.name.endswith(f"_{side}")
    )


def _cut_strides(
    trials: abc.Sequence[Trial],
    methods: abc.Sequence[abc.Mapping[str, Motion]],
    names: abc.Sequence[str],
    side: frames.Side,
) -> tuple[dict[str, list[Array]], list[str]]:
    """Trial to its strides that all methods follow, (n_methods, n_names, n_nodes), rad; why not others."""
    cut, why = dict[str, list[Array]](), list[str]()
    for trial in trials if names else ():
        found = gait_cycles.find_gait_cycles(trial, side)
        why += [f"{trial.name}: {found.reason}"] if found.reason else []
        columns = [motions[trial.name].column(name) for motions in methods for name in names]
        table, named = np.stack(columns, axis=1), [*names] * len(methods)
        for cycle in found.cycles:
            try:
                (curves,) = waveforms.normalise_cycles(trial.times, table, [cycle], named, trial=trial.name)
            except TrialUnusable as error:
                why.append(error.problem)
            else:
                strides = cut.setdefault(trial.name, [])
                strides.append(curves.reshape(len(methods), len(names), -1))
    return cut, why
