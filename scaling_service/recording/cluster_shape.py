"""The shape of the markers on one segment: what it usually is, and where labels of it are exchanged.

Distances between markers of one segment change by skin only, so they tell the same in every recording of a
session, whatever the axes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise, permutations

import numpy as np
from numpy.typing import NDArray

from scaling_service.model.trial import Array, Trial
from scaling_service.numerics.least_squares.masks import ever
from scaling_service.numerics.signals.filters import runs

Clusters = Mapping[str, Sequence[str]]
"""Segment to labels on it."""

Shape = Mapping[tuple[str, str], float]
"""Two labels of one segment, in alphabetical order, to their usual distance, m."""

CHANGED_M = 0.025
"""Chosen: a distance within a segment that differs by more is no skin alone (soft tissue of a thigh in deep
squats reaches 40 mm, so a better assignment of the labels must explain it, too)."""

EXPLAINED = 0.4
"""Chosen: share of the difference that labels put right may leave; those of real recordings leave 0.2."""

SHORTEST_S = 0.1
"""Chosen: briefer exchanges are survived by smoothing and robust fits."""

JUMP_M = 0.015
"""Chosen: a distance within a segment that changes by more from one frame to the next is a change of labels
(1.5 m/s at 100 frames per second; skin in running stays below 1)."""

_EVERY_ORDER = 7
"""Markers of a segment whose every order is tried (5040); of more, exchanges of two."""


@dataclass(frozen=True, slots=True)
class Exchange:
    """Labels of one segment that stand for each other for a while.

    ``difference_m``, ``left_m``: how far distances are from the usual ones as labelled, and with the labels
    put right.
    """

    labels: tuple[str, ...]  # those that are wrong
    start_s: float
    end_s: float
    difference_m: float
    left_m: float


def shape_of(trials: Iterable[Trial], clusters: Clusters) -> dict[tuple[str, str], float]:
    """The usual distance of every two markers of a segment, over the recordings that show both.

    ``trials``: in m; of each, its median counts once, however long it is.
    """
    found: dict[tuple[str, str], list[float]] = {}
    for trial in trials:
        for labels in clusters.values():
            for pair in combinations(sorted(name for name in labels if name in trial.labels), 2):
                distance = _distance(trial, *pair)
                known = distance[np.isfinite(distance)]
                if len(known):
                    found.setdefault(pair, []).append(float(np.median(known)))
    return {pair: float(np.median(values)) for pair, values in found.items()}


def _distance(trial: Trial, one: str, other: str) -> Array:
    distance: Array = np.linalg.norm(trial.position(one) - trial.position(other), axis=1)
    return distance


def exchanges(trial: Trial, clusters: Clusters, usual: Shape) -> Iterator[Exchange]:
    """Where labels of one segment would fit the usual shape far better in another order.

    ``trial``: in m, before gaps are filled and positions smoothed. ``usual``: of other recordings,
    :func:`shape_of`.
    """
    for labels in clusters.values():
        names = sorted(name for name in labels if name in trial.labels)
        pairs = [pair for pair in combinations(names, 2) if pair in usual]
        if len(pairs) < 2:
            continue
        measured = np.stack([_distance(trial, *pair) for pair in pairs], axis=1)
        away = np.abs(measured - [usual[pair] for pair in pairs])
        changed = np.nan_to_num(away).max(axis=1) > CHANGED_M
        yield from _joined(
            Exchange(
                tuple(a for a, b in zip(names, found[0], strict=True) if a != b),
                float(trial.times[start]),
                float(trial.times[stop - 1]),
                *found[1:],
            )
            for start, stop in _blocks(changed, measured)
            if stop - start >= SHORTEST_S * trial.rate_hz
            if (found := _better_order(names, pairs, measured[start:stop], usual)) is not None
        )


def _blocks(changed: NDArray[np.bool_], measured: Array) -> Iterator[tuple[int, int]]:
    """Runs of changed frames, cut where a distance jumps."""
    with np.errstate(invalid="ignore"):
        jumps = np.flatnonzero(np.nanmax(np.abs(np.diff(measured, axis=0)), axis=1, initial=0.0) > JUMP_M) + 1
    for start, stop in runs(changed):
        cuts = [int(start), *(int(j) for j in jumps if start < j < stop), int(stop)]
        yield from pairwise(cuts)


def _joined(found: Iterable[Exchange]) -> Iterator[Exchange]:
    """Blocks in a row with the same labels wrong as one."""
    last: Exchange | None = None
    for item in found:
        if last is not None and last.labels == item.labels and item.start_s - last.end_s < SHORTEST_S:
            worst = max(last.difference_m, item.difference_m), max(last.left_m, item.left_m)
            last = Exchange(last.labels, last.start_s, item.end_s, *worst)
            continue
        if last is not None:
            yield last
        last = item
    if last is not None:
        yield last


def _better_order(
    names: Sequence[str], pairs: Sequence[tuple[str, str]], measured: Array, usual: Shape
) -> tuple[tuple[str, ...], float, float] | None:
    """The order of labels that fits a block best, with the largest difference before and after."""
    known = ever(np.isfinite(measured))
    kept = [pair for pair, is_known in zip(pairs, known, strict=True) if is_known]
    if len(kept) < 2:
        return None
    typical = dict(zip(kept, np.nanmedian(measured[:, known], axis=0).tolist(), strict=True))
    seen = sorted({name for pair in kept for name in pair})
    misfit = {order: _misfit(dict(zip(seen, order, strict=True)), typical, usual) for order in _orders(seen)}
    before = misfit[tuple(seen)]
    order = min(misfit, key=lambda o: misfit[o])
    if before < CHANGED_M or misfit[order] > EXPLAINED * before:
        return None
    renamed = dict(zip(seen, order, strict=True))
    return tuple(renamed.get(name, name) for name in names), before, misfit[order]


def _orders(names: Sequence[str]) -> Iterator[tuple[str, ...]]:
    if len(names) <= _EVERY_ORDER:
        yield from permutations(names)
        return
    yield tuple(names)
    for a, b in combinations(range(len(names)), 2):
        order = list(names)
        order[a], order[b] = order[b], order[a]
        yield tuple(order)


def _misfit(true: Mapping[str, str], typical: Shape, usual: Shape) -> float:
    """The largest difference of a distance from the usual one, m; infinite where one is not known."""
    worst = 0.0
    for (a, b), distance in typical.items():
        x, y = sorted((true[a], true[b]))
        if (x, y) not in usual:
            return float("inf")
        worst = max(worst, abs(distance - usual[x, y]))
    return worst
