"""Friedman's test and Tukey's HSD on ranks against published examples and independent computations."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import friedmanchisquare, norm

from scaling_service.capabilities.cohort.groups import compare_groups
from scaling_service.capabilities.cohort.result import FriedmanEntry
from scaling_service.numerics.statistics.complete import ComparisonImpossible, ValueMissing

# Hollander & Wolfe 1999, table 7.1: times (s) of 22 players rounding first base in three ways.
TIMES = """
5.40 5.85 5.20 5.55 5.90 5.45 5.40 5.45 5.25 5.85 5.25 5.65 5.60 5.05 5.50 5.45 5.55 5.45 5.50 5.65 5.70 6.30
5.50 5.70 5.60 5.50 5.85 5.55 5.40 5.50 5.15 5.80 5.20 5.55 5.35 5.00 5.50 5.55 5.55 5.50 5.45 5.60 5.65 6.30
5.55 5.75 5.50 5.40 5.70 5.60 5.35 5.35 5.00 5.70 5.10 5.45 5.45 4.95 5.40 5.50 5.35 5.55 5.25 5.40 5.55 6.25
"""
WAYS = ("round out", "narrow angle", "wide angle")


def compared(table: np.ndarray, **options: float) -> FriedmanEntry:
    n, k = table.shape
    names = [f"S{i}" for i in range(n)], [f"M{i}" for i in range(k)]
    return compare_groups(table, *names, quantity="femur_r", **options)


def test_rounding_first_base() -> None:
    table = np.array([line.split() for line in TIMES.strip().splitlines()], dtype=float).T
    found = compare_groups(table, [str(i) for i in range(22)], WAYS, quantity="time")
    # R's friedman.test on these data prints 11.143 and 0.003805.
    assert found.chi_square == pytest.approx(11.143, abs=5e-4)
    assert found.p == pytest.approx(0.003805, abs=5e-7)
    # Published output of R's coin, Wilcoxon-Nemenyi-McDonald-Thompson test, whose multivariate normal
    # integral is good to some 2e-4.
    assert found.pair("narrow angle", "round out").p == pytest.approx(0.623939296, abs=2e-4)
    assert found.pair("wide angle", "round out").p == pytest.approx(0.003534336, abs=2e-4)
    assert found.pair("wide angle", "narrow angle").p == pytest.approx(0.053774441, abs=2e-4)
    assert [p.significant for p in found.pairs] == [False, True, False]


def mean_ranks(table: np.ndarray) -> np.ndarray:
    """Of tables without ties."""
    return (table.argsort(axis=1).argsort(axis=1) + 1).mean(axis=0)


def test_critical_difference_of_a_published_table() -> None:
    """Demšar 2006 (J Mach Learn Res 7:1-30, section 3.2.2): 4 classifiers, 14 data sets, no ties assumed."""
    rng, seen = np.random.default_rng(1), set()
    for _ in range(60):
        ranks = rng.permuted(np.tile([1.0, 2.0, 3.0, 4.0], (14, 1)), axis=1)
        means = ranks.mean(axis=0)
        for pair in compared(ranks).pairs:
            first, second = (int(name[1]) for name in pair.methods)
            apart = abs(means[first] - means[second])
            for alpha, critical in ((0.05, 1.25), (0.10, 1.12)):
                if abs(apart - critical) > 0.005:
                    assert (pair.p < alpha) == (apart > critical)
                    seen.add((alpha, apart > critical))
    assert len(seen) == 4


def test_pairs_follow_the_range_of_normal_variables() -> None:
    table = np.random.default_rng(2).normal(size=(12, 5)) + np.arange(5) / 2
    means, error = mean_ranks(table), np.sqrt(5 * 6 / 12 / 12)
    for pair in compared(table).pairs:
        first, second = (int(name[1]) for name in pair.methods)
        q = abs(means[first] - means[second]) / error
        below = quad(lambda x, q=q: norm.pdf(x) * (norm.cdf(x) - norm.cdf(x - q)) ** 4, -9, 9 + q)
        assert pair.p == pytest.approx(1 - 5 * below[0], abs=1e-7)


@given(st.integers(3, 6), st.integers(3, 30), st.integers(0, 2**32 - 1))
def test_friedman_agrees_with_scipy(k: int, n: int, seed: int) -> None:
    table = np.random.default_rng(seed).integers(0, 6, size=(n, k)).astype(float)
    if (np.ptp(table, axis=1) == 0).all():
        return
    found, peer = compared(table), friedmanchisquare(*table.T)
    assert found.chi_square == pytest.approx(peer.statistic, abs=1e-9)
    assert found.p == pytest.approx(peer.pvalue, abs=1e-12)
    assert 0.0 <= found.kendall_w <= 1.0 + 1e-12


def test_perfect_agreement_has_effect_one() -> None:
    table = np.arange(10.0)[:, None] + np.array([0.0, 0.1, 0.2, 0.3])
    found = compared(table)
    assert found.kendall_w == pytest.approx(1.0)
    pair = found.pair("M0", "M3")
    assert pair.difference_mean == pytest.approx(-0.3)
    assert pair.difference_sd == pytest.approx(0.0, abs=1e-12)


def test_the_same_length_by_two_routes_is_a_tie() -> None:
    rng = np.random.default_rng(4)
    table = 0.43 + 0.02 * rng.normal(size=(26, 3))
    same = np.column_stack([table, table[:, 0] + 1e-15 * rng.normal(size=26)])
    exact = np.column_stack([table, table[:, 0]])
    assert compared(same).chi_square == compared(exact).chi_square
    assert compared(same).pair("M0", "M3").p == 1.0


def test_methods_that_never_differ() -> None:
    found = compared(np.tile(np.arange(5.0)[:, None], (1, 3)))
    assert (found.chi_square, found.p, found.kendall_w) == (0, 1, 0)
    assert not found.significant
    assert {pair.p for pair in found.pairs} == {1.0}
    assert compared(np.zeros((5, 3))).p == 1.0


def test_pairs_are_gated_by_friedman() -> None:
    for seed in range(500):
        found = compared(np.random.default_rng(seed).normal(size=(26, 5)))
        if any(pair.p < 0.05 for pair in found.pairs) and found.p >= 0.05:
            assert not any(pair.significant for pair in found.pairs)
            return
    pytest.fail("no cohort in which only a pair is significant")


def test_all_pairs_once_in_either_order() -> None:
    found = compared(np.random.default_rng(5).normal(size=(9, 4)))
    assert [p.methods for p in found.pairs] == list(combinations(("M0", "M1", "M2", "M3"), 2))
    assert found.pair("M1", "M0") is found.pair("M0", "M1")


def test_what_is_missing_is_named() -> None:
    table = np.arange(8.0).reshape(4, 2)
    table[2, 1] = np.nan
    with pytest.raises(ValueMissing, match="no finite value at subject 'S2', method 'M1'"):
        compared(table)


def test_too_little_or_unlike() -> None:
    with pytest.raises(ComparisonImpossible, match="at least two subjects"):
        compared(np.ones((1, 3)))
    with pytest.raises(ComparisonImpossible, match="at least two methods"):
        compared(np.ones((4, 1)))
    with pytest.raises(ComparisonImpossible, match="two methods are called 'MB'"):
        compare_groups(np.ones((2, 2)), ("a", "b"), ("MB", "MB"), quantity="femur_r")
    with pytest.raises(ComparisonImpossible, match="do not fit"):
        compare_groups(np.ones((3, 2)), ("a", "b"), ("MB", "EB"), quantity="femur_r")
    with pytest.raises(ComparisonImpossible, match="between 0 and 1"):
        compared(np.ones((4, 3)), alpha=5.0)
