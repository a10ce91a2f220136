"""Filters against their closed-form responses, and gaps that must not leak."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scaling_service.numerics.signals.filters import (
    convert_cutoff,
    fill_short_gaps,
    filter_butterworth,
    find_runs,
)


def _gain(filtered, original, keep):
    """Amplitude ratio of a sine, away from the ends."""
    return np.sqrt((filtered[keep] ** 2).mean() / (original[keep] ** 2).mean())


@given(st.lists(st.booleans(), max_size=40))
def test_runs_rebuild_the_flags(flags):
    flags = np.array(flags, bool)
    rebuilt = np.zeros_like(flags)
    pairs = find_runs(flags)
    for start, stop in pairs:
        rebuilt[start:stop] = True
    np.testing.assert_array_equal(rebuilt, flags)
    assert (pairs[1:, 0] > pairs[:-1, 1]).all()


@given(st.integers(0, 5000))
@settings(max_examples=30)
def test_nothing_leaks_across_a_gap(seed):
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(60, 2, 3))
    x[25:28] = np.nan
    other = x.copy()
    other[28:] += 100
    a, b, first = (filter_butterworth(each, rate_hz=100, cutoff_hz=15).values for each in (x, other, x[:25]))
    np.testing.assert_array_equal(a[:28], b[:28])
    np.testing.assert_array_equal(np.isnan(a), np.isnan(x))
    np.testing.assert_allclose(a[:25], first, atol=1e-12)


@pytest.mark.parametrize(("cutoff", "rate"), [(6, 100), (6, 60), (20, 100), (45, 100), (10, 1000)])
@pytest.mark.parametrize("order", [2, 4, 8])
def test_butterworth_has_half_power_at_the_stated_cutoff(cutoff, rate, order):
    n = np.arange(40 * rate)
    x = np.sin(2 * np.pi * cutoff * n / rate + 0.1)
    result = filter_butterworth(x, rate_hz=rate, cutoff_hz=cutoff, order=order)
    keep = slice(5 * rate, -5 * rate)
    assert _gain(result.values, x, keep) == pytest.approx(np.sqrt(0.5), abs=1e-6)
    # Zero phase: the result is the same sine.
    np.testing.assert_allclose(result.values[keep], np.sqrt(0.5) * x[keep], atol=1e-6)
    assert not result.unfiltered.any()


def test_butterworth_rolls_off_by_its_effective_order():
    rate, cutoff = 10_000, 10
    n = np.arange(2 * rate)
    gains = []
    for f in (100, 200):
        x = np.sin(2 * np.pi * f * n / rate)
        gains.append(
            _gain(
                filter_butterworth(x, rate_hz=rate, cutoff_hz=cutoff).values, x, slice(rate // 2, -rate // 2)
            )
        )
    assert gains[0] / gains[1] == pytest.approx(2**4, rel=0.01)  # 24 dB per octave: order 4


def test_single_pass_cutoff_is_winters_factor_far_below_half_the_rate():
    # Winter 2009: C = (2**(1/2) - 1)**(1/4) = 0.802 for two passes of order 2.
    assert 6 / convert_cutoff(6, 1e6, 2) == pytest.approx(0.8022, abs=1e-4)


def test_short_runs_are_reported_and_left():
    x = np.random.default_rng(0).normal(size=(80, 2))
    x[5, 0] = np.nan
    result = filter_butterworth(x, rate_hz=100, cutoff_hz=6)
    np.testing.assert_array_equal(np.flatnonzero(result.unfiltered[:, 0]), np.arange(5))
    assert not result.unfiltered[:, 1].any()
    np.testing.assert_array_equal(result.values[:5, 0], x[:5, 0])
    assert not np.array_equal(result.values[6:, 0], x[6:, 0])


@pytest.mark.parametrize("bad", [{"cutoff_hz": 50}, {"cutoff_hz": 0}, {"cutoff_hz": 6, "order": 3}])
def test_impossible_filters_are_refused(bad):
    with pytest.raises(ValueError, match=r"cutoff|order"):
        filter_butterworth(np.zeros(100), rate_hz=100, **bad)


def test_short_gaps_of_a_cubic_are_filled_exactly():
    n = np.arange(40.0)[:, None, None]
    x = 1e-3 * n**3 - 0.02 * n**2 + n + np.array([[[0.0, 1, 2], [3, 4, 5]]])
    holed = x.copy()
    holed[10:15, 0] = np.nan
    holed[30:36, 1] = np.nan
    y, filled = fill_short_gaps(holed, longest=5)
    np.testing.assert_allclose(y[:, 0], x[:, 0], atol=1e-9)
    np.testing.assert_array_equal(np.isnan(y[:, 1]), np.isnan(holed[:, 1]))  # six frames are too long
    assert filled.sum() == 5


def test_gaps_at_the_ends_and_without_neighbours_are_left():
    x = np.random.default_rng(0).normal(size=(30, 1, 3))
    x[:2] = np.nan
    x[-1] = np.nan
    x[10] = x[12] = np.nan  # one seen frame between two gaps shows no slope
    y, filled = fill_short_gaps(x, longest=5)
    assert not filled.any()
    np.testing.assert_array_equal(y, x)


def test_a_smooth_motion_is_interpolated_closely():
    t = np.arange(300) / 100
    x = np.stack((np.sin(2 * np.pi * t), np.cos(2 * np.pi * t), t), axis=1)[:, None]
    holed = x.copy()
    holed[100:115] = np.nan
    y, _ = fill_short_gaps(holed, longest=15)
    # A clamped cubic over h = 0.16 s errs by less than h**4/384 max|x''''| = 2.7 mm per metre of amplitude.
    assert np.abs(y - x).max() < 2.7e-3
