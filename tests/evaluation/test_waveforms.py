"""Statistical parametric mapping by permutation: closed forms, enumeration by hand, what must not matter."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np
import pytest
from scipy.stats import ttest_rel

from scaling_service.numerics.statistics.complete import ComparisonImpossible, ValueMissing
from scaling_service.numerics.statistics.permutation_tests import (
    CurveTest,
    PairedT,
    RepeatedMeasuresF,
    draw_orders,
    draw_signs,
)
from scaling_service.numerics.statistics.waveforms import (
    Curves,
    WaveformSettings,
    analyse_repeated_measures,
    compare_paired,
    compare_waveforms,
)
from tests.evaluation.curves import bump, smooth


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
    some = draw_orders(5, 3, 40, np.random.default_rng(4)).items
    found = RepeatedMeasuresF(values)(some)
    for row, order in zip(found, some, strict=True):
        moved = np.take_along_axis(values, order[:, :, None].astype(int), axis=1)
        np.testing.assert_allclose(row, f_by_regression(moved), rtol=1e-9)


def test_a_batch_does_not_depend_on_its_size(monkeypatch: pytest.MonkeyPatch) -> None:
    values = smooth(np.random.default_rng(5), 6, 3)
    before = analyse_repeated_measures(values, np.random.default_rng(6), WaveformSettings(rearrangements=300))
    monkeypatch.setattr("scaling_service.numerics.statistics.permutation_tests._BATCH", 1)
    after = analyse_repeated_measures(values, np.random.default_rng(6), WaveformSettings(rearrangements=300))
    assert after.threshold == pytest.approx(before.threshold, rel=1e-9)
    assert after.p == before.p


def test_few_rearrangements_are_all_taken() -> None:
    rng = np.random.default_rng(0)
    flips = draw_signs(6, 32, rng)
    assert flips.exact
    assert len({tuple(row) for row in flips.items}) == 32
    assert (flips.items[0] == 1).all()
    assert not draw_signs(6, 31, rng).exact
    every = draw_orders(3, 3, 36, rng)
    assert every.exact
    assert len({row.tobytes() for row in every.items}) == 36
    assert (every.items[0] == np.arange(3)).all()
    drawn = draw_orders(3, 3, 35, rng)
    assert (drawn.exact, len(drawn.items)) == (False, 35)
    assert (drawn.items[0] == np.arange(3)).all()
    assert (np.sort(drawn.items, axis=2) == np.arange(3)).all()


def test_p_of_an_exact_test_is_the_share_counted_by_hand() -> None:
    values = np.random.default_rng(7).normal(size=(3, 3, 4))
    everything = [
        f_by_regression(np.stack([values[s, list(order)] for s, order in enumerate(choice)])).max()
        for choice in product(permutations(range(3)), repeat=3)
    ]
    found = analyse_repeated_measures(values, np.random.default_rng(0))
    assert (found.exact, found.rearrangements) == (True, 36)
    share = np.mean(np.array(everything) >= f_by_regression(values).max() * (1 - 1e-9))
    assert found.p == pytest.approx(share)


def test_an_exact_test_errs_no_more_than_it_says() -> None:
    """Every rearrangement of one set of data taken as observed: p is at most alpha for a share alpha."""
    values = np.random.default_rng(8).normal(size=(4, 3, 6))
    chosen = WaveformSettings(alpha=0.1)
    results = [
        analyse_repeated_measures(
            np.take_along_axis(values, order[:, :, None].astype(int), axis=1),
            np.random.default_rng(0),
            chosen,
        )
        for order in draw_orders(4, 3, 216, np.random.default_rng(0)).items
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
    single = compare_paired(values[:, 0], values[:, 4], np.random.default_rng(1))
    assert single.can_decide
    assert [c.p for c in single.clusters] == [1 / 32]


def test_offsets_of_subjects_units_and_direction_do_not_matter() -> None:
    rng = np.random.default_rng(10)
    values = smooth(rng, 8, 3) + np.array([0.0, 3.0, 0.0])[:, None] * bump(30)
    chosen = WaveformSettings(rearrangements=500)

    def tested(curves: np.ndarray) -> CurveTest:
        return analyse_repeated_measures(curves, np.random.default_rng(11), chosen)

    plain, moved = tested(values), tested(57.3 * values + 100.0 * smooth(rng, 8, 1))
    assert plain.significant
    np.testing.assert_allclose(moved.statistic, plain.statistic, rtol=1e-6)
    assert moved.threshold == pytest.approx(plain.threshold, rel=1e-6)
    turned = tested(values[:, :, ::-1])
    assert [100.0 - c.end for c in turned.clusters] == pytest.approx([c.start for c in plain.clusters])
    swapped = compare_paired(values[:, 0], values[:, 1], np.random.default_rng(12))
    forward = compare_paired(values[:, 1], values[:, 0], np.random.default_rng(12))
    np.testing.assert_array_equal(swapped.statistic, -forward.statistic)
    assert [c.p for c in swapped.clusters] == [c.p for c in forward.clusters]


def test_equal_methods_do_not_differ() -> None:
    one = smooth(np.random.default_rng(13), 7)
    for other in (one, one * (1 + 1e-15)):
        test = compare_paired(one, other, np.random.default_rng(0))
        assert (test.p, test.significant, float(np.abs(test.statistic).max())) == (1.0, False, 0.0)
        anova = analyse_repeated_measures(np.stack([one, other, one], axis=1), np.random.default_rng(0))
        assert (anova.p, anova.significant) == (1.0, False)


def test_a_constant_difference_is_certain_and_finite() -> None:
    one = smooth(np.random.default_rng(14), 7)
    test = compare_paired(one + 0.1, one, np.random.default_rng(0))
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


def test_settings_that_make_no_test() -> None:
    with pytest.raises(ComparisonImpossible, match="between 0 and 1"):
        WaveformSettings(alpha=5.0)
    with pytest.raises(ComparisonImpossible, match="at least two"):
        WaveformSettings(rearrangements=1)
    curves = named(smooth(np.random.default_rng(20), 4, 3))
    with pytest.raises(ComparisonImpossible, match="'EB' is not among the methods"):
        compare_waveforms(curves, np.random.default_rng(0), reference="EB")
