"""Where a curve of a statistic passes its threshold, and how often chance would do the same.

A threshold is that of the largest statistic over all nodes, so the chance of any false finding along
the whole curve is at most alpha (Nichols & Holmes 2002, Hum Brain Mapp 15:1-25). A cluster is a run of
nodes at or beyond it, and its p is that of its mass, the sum of its statistics (Bullmore 1999, IEEE
Trans Med Imaging 18:32-42; Maris & Oostenveld 2007, J Neurosci Methods 164:177-190), against the
largest mass of every rearrangement.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.statistics.permutations import Rearrangements, Statistic

_TIE = 1e-7
"""Relative: chosen. Rearrangements that mirror each other give one value, but for rounding errors."""


@dataclass(frozen=True, slots=True)
class Cluster:
    """A stretch of the cycle in which conditions differ.

    Parameters
    ----------
    start, end : float, % of the cycle
        Where the curve, taken as straight between nodes, crosses the threshold.
    peak : float
        The statistic furthest from zero, with its sign.
    peak_at : float, % of the cycle
    mass : float
        Sum over the cluster's nodes of the statistic's size.
    p : float
        Share of rearrangements with a cluster at least as massive, anywhere.
    p_peak : float
        Share of rearrangements whose statistic reaches the peak's size anywhere.
    """

    start: float
    end: float
    peak: float
    peak_at: float
    mass: float
    p: float
    p_peak: float


@dataclass(frozen=True, slots=True, eq=False)
class CurveTest:
    """A statistic along the cycle, with its threshold and clusters.

    Parameters
    ----------
    kind : 'F' or 't'
        A t is two-tailed.
    statistic : ndarray, shape (n_nodes,)
    degrees_of_freedom : tuple of int
    alpha : float
        Of this test, after any correction for several tests.
    threshold : float
        Sizes at or beyond it differ; infinite where no outcome could be significant.
    clusters : tuple of Cluster
    p : float
        Of the largest statistic on the curve.
    rearrangements : int
        How many were compared, the observed one included; ``exact`` where these are all.
    exact : bool
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
    def smallest_p(self) -> float:
        """The smallest p that this many subjects and rearrangements can give."""
        return 1.0 / self.rearrangements

    @property
    def can_decide(self) -> bool:
        """Whether any outcome could be significant; else there are too few subjects for ``alpha``."""
        return self.smallest_p <= self.alpha * (1.0 + _TIE)


def curve_test(
    kind: str,
    statistic: Statistic,
    degrees_of_freedom: tuple[int, ...],
    rearranged: Rearrangements,
    alpha: float,
) -> CurveTest:
    """Test a statistic along the cycle against its rearrangements."""
    maxima = np.abs(statistic(rearranged.items)).max(axis=1)
    observed = statistic(rearranged.items[:1])[0]
    threshold = critical_value(maxima, alpha)
    reaching = rearranged.items[maxima >= threshold * (1.0 - _TIE)]
    masses = np.zeros(len(maxima))
    if len(reaching):
        masses[: len(reaching)] = largest_masses(statistic(reaching), threshold)
    return CurveTest(
        kind=kind,
        statistic=observed,
        degrees_of_freedom=degrees_of_freedom,
        alpha=alpha,
        threshold=threshold,
        clusters=_clusters(observed, threshold, masses, maxima),
        p=share_reaching(maxima, float(np.abs(observed).max())),
        rearrangements=len(maxima),
        exact=rearranged.exact,
    )


def critical_value(maxima: Array, alpha: float) -> float:
    """The smallest of the values that no more than a share alpha of them reach; infinite if none.

    Parameters
    ----------
    maxima : ndarray, shape (n,), not negative
    """
    ordered = np.sort(maxima)
    below = np.searchsorted(ordered, ordered * (1.0 - _TIE), side="left")
    rare = ordered[len(ordered) - below <= alpha * len(ordered) * (1.0 + _TIE)]
    return float(rare[0]) if len(rare) else float("inf")


def share_reaching(values: Array, size: float) -> float:
    """The share of values at or above a size, ties included."""
    return float(np.mean(values >= size * (1.0 - _TIE)))


def largest_masses(curves: Array, threshold: float) -> Array:
    """The mass of each curve's largest cluster, either sign, shape (n,); zero where there is none.

    Parameters
    ----------
    curves : ndarray, shape (n, n_nodes)
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
    found: Array = largest.reshape(2, -1).max(axis=0)
    return found


def _clusters(observed: Array, threshold: float, masses: Array, maxima: Array) -> tuple[Cluster, ...]:
    found = [
        _cluster(observed, sign, first, last, threshold, masses, maxima)
        for sign in (1.0, -1.0)
        for first, last in _runs(sign * observed, threshold)
    ]
    return tuple(sorted(found, key=lambda cluster: cluster.start))


def _runs(curve: Array, threshold: float) -> list[tuple[int, int]]:
    """First and last node of each run at or above the threshold."""
    inside = np.pad(curve >= threshold * (1.0 - _TIE), 1).astype(np.int8)
    change = np.diff(inside)
    return list(
        zip(np.flatnonzero(change == 1).tolist(), (np.flatnonzero(change == -1) - 1).tolist(), strict=True)
    )


def _cluster(
    observed: Array, sign: float, first: int, last: int, threshold: float, masses: Array, maxima: Array
) -> Cluster:
    curve = sign * observed
    step = 100.0 / (len(curve) - 1)
    mass = float(curve[first : last + 1].sum())
    at = first + int(np.argmax(curve[first : last + 1]))
    return Cluster(
        start=step * _crossing(curve, first, first - 1, threshold),
        end=step * _crossing(curve, last, last + 1, threshold),
        peak=float(observed[at]),
        peak_at=step * at,
        mass=mass,
        p=share_reaching(masses, mass),
        p_peak=share_reaching(maxima, float(curve[at])),
    )


def _crossing(curve: Array, inside: int, outside: int, threshold: float) -> float:
    """Where, in nodes, the curve passes the threshold between two neighbours; its end at the border."""
    if not 0 <= outside < len(curve):
        return float(inside)
    height = max(float(curve[inside]) - threshold, 0.0)
    return inside + (outside - inside) * height / float(curve[inside] - curve[outside])
