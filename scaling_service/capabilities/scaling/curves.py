"""From results in memory to the curves of a report: errors and joint angles over time and over the cycle."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Literal

import numpy as np

from scaling_service.capabilities.scaling.comparison.gait_cycles import Cycle, find_gait_cycles
from scaling_service.capabilities.scaling.judging import joint_angles
from scaling_service.capabilities.scaling.report.data import Curves, CycleCurves, Gait
from scaling_service.capabilities.scaling.run import Results, Scaling
from scaling_service.core.streams import stream
from scaling_service.model.results import Array, Motion
from scaling_service.model.trial import Trial
from scaling_service.numerics.statistics.cycles import Curves as CohortCurves
from scaling_service.numerics.statistics.cycles import normalised_cycles
from scaling_service.numerics.statistics.waveform_clusters import CurveTest
from scaling_service.numerics.statistics.waveforms import (
    WaveformComparison,
    WaveformSettings,
    compare_waveforms,
)

MOST_POINTS = 300
"""Of a curve over time. Chosen: as many as a chart has pixels."""

TESTS = WaveformSettings(rearrangements=2000)
"""Chosen: enough for a p of 5 % to be 5 ± 0.5 %, and a quarter of a second for all angles."""

_SIDES: tuple[Literal["r", "l"], ...] = ("r", "l")
_FEWEST_TESTED = 2


def error_curves(results: Results) -> tuple[Curves, ...]:
    """Mean distance between measured and model markers over time, mm, of each trial."""
    held_out = _held_out(results)
    found = []
    for trial in results.session.dynamic:
        rows = _rows(trial)
        values = {
            name: _mean_distance(scaling.motions[trial.name])[rows]
            for name, scaling in results.scalings.items()
            if trial.name in scaling.motions
        }
        known = {name: 1e3 * value for name, value in values.items() if np.isfinite(value).any()}
        if known:
            found.append(
                Curves("mean distance", trial.name, trial.name in held_out, trial.times[rows], known)
            )
    return tuple(found)


def angle_curves(results: Results, trial: Trial) -> tuple[Curves, ...]:
    """Joint angles over time, degrees, in one trial."""
    rows = _rows(trial)
    found = []
    for angle in _angles(results):
        values = {
            name: np.degrees(_column(scaling.motions[trial.name], angle)[rows])
            for name, scaling in results.scalings.items()
            if angle in scaling.motions[trial.name].estimated
        }
        known = {name: value for name, value in values.items() if np.isfinite(value).any()}
        if known:
            found.append(
                Curves(angle, trial.name, trial.name in _held_out(results), trial.times[rows], known)
            )
    return tuple(found)


def gait_curves(results: Results, reference: str) -> Gait:
    """Joint angles over the gait cycle, and where methods differ.

    Held-out trials are taken where they show a cycle, else those that were fitted.

    Parameters
    ----------
    reference : str
        The method that the others are tested against.
    """
    held_out = _held_out(results)
    trials = results.session.dynamic
    groups = (
        [t for t in trials if t.name in held_out],
        [t for t in trials if t.name not in held_out],
    )
    for group in groups:
        gait = _gait(results, group, reference, held_out=group is groups[0])
        if gait.curves:
            return gait
    reasons = dict.fromkeys(find_gait_cycles(t, side).reason for t in trials for side in _SIDES)
    said = [reason for reason in reasons if reason]
    return Gait(reason=said[0] if said else "no whole stride is followed")


def _gait(results: Results, trials: Sequence[Trial], reference: str, *, held_out: bool) -> Gait:
    curves: list[CycleCurves] = []
    used: list[str] = []
    for side in _SIDES:
        angles = [name for name in _moving(results, trials) if name.endswith(f"_{side}")]
        by_trial = {
            trial.name: cut
            for trial in trials
            if len(cut := _cut(results.scalings, trial, angles, find_gait_cycles(trial, side).cycles))
        }
        if by_trial:
            used += [name for name in by_trial if name not in used]
            cycles = np.concatenate(list(by_trial.values()))
            curves += [
                _cycle_curves(angle, tuple(results.scalings), cycles[:, :, k], reference, results)
                for k, angle in enumerate(angles)
            ]
    return Gait(tuple(curves), reference, tuple(used), held_out)


def _cut(
    scalings: Mapping[str, Scaling], trial: Trial, angles: Sequence[str], cycles: Sequence[Cycle]
) -> Array:
    """Cycles that all methods follow in all angles, (n_cycles, n_methods, n_angles, n_nodes), degrees."""
    if not angles or not cycles:
        return np.empty((0, len(scalings), len(angles), 0))
    motions = [scaling.motions[trial.name] for scaling in scalings.values()]
    tables = [np.degrees(np.stack([_column(m, angle) for angle in angles], axis=1)) for m in motions]
    whole = [
        (start, end)
        for start, end in cycles
        if all(_known(trial.times, table, start, end) for table in tables)
    ]
    if not whole:
        return np.empty((0, len(scalings), len(angles), 0))
    cut = [normalised_cycles(trial.times, table, whole, angles, trial=trial.name) for table in tables]
    return np.stack(cut, axis=1)


def _known(times: Array, table: Array, start: float, end: float) -> bool:
    """Whether all values are known within a cycle and in the frame at either side of it."""
    first = max(int(np.searchsorted(times, start, side="right")) - 1, 0)
    last = min(int(np.searchsorted(times, end, side="left")), len(times) - 1)
    return bool(np.isfinite(table[first : last + 1]).all())


def _cycle_curves(
    angle: str, methods: tuple[str, ...], values: Array, reference: str, results: Results
) -> CycleCurves:
    """One angle's cycles, (n_cycles, n_methods, n_nodes), summed up and tested."""
    n = len(values)
    mean, spread = values.mean(axis=0), values.std(axis=0, ddof=1 if n > 1 else 0)
    tested = _tested(angle, methods, values, reference, results)
    return CycleCurves(
        angle,
        dict(zip(methods, mean, strict=True)),
        dict(zip(methods, spread, strict=True)),
        n,
        anova=None if tested is None else tested.anova,
        pairs={} if tested is None else dict(_pairs(tested, reference)),
    )


