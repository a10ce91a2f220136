"""Thresholds, clusters and their masses, by hand."""

from __future__ import annotations

from itertools import groupby

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scaling_service.numerics.statistics.permutation_tests import (
    Rearrangements,
    assess_curve,
    find_critical_value,
    find_largest_masses,
)
from scaling_service.numerics.statistics.waveforms import compare_paired
from tests.evaluation.curves import NODES, bump, smooth


def test_a_straight_edge_is_crossed_where_it_is() -> None:
    """Curves of known heights: threshold, ends, masses and p follow by hand."""
    curve = np.zeros(101)
    curve[20:31] = 5.0 - np.abs(np.arange(-5.0, 6.0))
    curve[90:] = -np.arange(11.0)
    heights = np.array([0.0, 3.5, 20.0, 4.0, *np.linspace(0.1, 3.0, 28)])

    def statistic(items: np.ndarray) -> np.ndarray:
        which = items[:, 0]
        return np.where(which[:, None] == 0, curve, heights[which, None] * (NODES == 50))

    which = Rearrangements(np.arange(32, dtype=np.int8)[:, None], exact=True)
    found = assess_curve("t", statistic, (5,), which, alpha=0.13)
    assert found.threshold == 3.5  # four of 32 reach it
    assert found.p == 2 / 32  # 10 and 20
    hill, slope = found.clusters
    assert (hill.start, hill.end, hill.peak, hill.peak_at, hill.mass) == (23.5, 26.5, 5.0, 25.0, 13.0)
    assert (slope.start, slope.end, slope.peak, slope.peak_at, slope.mass) == (
        93.5,
        100.0,
        -10.0,
        100.0,
        49.0,
    )
    assert (hill.p, hill.p_peak) == (2 / 32, 2 / 32)  # masses 49, 20, 4, 3.5; peaks 10, 20, 4, 3.5
    assert (slope.p, slope.p_peak) == (1 / 32, 2 / 32)
    same = assess_curve("t", lambda items: np.tile(curve, (len(items), 1)), (5,), which, alpha=0.5)
    assert (same.threshold, same.p, same.clusters) == (np.inf, 1.0, ())


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=50)
def test_ends_of_clusters_lie_on_the_threshold(seed: int) -> None:
    rng = np.random.default_rng(seed)
    first, second = smooth(rng, 8) + 1.5 * bump(40), smooth(rng, 8) + 1.5 * bump(90)
    found = compare_paired(first, second, rng)
    for cluster in found.clusters:
        for end in (cluster.start, cluster.end):
            height = np.interp(end, NODES, found.statistic) * np.sign(cluster.peak)
            if 0.0 < end < 100.0:
                assert height == pytest.approx(found.threshold, rel=1e-6)
            else:
                assert height >= found.threshold * (1 - 1e-6)
        assert cluster.start <= cluster.peak_at <= cluster.end
        assert 1 / 128 <= cluster.p <= 0.05
        assert cluster.p_peak <= 0.05
        assert found.statistic[int(cluster.peak_at)] == cluster.peak
    assert found.significant == (found.p <= found.alpha)


@given(st.integers(0, 2**32 - 1), st.floats(0.5, 4.0))
def test_masses_are_sums_of_runs(seed: int, threshold: float) -> None:
    curves = np.random.default_rng(seed).normal(scale=2.0, size=(6, 15))

    def by_hand(curve: np.ndarray) -> float:
        sums = [
            abs(sum(run))
            for sign, run in (
                (s, list(r)) for s, r in groupby(curve, lambda v: np.sign(v) * (abs(v) >= threshold))
            )
            if sign
        ]
        return max(sums, default=0.0)

    np.testing.assert_allclose(
        find_largest_masses(curves, threshold), [by_hand(c) for c in curves], rtol=1e-12
    )


@given(st.lists(st.integers(0, 12), min_size=1, max_size=60), st.floats(0.01, 0.99))
def test_a_threshold_is_the_smallest_rare_value(maxima: list[int], alpha: float) -> None:
    values = np.array(maxima, dtype=float)
    found = find_critical_value(values, alpha)
    shares = {v: np.mean(values >= v) for v in values}
    rare = [v for v, share in shares.items() if share <= alpha + 1e-9]
    assert found == min(rare, default=np.inf)
