"""Rearrangements under which a null hypothesis leaves curves alike, and the statistic of each.

Within a subject the labels of the conditions are exchanged, which holds where conditions scatter alike; for
a paired test these are the signs of the differences. All rearrangements are taken where they are few, else
a random sample with the observed one among it, which keeps the test valid (Phipson & Smyth 2010, Stat
Appl Genet Mol Biol 9:39). Statistics are computed for a batch of rearrangements at once.

Where a curve of a statistic passes its threshold, and how often chance would do the same.

A threshold is that of the largest statistic over all nodes, so the chance of any false finding along
the whole curve is at most alpha (Nichols & Holmes 2002, Hum Brain Mapp 15:1-25). A cluster is a run of
nodes at or beyond it, and its p is that of its mass, the sum of its statistics (Bullmore 1999, IEEE
Trans Med Imaging 18:32-42; Maris & Oostenveld 2007, J Neurosci Methods 164:177-190), against the
largest mass of every rearrangement.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import permutations
from math import factorial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.arrays import Array
from scaling_service.numerics.signals.filters import find_runs

_BATCH = 2**21
"""Numbers in the largest array of a batch (16 MB): chosen to stay near the processor's cache."""

_ALONE = 2**18
"""Multiplications in one matrix product. Chosen: so few run on one thread, where larger ones wait for
threads that other processes hold (measured: 20 times longer with three processes on two cores)."""

_CERTAIN = 1e-9
"""Share of the variation that is left to error at least. Chosen: it caps a statistic at t of some 10⁵
where conditions differ by a constant, so that division by rounding errors decides nothing."""

_NOTHING = 1e-12
"""Relative to the largest value: chosen. Curves this close at a node are one curve there: statistic 0."""

_TIE = 1e-7
"""Relative: chosen. Rearrangements that mirror each other give one value, but for rounding errors."""


@dataclass(frozen=True, slots=True, eq=False)
class Rearrangements:
    """Rearrangements of observations, the observed one first.

    ``items``: (n, n_subjects, n_conditions) of orders, or (n, n_subjects) of signs.
    ``exact``: whether these are all that can give different statistics, each once.
    """

    items: NDArray[np.int8]
    exact: bool


class Statistic(Protocol):
    """Curves of a statistic under rearrangements."""

    def __call__(self, items: NDArray[np.int8]) -> Array:
        """Shape (n, n_nodes) for a batch of n rearrangements."""
        ...


def draw_orders(n_subjects: int, n_conditions: int, most: int, rng: np.random.Generator) -> Rearrangements:
    """Orders of the conditions within each subject, at most ``most``.

    Renaming the conditions for all subjects alike changes no statistic, so one subject stands still
    where all orders are enumerated: (k!)^(n - 1) of them.
    """
    observed = np.arange(n_conditions, dtype=np.int8)
    total = factorial(n_conditions) ** (n_subjects - 1)
    if total <= most:
        each = np.array(list(permutations(range(n_conditions))), dtype=np.int8)
        chosen = np.array(np.unravel_index(np.arange(total), (len(each),) * (n_subjects - 1)))
        still = np.broadcast_to(observed, (total, 1, n_conditions))
        return Rearrangements(np.concatenate([still, each[chosen.T]], axis=1), exact=True)
    items = np.tile(observed, (most, n_subjects, 1))
    items[1:] = rng.permuted(items[1:], axis=2)
    return Rearrangements(items, exact=False)


def draw_signs(n_subjects: int, most: int, rng: np.random.Generator) -> Rearrangements:
    """Signs of each subject's difference, at most ``most``.

    Turning all signs changes no two-sided statistic, so one stands still where all are enumerated:
    2^(n - 1) of them.
    """
    total = 2 ** (n_subjects - 1)
    if total <= most:
        bits = np.arange(total)[:, None] >> np.arange(n_subjects) & 1
        return Rearrangements((1 - 2 * bits).astype(np.int8), exact=True)
    items = np.ones((most, n_subjects), dtype=np.int8)
    items[1:] -= 2 * rng.integers(0, 2, size=(most - 1, n_subjects), dtype=np.int8)
    return Rearrangements(items, exact=False)


