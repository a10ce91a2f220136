"""Derivatives by splines against scipy's own spline and functions whose derivatives are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from scaling_service.numerics.multibody.derivatives import MIN_SAMPLES, SplineRates, spline_rates


def test_rates_are_those_of_scipys_natural_quintic_spline() -> None:
    rng = np.random.default_rng(0)
    t = np.sort(rng.uniform(0, 3, 60))
    x = rng.normal(size=(60, 3))
    ends = [(3, np.zeros(3)), (4, np.zeros(3))]
    spline = make_interp_spline(t, x, k=5, bc_type=(ends, ends))
    first, second = SplineRates(t).rates(x)
    np.testing.assert_allclose(first, spline(t, 1), rtol=0, atol=1e-9 * np.abs(first).max())
    np.testing.assert_allclose(second, spline(t, 2), rtol=0, atol=1e-9 * np.abs(second).max())


def test_a_parabola_is_differentiated_exactly() -> None:
    t = np.linspace(0, 1, 20)
    first, second = SplineRates(t).rates(np.stack([t**2, 3 * t], axis=1))
    np.testing.assert_allclose(first, np.stack([2 * t, 3 + 0 * t], axis=1), rtol=0, atol=1e-11)
    np.testing.assert_allclose(second, [[2, 0]] * 20, rtol=0, atol=1e-9)


def test_a_gap_is_not_crossed() -> None:
    t = np.arange(60) / 100
    x = np.stack([np.sin(9 * t), np.cos(9 * t)], axis=1)
    whole = SplineRates(t[:30]).rates(x[:30])
    x[30, 0] = np.nan
    x[30 + MIN_SAMPLES :, 0] = np.nan
    x[0, 1] = np.nan
    first, second = spline_rates(t, x)
    np.testing.assert_array_equal(first[:30, 0], whole[0][:, 0])
    np.testing.assert_array_equal(second[:30, 0], whole[1][:, 0])
    assert np.isnan(second[30:, 0]).all()  # a run too short for a spline
    assert np.isfinite(second[1:, 1]).all()
    assert np.isnan(first[0, 1])


def test_too_few_samples_are_refused() -> None:
    with pytest.raises(ValueError, match="needs 6 increasing times"):
        SplineRates(np.arange(5.0))
