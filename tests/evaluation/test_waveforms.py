"""Statistical parametric mapping by permutation: closed forms, enumeration by hand, and spm1d."""

from __future__ import annotations

import time
import warnings
from itertools import groupby, permutations, product
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter1d
from scipy.stats import ttest_rel

from scaling_service.evaluation.complete import ComparisonImpossible, ValueMissing
from scaling_service.evaluation.cycles import Curves
from scaling_service.evaluation.permutations import PairedT, Rearrangements, RepeatedMeasuresF, orders, signs
from scaling_service.evaluation.waveform_clusters import (
    CurveTest,
    critical_value,
    curve_test,
    largest_masses,
)
from scaling_service.evaluation.waveforms import (
    WaveformSettings,
    compare_waveforms,
    paired_t_test,
    repeated_measures_anova,
)

NODES = np.arange(101)


def smooth(rng: np.random.Generator, *shape: int, fwhm: float = 20.0) -> np.ndarray:
    """Gaussian curves of unit variance on 101 nodes, smooth over ``fwhm`` nodes as joint angles are."""
    sd, margin = fwhm / 2.3548, 60
    raw = gaussian_filter1d(rng.normal(size=(*shape, 101 + 2 * margin)), sd, axis=-1)
    return raw[..., margin:-margin] * np.sqrt(2 * np.sqrt(np.pi) * sd)


def bump(centre: float, width: float = 9.0) -> np.ndarray:
    return np.exp(-0.5 * ((NODES - centre) / width) ** 2)


def named(values: np.ndarray) -> Curves:
    n, k, _ = values.shape
    return Curves("knee", tuple(f"S{i}" for i in range(n)), tuple(f"M{i}" for i in range(k)), values)


def f_by_regression(values: np.ndarray) -> np.ndarray:
    """F at every node from two least-squares fits: subjects alone, subjects and conditions."""
    n, k, q = values.shape
    subject = np.repeat(np.eye(n), k, axis=0)
    condition = np.tile(np.eye(k), (n, 1))
    y = values.reshape(n * k, q)

    def left(design: np.ndarray) -> np.ndarray:
        return np.sum((y - design @ np.linalg.lstsq(design, y, rcond=None)[0]) ** 2, axis=0)

    small, full = left(subject), left(np.hstack([subject, condition]))
    return (small - full) / (k - 1) / (full / ((n - 1) * (k - 1)))


def observed(n: int, k: int) -> np.ndarray:
    return np.tile(np.arange(k, dtype=np.int8), (1, n, 1))


@pytest.mark.parametrize(("n", "k"), [(2, 2), (6, 5), (26, 5), (7, 3)])
def test_f_is_that_of_two_regressions(n: int, k: int) -> None:
    values = np.random.default_rng(1).normal(size=(n, k, 13)) + np.arange(k)[:, None] / 2
    np.testing.assert_allclose(
        RepeatedMeasuresF(values)(observed(n, k))[0], f_by_regression(values), rtol=1e-9
    )


def test_t_is_scipys_and_its_square_is_f() -> None:
    values = np.random.default_rng(2).normal(size=(9, 2, 13))
    t = PairedT(values[:, 0] - values[:, 1], 1.0)(np.ones((1, 9), dtype=np.int8))[0]
    np.testing.assert_allclose(t, ttest_rel(values[:, 0], values[:, 1], axis=0).statistic, rtol=1e-12)
    np.testing.assert_allclose(RepeatedMeasuresF(values)(observed(9, 2))[0], t**2, rtol=1e-9)


def test_statistics_of_a_batch_are_those_of_rearranged_data() -> None:
    values = np.random.default_rng(3).normal(size=(5, 3, 7))
    some = orders(5, 3, 40, np.random.default_rng(4)).items
    found = RepeatedMeasuresF(values)(some)
    for row, order in zip(found, some, strict=True):
        moved = np.take_along_axis(values, order[:, :, None].astype(int), axis=1)
        np.testing.assert_allclose(row, f_by_regression(moved), rtol=1e-9)


def test_a_batch_does_not_depend_on_its_size(monkeypatch: pytest.MonkeyPatch) -> None:
    values = smooth(np.random.default_rng(5), 6, 3)
    before = repeated_measures_anova(values, np.random.default_rng(6), WaveformSettings(rearrangements=300))
    monkeypatch.setattr("scaling_service.evaluation.permutations._BATCH", 1)
    after = repeated_measures_anova(values, np.random.default_rng(6), WaveformSettings(rearrangements=300))
    assert after.threshold == pytest.approx(before.threshold, rel=1e-9)
    assert after.p == before.p