class RepeatedMeasuresF:
    """F of a one-way analysis of variance with repeated measures, at every node.

    ``curves``: (n_subjects, n_conditions, n_nodes).

    Exchanging labels within subjects leaves the subjects' own sums of squares as they are, so only the
    conditions' sums have to be formed anew: one matrix product for a batch.
    """

    def __init__(self, curves: Array) -> None:
        self._n, self._k, self._nodes = curves.shape
        centred = curves - curves.mean(axis=1, keepdims=True)
        self._rows = centred.reshape(self._n * self._k, self._nodes)
        self._within = np.sum(self._rows**2, axis=0)
        self._void = self._within <= self._rows.shape[0] * (_NOTHING * np.abs(curves).max()) ** 2

    @property
    def degrees_of_freedom(self) -> tuple[int, int]:
        """Of the conditions and of the error, as under sphericity."""
        return self._k - 1, (self._n - 1) * (self._k - 1)

    def __call__(self, items: NDArray[np.int8]) -> Array:
        """F, shape (n, n_nodes), for orders (n, n_subjects, n_conditions)."""
        found = np.empty((len(items), self._nodes))
        size = self._k * max(self._n * self._k, self._nodes)
        for part in _split_batches(len(items), size):
            # What each condition's sum takes of the rows, (n, n_conditions, n_rows)
            choice = np.zeros((len(items[part]), self._k, self._n * self._k))
            taken = items[part] + self._k * np.arange(self._n)[:, None]
            np.put_along_axis(choice, taken.transpose(0, 2, 1), 1.0, axis=2)
            sums = _compute_products(choice, self._rows)
            between = np.einsum("bkq,bkq->bq", sums, sums) / self._n
            ratio: Array = _compute_ratio(between, self._within, self._void) * (self._n - 1)
            found[part] = ratio
        return found


class PairedT:
    """Student's t of paired differences, at every node.

    ``differences``: (n_subjects, n_nodes).
    ``scale``: the largest size of the curves subtracted; what is nothing beside it counts as no difference.
    """

    def __init__(self, differences: Array, scale: float) -> None:
        self._rows = differences
        self._within = np.sum(differences**2, axis=0)
        self._void = self._within <= len(differences) * (_NOTHING * scale) ** 2

    @property
    def degrees_of_freedom(self) -> tuple[int]:
        """Subjects less one."""
        return (len(self._rows) - 1,)

    def __call__(self, items: NDArray[np.int8]) -> Array:
        """t, shape (n, n_nodes), for signs of shape (n, n_subjects)."""
        n = len(self._rows)
        found = np.empty((len(items), self._rows.shape[1]))
        for part in _split_batches(len(items), self._rows.shape[1]):
            means = _compute_products(items[part, None].astype(np.float64), self._rows)[:, 0] / n
            squared = _compute_ratio(n * means**2, self._within, self._void) * (n - 1)
            found[part] = np.copysign(np.sqrt(squared), means)
        return found


