"""Noise and gaps are as large as they say, and of the kind that they say."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import kurtosis

from tests.blind.clutter import NONE, NULLS, Clutter, autocorrelated
from tests.blind.forces import Plates

TIMES = np.arange(500) / 100.0


def noise_of(clutter: Clutter, markers: int = 14) -> np.ndarray:
    still = np.zeros((500, markers, 3))
    return clutter.on_markers(TIMES, still, np.random.default_rng(0))


def test_no_clutter_is_none() -> None:
    markers = np.random.default_rng(1).normal(size=(500, 3, 3))
    np.testing.assert_array_equal(NONE.on_markers(TIMES, markers, np.random.default_rng(0)), markers)


def test_white_noise_has_its_size_and_no_memory() -> None:
    noise = noise_of(NULLS["white"])
    assert np.nanstd(noise) == pytest.approx(0.5e-3, rel=0.03)
    assert abs(_lag_one(noise)) < 0.03
    assert abs(kurtosis(noise, axis=None, nan_policy="omit")) < 0.2


def test_heavy_tails_have_the_same_size() -> None:
    noise = noise_of(NULLS["heavy_tailed"])
    assert np.nanstd(noise) == pytest.approx(0.5e-3, rel=0.1)
    assert kurtosis(noise, axis=None, nan_policy="omit") > 3.0


def test_autocorrelation_has_its_time() -> None:
    signal = autocorrelated(np.random.default_rng(2), (20000, 4), 2.0, 0.1, 0.01)
    assert np.std(signal) == pytest.approx(2.0, rel=0.05)
    assert _lag_one(signal) == pytest.approx(np.exp(-0.1), abs=0.01)


def test_skin_moves_slowly_and_differently_each_time() -> None:
    skin = Clutter(white_m=0.0, slow_m=0.0, gaps=0)
    rng = np.random.default_rng(0)
    first, second = (skin.on_markers(TIMES, np.zeros((500, 14, 3)), rng) for _ in range(2))
    assert np.std(first) == pytest.approx(0.5e-3, rel=1e-6)
    spectrum = np.abs(np.fft.rfft(first[:, 0, 0])) ** 2
    assert spectrum[np.fft.rfftfreq(500, 0.01) < 2.0].sum() > 0.95 * spectrum.sum()
    # Each coordinate is new in each trial, so that nothing of it can be learnt.
    products = np.mean(first * second, axis=0) / (np.std(first, axis=0) * np.std(second, axis=0))
    assert abs(np.mean(products)) < 0.15


def test_gaps_are_short_and_few() -> None:
    lost = np.isnan(noise_of(NULLS["white"])).all(axis=2)
    assert 0 < lost.sum() <= 3 * 14
    assert lost.sum(axis=0).max() <= 3 * 14


def test_plates_noise_follows_the_data_sheet() -> None:
    times = np.arange(20000) / 500.0
    force = np.zeros((20000, 2, 3))
    force[:, 0, 1] = 900.0
    plates = Plates(times, force, np.zeros_like(force))
    noisy = Clutter().on_plates(plates, np.random.default_rng(3))
    quick = np.diff(noisy.force - plates.force, axis=0) / np.sqrt(2)
    # The drift of 1 N and 0.2 s adds sqrt(2 x 0.002 / 0.2) N to each step.
    drift = np.sqrt(1 - np.exp(-0.002 / 0.2))
    assert np.std(quick[:, 0]) == pytest.approx(np.hypot(0.3, drift), rel=0.05)
    assert np.std(quick[:, 1]) == pytest.approx(np.hypot(0.22 / 3, drift), rel=0.05)


def _lag_one(signal: np.ndarray) -> float:
    flat = signal.reshape(len(signal), -1)
    a, b = flat[:-1] - np.nanmean(flat), flat[1:] - np.nanmean(flat)
    return float(np.nanmean(a * b) / np.nanvar(flat))
