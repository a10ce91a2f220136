"""Derivatives by splines against functions whose derivatives are known."""

from __future__ import annotations

import numpy as np

from scaling_service.numerics.signals.splines import MIN_SAMPLES, differentiate_spline


def test_a_parabola_is_differentiated_exactly() -> None:
    t = np.linspace(0, 1, 20)
    first, second = differentiate_spline(t, np.stack([t**2, 3 * t], axis=1))
    np.testing.assert_allclose(first, np.stack([2 * t, 3 + 0 * t], axis=1), rtol=0, atol=1e-11)
    np.testing.assert_allclose(second, [[2, 0]] * 20, rtol=0, atol=1e-9)


def test_a_gap_is_not_crossed() -> None:
    t = np.arange(60) / 100
    x = np.stack([np.sin(9 * t), np.cos(9 * t)], axis=1)
    whole = differentiate_spline(t[:30], x[:30])
    x[30, 0] = np.nan
    x[30 + MIN_SAMPLES :, 0] = np.nan
    x[0, 1] = np.nan
    first, second = differentiate_spline(t, x)
    np.testing.assert_array_equal(first[:30, 0], whole[0][:, 0])
    np.testing.assert_array_equal(second[:30, 0], whole[1][:, 0])
    assert np.isnan(second[30:, 0]).all()  # a run too short for a spline
    assert np.isfinite(second[1:, 1]).all()
    assert np.isnan(first[0, 1])


def test_a_run_of_too_few_samples_has_no_rates() -> None:
    assert np.isnan(differentiate_spline(np.arange(5.0), np.zeros((5, 1)))).all()