def _compute_products(choices: Array, rows: Array) -> Array:
    """Sums of rows, shape (n, n_sums, n_nodes), for choices of shape (n, n_sums, n_rows)."""
    count, sums, length = choices.shape
    together = max(1, _ALONE // (sums * rows.size))
    whole = count - count % together
    grouped = choices[:whole].reshape(-1, together * sums, length) @ rows
    rest = choices[whole:] @ rows
    return np.concatenate([grouped.reshape(whole, sums, rows.shape[1]), rest])


def _compute_ratio(explained: Array, total: Array, void: NDArray[np.bool_]) -> Array:
    """Explained over unexplained variation; zero where there is none at all."""
    left = np.maximum(total - explained, _CERTAIN * total)
    return np.divide(explained, left, out=np.zeros_like(explained), where=~void & (left > 0.0))


def _split_batches(count: int, size: int) -> Iterator[slice]:
    step = max(1, _BATCH // size)
    return (slice(start, start + step) for start in range(0, count, step))


@dataclass(frozen=True, slots=True, kw_only=True)
class Cluster:
    """A stretch of the cycle in which conditions differ.

    ``start``, ``end`` (% of the cycle): where the curve, taken as straight between nodes, crosses the
        threshold.
    ``peak``: the statistic furthest from zero, with its sign.
    ``peak_at``: % of the cycle.
    ``mass``: sum over the cluster's nodes of the statistic's size.
    ``p``: share of rearrangements with a cluster at least as massive, anywhere.
    ``p_peak``: share of rearrangements whose statistic reaches the peak's size anywhere.
    """

    start: float
    end: float
    peak: float
    peak_at: float
    mass: float
    p: float
    p_peak: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CurveTest:
    """A statistic along the cycle, with its threshold and clusters.

    ``kind`` ('F' or 't'): a t is two-tailed.
    ``statistic``: (n_nodes,).
    ``alpha``: of this test, after any correction for several tests.
    ``threshold``: sizes at or beyond it differ; infinite where no outcome could be significant.
    ``p``: of the largest statistic on the curve.
    ``rearrangements``: how many were compared, the observed one included; ``exact`` where these are all.
    """

    kind: str
    statistic: Array
    degrees_of_freedom: tuple[int, ...]
    alpha: float
    threshold: float
    clusters: tuple[Cluster, ...]
    p: float
    rearrangements: int
    exact: bool

    @property
    def significant(self) -> bool:
        """Whether the curve reaches its threshold anywhere."""
        return bool(self.clusters)

    @property
    def spans(self) -> list[tuple[float, float]]:
        """Start and end of each cluster, % of the cycle."""
        return [(cluster.start, cluster.end) for cluster in self.clusters]

    @property
    def smallest_p(self) -> float:
        """The smallest p that this many subjects and rearrangements can give."""
        return 1.0 / self.rearrangements

    @property
    def can_decide(self) -> bool:
        """Whether any outcome could be significant; else there are too few subjects for ``alpha``."""
        return self.smallest_p <= self.alpha * (1.0 + _TIE)


def assess_curve(
    kind: str,
    statistic: Statistic,
    degrees_of_freedom: tuple[int, ...],
    rearranged: Rearrangements,
    alpha: float,
) -> CurveTest:
    """Test a statistic along the cycle against its rearrangements."""
    maxima = np.abs(statistic(rearranged.items)).max(axis=1)
    observed = statistic(rearranged.items[:1])[0]
    threshold = find_critical_value(maxima, alpha)
    reaching = rearranged.items[maxima >= threshold * (1.0 - _TIE)]
    masses = np.zeros(len(maxima))
    if len(reaching):
        masses[: len(reaching)] = find_largest_masses(statistic(reaching), threshold)
    found = [
        _cluster(observed, sign, first, stop - 1, threshold, masses, maxima)
        for sign in (1.0, -1.0)
        for first, stop in find_runs(sign * observed >= threshold * (1.0 - _TIE)).tolist()
    ]
    return CurveTest(
        kind=kind,
        statistic=observed,
        degrees_of_freedom=degrees_of_freedom,
        alpha=alpha,
        threshold=threshold,
        clusters=tuple(sorted(found, key=lambda cluster: cluster.start)),
        p=share_reaching(maxima, float(np.abs(observed).max())),
        rearrangements=len(maxima),
        exact=rearranged.exact,
    )


def find_critical_value(maxima: Array, alpha: float) -> float:
    """The smallest of the values that no more than a share alpha of them reach; infinite if none.

    ``maxima``: (n,), not negative.
    """
    ordered = np.sort(maxima)
    below = np.searchsorted(ordered, ordered * (1.0 - _TIE), side="left")
    rare = ordered[len(ordered) - below <= alpha * len(ordered) * (1.0 + _TIE)]
    return float(rare[0]) if len(rare) else float("inf")


def share_reaching(values: Array, size: float) -> float:
    """The share of values at or above a size, ties included."""
    return float(np.mean(values >= size * (1.0 - _TIE)))


def find_largest_masses(curves: Array, threshold: float) -> Array:
    """The mass of each curve's largest cluster, either sign, shape (n,); zero where there is none.

    ``curves``: (n, n_nodes).
    """
    both = np.concatenate([curves, -curves])
    reached = both >= threshold * (1.0 - _TIE)
    # A column of nothing ends every row, so that no run passes from one row into the next.
    sizes = np.pad(np.where(reached, both, 0.0), ((0, 0), (0, 1))).ravel()
    inside = np.pad(reached, ((0, 0), (0, 1))).ravel()
    starts = np.flatnonzero(inside & ~np.concatenate([[False], inside[:-1]]))
    largest = np.zeros(len(both))
    if len(starts):
        # What lies between two runs is zero, so a sum up to the next start is the run's own.
        np.maximum.at(largest, starts // (curves.shape[1] + 1), np.add.reduceat(sizes, starts))
    return np.asarray(largest.reshape(2, -1).max(axis=0))


def _cluster(
    observed: Array, sign: float, first: int, last: int, threshold: float, masses: Array, maxima: Array
) -> Cluster:
    curve = sign * observed
    step = 100.0 / (len(curve) - 1)
    mass = float(curve[first : last + 1].sum())
    at = first + int(np.argmax(curve[first : last + 1]))
    return Cluster(
        start=step * _interpolate_crossing(curve, first, first - 1, threshold),
        end=step * _interpolate_crossing(curve, last, last + 1, threshold),
        peak=float(observed[at]),
        peak_at=step * at,
        mass=mass,
        p=share_reaching(masses, mass),
        p_peak=share_reaching(maxima, float(curve[at])),
    )


def _interpolate_crossing(curve: Array, inside: int, outside: int, threshold: float) -> float:
    """Where, in nodes, the curve passes the threshold between two neighbours; its end at the border."""
    if not 0 <= outside < len(curve):
        return float(inside)
    height = max(float(curve[inside]) - threshold, 0.0)
    return inside + (outside - inside) * height / float(curve[inside] - curve[outside])