def _pairs(tested: WaveformComparison, reference: str) -> Iterator[tuple[str, CurveTest]]:
    for pair in tested.pairs:
        (other,) = (name for name in pair.methods if name != reference)
        yield other, pair.test


def _tested(
    angle: str, methods: tuple[str, ...], values: Array, reference: str, results: Results
) -> WaveformComparison | None:
    if len(values) < _FEWEST_TESTED or len(methods) < 2:
        return None
    cycles = tuple(f"cycle {k + 1}" for k in range(len(values)))
    return compare_waveforms(
        CohortCurves(angle, cycles, methods, values),
        stream(results.settings.seed, f"report {angle}"),
        reference=reference,
        settings=TESTS,
    )


def _held_out(results: Results) -> set[str]:
    fitted = {trial.name for trial in results.session.calibration}
    return {trial.name for trial in results.session.dynamic} - fitted


def _angles(results: Results) -> tuple[str, ...]:
    return joint_angles(next(iter(results.scalings.values())).calibration.model)


def _moving(results: Results, trials: Sequence[Trial]) -> list[str]:
    """The joint angles that some recording determines."""
    motions = [s.motions[t.name] for s in results.scalings.values() for t in trials]
    return [name for name in _angles(results) if any(name in motion.estimated for motion in motions)]


def _column(motion: Motion, coordinate: str) -> Array:
    column: Array = motion.q[:, motion.coordinates.index(coordinate)]
    return column


def _mean_distance(motion: Motion) -> Array:
    """Over the markers seen in each frame, m; NaN where none is seen."""
    distances = motion.distances
    seen = np.isfinite(distances)
    counts = seen.sum(axis=1)
    sums = np.where(seen, distances, 0.0).sum(axis=1)
    return np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)


def _rows(trial: Trial) -> slice:
    return slice(None, None, max(1, -(-trial.n_frames // MOST_POINTS)))