def test_few_rearrangements_are_all_taken() -> None:
    rng = np.random.default_rng(0)
    flips = signs(6, 32, rng)
    assert flips.exact
    assert len({tuple(row) for row in flips.items}) == 32
    assert (flips.items[0] == 1).all()
    assert not signs(6, 31, rng).exact
    every = orders(3, 3, 36, rng)
    assert every.exact
    assert len({row.tobytes() for row in every.items}) == 36
    assert (every.items[0] == np.arange(3)).all()
    drawn = orders(3, 3, 35, rng)
    assert (drawn.exact, len(drawn.items)) == (False, 35)
    assert (drawn.items[0] == np.arange(3)).all()
    assert (np.sort(drawn.items, axis=2) == np.arange(3)).all()


def test_p_of_an_exact_test_is_the_share_counted_by_hand() -> None:
    values = np.random.default_rng(7).normal(size=(3, 3, 4))
    everything = [
        f_by_regression(np.stack([values[s, list(order)] for s, order in enumerate(choice)])).max()
        for choice in product(permutations(range(3)), repeat=3)
    ]
    found = repeated_measures_anova(values, np.random.default_rng(0))
    assert (found.exact, found.rearrangements) == (True, 36)
    share = np.mean(np.array(everything) >= f_by_regression(values).max() * (1 - 1e-9))
    assert found.p == pytest.approx(share)


def test_an_exact_test_errs_no_more_than_it_says() -> None:
    """Every rearrangement of one set of data taken as observed: p is at most alpha for a share alpha."""
    values = np.random.default_rng(8).normal(size=(4, 3, 6))
    chosen = WaveformSettings(alpha=0.1)
    results = [
        repeated_measures_anova(
            np.take_along_axis(values, order[:, :, None].astype(int), axis=1),
            np.random.default_rng(0),
            chosen,
        )
        for order in orders(4, 3, 216, np.random.default_rng(0)).items
    ]
    rejected = np.mean([r.significant for r in results])
    assert rejected == pytest.approx(21 / 216)  # the largest share of 216 that is no more than 0.1
    assert [r.significant for r in results] == [r.p <= 0.1 for r in results]
    assert max((c.p for r in results for c in r.clusters), default=0.0) <= 0.1


def test_six_subjects_cannot_decide_four_pairs() -> None:
    """2⁵ signs: no p below 1/32, whatever the data, and that is said rather than passed over."""
    values = 10.0 * np.arange(5)[:, None] + smooth(np.random.default_rng(9), 6, 5)
    found = compare_waveforms(named(values), np.random.default_rng(1), reference="M4")
    assert found.anova.significant
    test = found.pair("M0", "M4").test
    assert (test.threshold, test.smallest_p, test.can_decide) == (np.inf, 1 / 32, False)
    assert test.p == 1 / 32
    assert not test.significant
    single = paired_t_test(values[:, 0], values[:, 4], np.random.default_rng(1))
    assert single.can_decide
    assert [c.p for c in single.clusters] == [1 / 32]


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
    found = curve_test("t", statistic, (5,), which, alpha=0.13)
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
    same = curve_test("t", lambda items: np.tile(curve, (len(items), 1)), (5,), which, alpha=0.5)
    assert (same.threshold, same.p, same.clusters) == (np.inf, 1.0, ())


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=50, deadline=None)
def test_ends_of_clusters_lie_on_the_threshold(seed: int) -> None:
    rng = np.random.default_rng(seed)
    first, second = smooth(rng, 8) + 1.5 * bump(40), smooth(rng, 8) + 1.5 * bump(90)
    found = paired_t_test(first, second, rng)
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
@settings(deadline=None)
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

    np.testing.assert_allclose(largest_masses(curves, threshold), [by_hand(c) for c in curves], rtol=1e-12)


@given(st.lists(st.integers(0, 12), min_size=1, max_size=60), st.floats(0.01, 0.99))
@settings(deadline=None)
def test_a_threshold_is_the_smallest_rare_value(maxima: list[int], alpha: float) -> None:
    values = np.array(maxima, dtype=float)
    found = critical_value(values, alpha)
    shares = {v: np.mean(values >= v) for v in values}
    rare = [v for v, share in shares.items() if share <= alpha + 1e-9]
    assert found == min(rare, default=np.inf)


