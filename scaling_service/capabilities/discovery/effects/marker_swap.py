"""Two labels that changed places for a while."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.discovery.effects.catalogue import Effect
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Estimate, Exchange
from scaling_service.capabilities.discovery.laws.spots import Generators
from scaling_service.capabilities.discovery.observations.tracked import MotionFit
from scaling_service.capabilities.discovery.ordinary import sums
from scaling_service.capabilities.discovery.ordinary.body import make_clusters
from scaling_service.numerics.multibody.laws import Array

_PLACE_M = 0.015  # of a marker's place along an axis, whatever model it is (see ``ordinary.body``)
_RIVALS = 3  # pairs: what a body that is turned to fit them takes for exchanged is among them (chosen)
_JUMP_M, _NEARER = 0.02, 0.4
"""By what a marker leaves its course where labels change, and how much nearer the other's course is (chosen:
20 mm between two frames is 2 m/s at 100 Hz beside what the marker has)."""

_CHUNK = 64  # frames at once
_RIDGE = 1e-9  # of a pose's own curvature, so that a frame may leave a direction open
KIND = "marker_swap"


def find_exchanges(item: MotionFit) -> list[tuple[float, Candidate]]:
    """The likeliest exchanges of two labels in a recording, with their log odds.

    With ``R`` what the residuals y of a frame weigh once the pose took what it likes, exchanging two markers
    moves them by d and -d, which takes ``-2 d'Ry - d'Rd`` off ``y'Ry``. Skin counts with all its size, and
    markers' places with what the generic model leaves of them.
    """
    pairs = list(combinations(range(len(item.markers)), 2))
    if not pairs:
        return []
    first, second = np.array(pairs, dtype=np.intp).T
    covariance = _PLACE_M**2 * np.eye(3 * len(item.markers))
    for cluster in make_clusters(item, share=1.0):
        covariance[np.ix_(cluster.numbers, cluster.numbers)] += cluster.covariance
    generators = Generators.of(item, ())
    gains = np.concatenate(
        [_gain(item, generators, covariance, rows, first, second) for rows in item.chunks(_CHUNK)]
    )
    spans = [sums.find_best_span(gains[:, k]) for k in range(len(pairs))]
    weight = sums.weigh_frames(item, item.step)
    edges = 2.0 * math.log(max(weight * len(gains), 1.0))
    found = []

    def make(k: int, rows: slice) -> Candidate:
        names = (item.markers[pairs[k][0]], item.markers[pairs[k][1]])
        exchange = Exchange(*names, float(item.times[rows.start]), float(item.times[rows.stop - 1]))
        return Candidate(kind=KIND, where=names, columns=(), trials=(item.name,), change=exchange)

    for k in sorted(range(len(pairs)), key=lambda n: -spans[n][0])[:_RIVALS]:
        gain, rows = spans[k]
        if gain > 0.0:
            found.append((0.5 * weight * gain - math.log(len(pairs)) - edges, make(k, rows)))
    if found:  # a body that turned round to fit an exchange does not see it any more
        found += [(found[0][0], make(k, rows)) for k, rows in _follow_jumps(item, first, second)]
    return found


def _follow_jumps(
    item: MotionFit, first: NDArray[np.intp], second: NDArray[np.intp]
) -> Iterator[tuple[int, slice]]:
    """Pairs that change places from one frame to the next, by continuity, and from when to when."""
    x = item.task.measured
    ahead = np.full_like(x, np.nan)
    ahead[2:] = 2.0 * x[1:-1] - x[:-2]

    def measure(a: NDArray[np.intp], b: NDArray[np.intp]) -> Array:
        return np.asarray(np.square(x[:, a] - ahead[:, b]).sum(axis=2))

    stay, change = (measure(first, p) + measure(second, q) for p, q in ((first, second), (second, first)))
    jumps = (change < _NEARER * stay) & (stay > 2.0 * _JUMP_M**2)
    for k in np.flatnonzero(jumps.any(axis=0)).tolist():
        at = [*np.flatnonzero(jumps[:, k]).tolist(), len(x)]
        yield k, slice(at[0], at[1])


def _gain(
    item: MotionFit,
    generators: Generators,
    covariance: Array,
    rows: slice,
    a: NDArray[np.intp],
    b: NDArray[np.intp],
) -> Array:
    """What exchanging each pair takes off in some frames, (n, n_pairs)."""
    gap, pose, _ = generators.at(item, rows)
    axes, seen = sums.place_in_segments(item, rows), item.seen[rows]
    gap, pose = sums.turn_vectors(axes, gap), sums.turn_vectors(axes, pose)
    n, count = seen.shape
    R = np.zeros((n, 3 * count, 3 * count))
    for at, here in sums.list_patterns(seen):
        R[np.ix_(here, at, at)] = np.linalg.inv(covariance[np.ix_(at, at)])
    shown = np.matmul(pose, R)
    bend = np.matmul(shown, pose.transpose(0, 2, 1))
    whole = np.trace(bend, axis1=1, axis2=2)
    loose = np.where(whole > 0.0, _RIDGE * whole, 1.0)  # a frame without markers says nothing
    bend += loose[:, None, None] * np.eye(pose.shape[1])
    R -= np.matmul(shown.transpose(0, 2, 1), np.linalg.solve(bend, shown))
    pull = np.matmul(R, gap[:, :, None]).reshape(n, count, 3)
    blocks = R.reshape(n, count, 3, count, 3)
    measured = item.task.measured[rows]
    apart = np.nan_to_num(measured[:, b] - measured[:, a])[..., None]
    of_a, of_b = np.matmul(axes[:, a], apart)[..., 0], -np.matmul(axes[:, b], apart)[..., 0]
    slope = (pull[:, a] * of_a).sum(axis=2) + (pull[:, b] * of_b).sum(axis=2)
    size = np.zeros(slope.shape)
    for times, (i, left), (j, right) in (
        (1.0, (a, of_a), (a, of_a)),
        (1.0, (b, of_b), (b, of_b)),
        (2.0, (a, of_a), (b, of_b)),
    ):
        block = blocks[:, i, :, j].transpose(1, 0, 2, 3)
        size += times * np.einsum("npi,npij,npj->np", left, block, right, optimize=True)
    return np.where(seen[:, a] & seen[:, b], -2.0 * slope - size, 0.0)


def _describe_swap(effect: Estimate, _after: Fit) -> Mapping[str, float]:
    """From when to when."""
    exchange = effect.candidate.change
    assert isinstance(exchange, Exchange)
    return {"start_s": exchange.start_s, "end_s": exchange.end_s}


EFFECTS = (
    Effect(
        kind=KIND, meaning="two labels are exchanged for a while", details=_describe_swap, of_recording=True
    ),
)
