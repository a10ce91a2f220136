"""Bland-Altman, ICC and RMSE against the tables of the papers that define them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import linregress

from scaling_service.numerics.statistics.agreement import (
    compute_bland_altman,
    compute_intraclass_correlations,
    measure_agreement,
)
from scaling_service.numerics.statistics.complete import ComparisonImpossible, ValueMissing

# Bland & Altman 1986, table 1: first readings (l/min) of the Wright and the mini Wright peak flow meter.
WRIGHT = np.array(
    [494, 395, 516, 434, 476, 557, 413, 442, 650, 433, 417, 656, 267, 478, 178, 423, 427], dtype=float
)
MINI = np.array(
    [512, 430, 520, 428, 500, 600, 364, 380, 658, 445, 432, 626, 260, 477, 259, 350, 451], dtype=float
)

# Shrout & Fleiss 1979, table 2: four judges on six targets.
JUDGES = np.array(
    [[9, 2, 5, 8], [6, 1, 3, 2], [8, 4, 6, 8], [7, 1, 2, 6], [10, 5, 6, 9], [6, 2, 4, 7]], dtype=float
)


def test_peak_flow_meters() -> None:
    found = compute_bland_altman(WRIGHT, MINI)
    assert found.n == 17
    assert found.bias.value == pytest.approx(-2.1, abs=0.05)
    assert found.sd == pytest.approx(38.8, abs=0.05)
    assert (found.bias.low, found.bias.high) == pytest.approx((-22.0, 17.8), abs=0.1)
    # The paper takes 2 SD for 1.96 and 3 s²/n for the squared error of a limit.
    assert (found.lower.value, found.upper.value) == pytest.approx((-79.7, 75.5), abs=1.7)
    assert (found.lower.low, found.lower.high) == pytest.approx((-114.3, -45.1), abs=2.0)
    assert (found.upper.low, found.upper.high) == pytest.approx((40.9, 110.1), abs=2.0)


def test_limits_hold_their_share_and_their_intervals_cover() -> None:
    """20 subjects of a normal population with bias 1 and SD 2, many times over."""
    rng = np.random.default_rng(1)
    truth = 1.0 + 1.959964 * 2.0
    covered = {"bias": 0, "upper": 0}
    for _ in range(2000):
        found = compute_bland_altman(rng.normal(1.0, 2.0, 20), np.zeros(20))
        covered["bias"] += found.bias.low < 1.0 < found.bias.high
        covered["upper"] += found.upper.low < truth < found.upper.high
    assert covered["bias"] / 2000 == pytest.approx(0.95, abs=0.015)
    assert covered["upper"] / 2000 == pytest.approx(0.95, abs=0.02)  # the 1999 error is approximate


def test_a_disagreement_that_grows_with_size() -> None:
    reference = np.linspace(0.3, 0.5, 12)
    values = 1.1 * reference + 1e-3 * np.random.default_rng(2).normal(size=12)
    slope = compute_bland_altman(values, reference).slope
    peer = linregress((values + reference) / 2, values - reference)
    assert slope.value == pytest.approx(peer.slope)
    assert (slope.high - slope.low) / 2 == pytest.approx(2.228139 * peer.stderr, rel=1e-6)  # t, 10 degrees
    assert slope.low > 0.0


def test_shrout_and_fleiss() -> None:
    absolute, consistent = compute_intraclass_correlations(JUDGES)
    assert round(absolute.value, 2) == 0.29
    assert round(consistent.value, 2) == 0.71
    # The same table in the manual of R's psych, function ICC: 0.019 to 0.76, and 0.34 to 0.95 (0.342, 0.946).
    assert (absolute.low, absolute.high) == pytest.approx((0.019, 0.761), abs=1e-3)
    assert (consistent.low, consistent.high) == pytest.approx((0.342, 0.946), abs=1e-3)


@pytest.mark.parametrize(("bias", "noise"), [(0.0, 0.5), (1.0, 0.5), (0.3, 1.5)])
def test_correlations_are_shares_of_variance(bias: float, noise: float) -> None:
    """Two methods, subjects of SD 1: the estimates approach the shares of the components."""
    rng = np.random.default_rng(3)
    table = rng.normal(size=(200_000, 1)) + noise * rng.normal(size=(200_000, 2)) + [bias, 0.0]
    absolute, consistent = compute_intraclass_correlations(table)
    assert absolute.value == pytest.approx(1 / (1 + noise**2 + bias**2 / 2), abs=0.005)
    assert consistent.value == pytest.approx(1 / (1 + noise**2), abs=0.005)
    assert consistent.low < consistent.value < consistent.high
    assert absolute.low < absolute.value < absolute.high


def test_intervals_cover_the_share() -> None:
    rng = np.random.default_rng(4)
    hits = np.zeros(2)
    for _ in range(1500):
        table = rng.normal(size=(15, 1)) + 0.5 * rng.normal(size=(15, 4)) + 0.4 * rng.normal(size=(1, 4))
        truths = (1 / (1 + 0.25 + 0.16), 1 / 1.25)
        both = zip(truths, compute_intraclass_correlations(table), strict=True)
        hits += [found.low < truth < found.high for truth, found in both]
    assert hits[1] / 1500 == pytest.approx(0.95, abs=0.018)
    assert hits[0] / 1500 == pytest.approx(0.95, abs=0.025)  # Satterthwaite's degrees are approximate


@given(st.integers(0, 2**32 - 1), st.floats(0.01, 1000.0), st.floats(-1000.0, 1000.0))
def test_units_and_zero_do_not_matter_to_correlations(seed: int, factor: float, shift: float) -> None:
    table = np.random.default_rng(seed).normal(size=(8, 3))
    for ours, moved in zip(
        compute_intraclass_correlations(table),
        compute_intraclass_correlations(factor * table + shift),
        strict=True,
    ):
        assert moved.value == pytest.approx(ours.value, rel=1e-4, abs=1e-6)
        assert moved.low == pytest.approx(ours.low, rel=1e-4, abs=1e-6)


def test_a_constant_bias_costs_agreement_only() -> None:
    lengths = np.linspace(0.38, 0.48, 10)
    values = {f"S{i}": {"MB": x + 0.01, "EB": x} for i, x in enumerate(lengths)}
    found = measure_agreement(values, "MB", "EB", quantity="femur_r")
    assert found.icc_consistency.value == 1.0
    assert found.icc_agreement.value == pytest.approx(1 / (1 + 0.01**2 / 2 / np.var(lengths, ddof=1)))
    assert np.isnan(found.icc_agreement.low)
    assert found.rmse == pytest.approx(0.01)
    assert found.bland_altman.bias.value == pytest.approx(0.01)
    assert found.bland_altman.sd == pytest.approx(0.0, abs=1e-12)


def test_a_method_against_itself_and_subjects_all_alike() -> None:
    same = {f"S{i}": {"MB": 0.4 + i / 100, "EB": 0.4 + i / 100} for i in range(5)}
    found = measure_agreement(same, "MB", "EB", quantity="femur_r")
    assert (found.icc_agreement.value, found.icc_agreement.low, found.rmse) == (1.0, 1.0, 0.0)
    flat = {f"S{i}": {"MB": 0.4, "EB": 0.4} for i in range(5)}
    nothing = measure_agreement(flat, "MB", "EB", quantity="femur_r")
    assert np.isnan(nothing.icc_agreement.value)
    assert np.isnan(nothing.icc_consistency.value)
    assert np.isnan(nothing.bland_altman.slope.value)


def test_rmse_is_bias_and_spread() -> None:
    rng = np.random.default_rng(5)
    values = {f"S{i}": {"MB": float(rng.normal()), "truth": float(rng.normal())} for i in range(9)}
    found = measure_agreement(values, "MB", "truth", quantity="femur_r")
    bland = found.bland_altman
    assert found.rmse**2 == pytest.approx(bland.bias.value**2 + bland.sd**2 * 8 / 9)


def test_what_is_missing_is_named() -> None:
    values = {f"S{i}": {"MB": 0.4 + i, "EB": 0.5 + i} for i in range(4)}
    del values["S3"]["EB"]
    with pytest.raises(ValueMissing, match="femur_r: subject 'S3' has no value for method 'EB'"):
        measure_agreement(values, "MB", "EB", quantity="femur_r")
    values["S3"]["EB"] = float("inf")
    with pytest.raises(ValueMissing, match="no finite value at subject 'S3', method 'EB'"):
        measure_agreement(values, "MB", "EB", quantity="femur_r")


def test_too_few_subjects() -> None:
    values = {f"S{i}": {"MB": 0.4 + i, "EB": 0.5 + i} for i in range(2)}
    with pytest.raises(ComparisonImpossible, match="at least three subjects"):
        measure_agreement(values, "MB", "EB", quantity="femur_r")