def test_offsets_of_subjects_units_and_direction_do_not_matter() -> None:
    rng = np.random.default_rng(10)
    values = smooth(rng, 8, 3) + np.array([0.0, 3.0, 0.0])[:, None] * bump(30)
    chosen = WaveformSettings(rearrangements=500)

    def tested(curves: np.ndarray) -> CurveTest:
        return repeated_measures_anova(curves, np.random.default_rng(11), chosen)

    plain, moved = tested(values), tested(57.3 * values + 100.0 * smooth(rng, 8, 1))
    assert plain.significant
    np.testing.assert_allclose(moved.statistic, plain.statistic, rtol=1e-6)
    assert moved.threshold == pytest.approx(plain.threshold, rel=1e-6)
    turned = tested(values[:, :, ::-1])
    assert [100.0 - c.end for c in turned.clusters] == pytest.approx([c.start for c in plain.clusters])
    swapped = paired_t_test(values[:, 0], values[:, 1], np.random.default_rng(12))
    forward = paired_t_test(values[:, 1], values[:, 0], np.random.default_rng(12))
    np.testing.assert_array_equal(swapped.statistic, -forward.statistic)
    assert [c.p for c in swapped.clusters] == [c.p for c in forward.clusters]


def test_equal_methods_do_not_differ() -> None:
    one = smooth(np.random.default_rng(13), 7)
    for other in (one, one * (1 + 1e-15)):
        test = paired_t_test(one, other, np.random.default_rng(0))
        assert (test.p, test.significant, float(np.abs(test.statistic).max())) == (1.0, False, 0.0)
        anova = repeated_measures_anova(np.stack([one, other, one], axis=1), np.random.default_rng(0))
        assert (anova.p, anova.significant) == (1.0, False)


def test_a_constant_difference_is_certain_and_finite() -> None:
    one = smooth(np.random.default_rng(14), 7)
    test = paired_t_test(one + 0.1, one, np.random.default_rng(0))
    assert np.isfinite(test.statistic).all()
    assert test.statistic.min() > 1e4
    assert (test.p, [(c.start, c.end) for c in test.clusters]) == (1 / 64, [(0.0, 100.0)])


def test_pairs_are_gated_shared_and_signed() -> None:
    rng = np.random.default_rng(15)
    values = smooth(rng, 14, 4)
    none = compare_waveforms(named(values), np.random.default_rng(16))
    assert not none.anova.significant
    assert (none.pairs, none.n_pairs) == ((), 6)
    values[:, 2] += 2.5 * bump(60)
    found = compare_waveforms(named(values), np.random.default_rng(16))
    assert [len(p.test.clusters) > 0 for p in found.pairs] == ["M2" in p.methods for p in found.pairs]
    assert {p.test.alpha for p in found.pairs} == {0.05 / 6}
    assert found.pair("M2", "M0").test.clusters[0].peak < 0.0  # M0 minus M2
    np.testing.assert_allclose(
        found.pair("M0", "M2").difference_mean, (values[:, 0] - values[:, 2]).mean(axis=0)
    )
    against = compare_waveforms(named(values), np.random.default_rng(16), reference="M2")
    assert [p.methods for p in against.pairs] == [("M0", "M2"), ("M1", "M2"), ("M3", "M2")]
    assert {p.test.alpha for p in against.pairs} == {0.05 / 3}
    with pytest.raises(KeyError):
        against.pair("M0", "M1")


def test_the_same_stream_gives_the_same_numbers() -> None:
    curves = named(smooth(np.random.default_rng(17), 16, 4) + np.arange(4)[:, None] / 2)
    ours, again = (compare_waveforms(curves, np.random.default_rng(18)) for _ in range(2))
    assert ours.anova.threshold == again.anova.threshold
    assert [p.test.clusters for p in ours.pairs] == [p.test.clusters for p in again.pairs]


def test_missing_nodes_are_refused() -> None:
    values = smooth(np.random.default_rng(19), 5, 3)
    values[3, 1, 42] = np.nan
    with pytest.raises(
        ValueMissing, match="knee: no finite value at subject 'S3', method 'M1', node 42 of 101"
    ):
        named(values)
    with pytest.raises(ComparisonImpossible, match="missing node"):
        repeated_measures_anova(values, np.random.default_rng(0))
    with pytest.raises(ComparisonImpossible, match="missing node"):
        paired_t_test(values[:, 0], values[:, 1], np.random.default_rng(0))


def test_settings_that_make_no_test() -> None:
    with pytest.raises(ComparisonImpossible, match="between 0 and 1"):
        WaveformSettings(alpha=5.0)
    with pytest.raises(ComparisonImpossible, match="at least two"):
        WaveformSettings(rearrangements=1)
    curves = named(smooth(np.random.default_rng(20), 4, 3))
    with pytest.raises(ComparisonImpossible, match="'EB' is not among the methods"):
        compare_waveforms(curves, np.random.default_rng(0), reference="EB")


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
    assert_agree(repeated_measures_anova(values, rng), peer_anova(spm1d, values))
    first, second = values[:, 0], values[:, 3]
    peer = spm1d.stats.ttest_paired(first, second).inference(0.05, two_tailed=True)
    assert_agree(paired_t_test(first, second, rng), peer)


