"""Permutation tests of curves against spm1d's random field theory."""

from __future__ import annotations

import sys
import time
import warnings
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from scaling_service.numerics.statistics.permutation_tests import CurveTest
from scaling_service.numerics.statistics.waveforms import analyse_repeated_measures, compare_paired
from tests.evaluation.curves import bump, smooth


def peer_anova(spm1d: ModuleType, values: np.ndarray) -> Any:
    n, k, q = values.shape
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # one observation per cell: it says that residuals are approximate
        test = spm1d.stats.anova1rm(
            values.reshape(n * k, q), np.tile(np.arange(k), n), np.repeat(np.arange(n), k)
        )
        return test.inference(0.05)


def assert_agree(ours: CurveTest, peer: Any) -> None:
    """Statistic to rounding, threshold within 5 %, clusters' ends within 1 % of the cycle."""
    np.testing.assert_allclose(ours.statistic, peer.z, rtol=1e-8, atol=1e-10)
    assert ours.threshold == pytest.approx(peer.zstar, rel=0.05)
    theirs = sorted(cluster.endpoints for cluster in peer.clusters)
    assert len(theirs) == len(ours.clusters)
    for (start, end), cluster in zip(theirs, ours.clusters, strict=True):
        assert cluster.start == pytest.approx(start, abs=1.0)
        assert cluster.end == pytest.approx(end, abs=1.0)


@pytest.mark.parametrize("amplitude", [0.0, 1.6, 2.5])
@pytest.mark.parametrize("seed", range(3))
def test_agrees_with_random_field_theory(seed: int, amplitude: float) -> None:
    """Smooth normal curves of 26 subjects, five methods, two of which differ in places."""
    spm1d = pytest.importorskip("spm1d")
    rng = np.random.default_rng([21, seed])
    values = smooth(rng, 26, 5) + 2.0 * smooth(rng, 26, 1)
    values[:, 0] += amplitude * bump(30)
    values[:, 3] -= amplitude * bump(75)
    assert_agree(analyse_repeated_measures(values, rng), peer_anova(spm1d, values))
    first, second = values[:, 0], values[:, 3]
    peer = spm1d.stats.ttest_paired(first, second).inference(0.05, two_tailed=True)
    assert_agree(compare_paired(first, second, rng), peer)


@pytest.mark.benchmark
def test_thresholds_against_spm1d_at_length() -> None:
    """Mean and largest relative difference from the peer's thresholds, and the time of both."""
    spm1d = pytest.importorskip("spm1d")
    gaps, seconds = [], np.zeros(2)
    for i in range(100):
        rng = np.random.default_rng([23, i])
        values = smooth(rng, 26, 5) + 2.0 * smooth(rng, 26, 1)
        clock = time.perf_counter()
        f, t = analyse_repeated_measures(values, rng), compare_paired(values[:, 0], values[:, 1], rng)
        seconds[0] += time.perf_counter() - clock
        clock = time.perf_counter()
        peer_f = peer_anova(spm1d, values)
        peer_t = spm1d.stats.ttest_paired(values[:, 0], values[:, 1]).inference(0.05, two_tailed=True)
        seconds[1] += time.perf_counter() - clock
        gaps.append((f.threshold / peer_f.zstar - 1, t.threshold / peer_t.zstar - 1))
    mean, largest = np.mean(gaps, axis=0), np.abs(gaps).max(axis=0)
    sys.stdout.write(
        f"\nmean F {mean[0]:+.4f} t {mean[1]:+.4f}, largest F {largest[0]:.4f} t {largest[1]:.4f}\n"
        f"ours {seconds[0]:.1f} s, spm1d {seconds[1]:.1f} s\n"
    )
    assert np.abs(mean).max() < 0.01
    assert largest.max() < 0.06