def false_positives(
    experiments: int, n: int, k: int, chosen: WaveformSettings, scale: np.ndarray | float = 1.0
) -> tuple[float, float]:
    """Share of null experiments in which the analysis of variance, and a paired t test, find something."""
    found = np.zeros(2)
    for i in range(experiments):
        rng = np.random.default_rng([22, n, k, i])
        values = scale * smooth(rng, n, k) + 2.0 * smooth(rng, n, 1)
        found += (
            repeated_measures_anova(values, rng, chosen).significant,
            paired_t_test(values[:, 0], values[:, 1], rng, chosen).significant,
        )
    return tuple(found / experiments)


def test_false_positives_are_five_percent() -> None:
    anova, t = false_positives(2000, 9, 3, WaveformSettings(rearrangements=200))
    assert anova == pytest.approx(0.05, abs=0.01)
    assert t == pytest.approx(0.05, abs=0.01)


def test_methods_that_scatter_differently() -> None:
    """Exchange of signs keeps its level where exchange of labels, as documented, does not."""
    scale = np.array([3.0, 1.0, 1.0])[:, None]
    signs_only = WaveformSettings(rearrangements=200, exchange="signs")
    assert false_positives(1000, 12, 3, signs_only, scale)[0] == pytest.approx(0.05, abs=0.02)
    labels = WaveformSettings(rearrangements=200)
    assert false_positives(300, 12, 3, labels, scale)[0] > 0.10


def test_signs_turn_the_deviations_of_a_subject() -> None:
    values = np.random.default_rng(24).normal(size=(5, 3, 7))
    some = signs(5, 10, np.random.default_rng(25)).items
    centre = values.mean(axis=1, keepdims=True)
    for row, sign in zip(RepeatedMeasuresF(values)(some), some, strict=True):
        moved = centre + sign[:, None, None] * (values - centre)
        np.testing.assert_allclose(row, f_by_regression(moved), rtol=1e-9)


@pytest.mark.benchmark
@pytest.mark.parametrize(("n", "k"), [(6, 5), (10, 5), (26, 5)])
def test_false_positives_at_length(n: int, k: int) -> None:
    start = time.perf_counter()
    anova, t = false_positives(4000, n, k, WaveformSettings(rearrangements=1000))
    wall = time.perf_counter() - start
    print(f"\n{n} subjects, {k} methods: F {anova:.4f}, t {t:.4f} false positives of 4000; {wall:.0f} s")  # noqa: T201
    assert anova == pytest.approx(0.05, abs=0.01)
    if n > 6:  # six subjects have 32 sign patterns: the level is 1/32
        assert t == pytest.approx(0.05, abs=0.01)
    else:
        assert t == pytest.approx(1 / 32, abs=0.01)


@pytest.mark.benchmark
def test_thresholds_against_spm1d_at_length() -> None:
    """Mean and largest relative difference from the peer's thresholds, and the time of both."""
    spm1d = pytest.importorskip("spm1d")
    gaps, seconds = [], np.zeros(2)
    for i in range(100):
        rng = np.random.default_rng([23, i])
        values = smooth(rng, 26, 5) + 2.0 * smooth(rng, 26, 1)
        clock = time.perf_counter()
        f, t = repeated_measures_anova(values, rng), paired_t_test(values[:, 0], values[:, 1], rng)
        seconds[0] += time.perf_counter() - clock
        clock = time.perf_counter()
        peer_f = peer_anova(spm1d, values)
        peer_t = spm1d.stats.ttest_paired(values[:, 0], values[:, 1]).inference(0.05, two_tailed=True)
        seconds[1] += time.perf_counter() - clock
        gaps.append((f.threshold / peer_f.zstar - 1, t.threshold / peer_t.zstar - 1))
    mean, largest = np.mean(gaps, axis=0), np.abs(gaps).max(axis=0)
    print(f"\nmean F {mean[0]:+.4f} t {mean[1]:+.4f}, largest F {largest[0]:.4f} t {largest[1]:.4f}")  # noqa: T201
    print(f"ours {seconds[0]:.1f} s, spm1d {seconds[1]:.1f} s")  # noqa: T201
    assert np.abs(mean).max() < 0.01
    assert largest.max() < 0.06
