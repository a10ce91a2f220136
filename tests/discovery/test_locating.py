"""Disagreement in one stretch of time is told from chance, and chance is not told as disagreement."""

from __future__ import annotations

import numpy as np
import pytest

from scaling_service.discovery.locating import in_one_stretch
from scaling_service.kernels.laws import Array

STRETCHES, FRAMES, TIMES = 30, 50, 2000


def heights(noise: Array) -> Array:
    """Log mean squares of stretches, for noise of unit variance (..., n_stretches, n_frames, 3)."""
    return np.asarray(np.log(np.square(noise).mean(axis=(-2, -1))))


@pytest.mark.parametrize("kind", ["white", "heavy_tailed"])
def test_noise_is_not_told_as_a_burst(kind: str) -> None:
    stream = np.random.default_rng(3)
    shape = (TIMES, STRETCHES, FRAMES, 3)
    noise = stream.normal(size=shape) if kind == "white" else stream.standard_t(5, size=shape)
    told = np.array([in_one_stretch(height) for height in heights(noise)]) < 0.05
    assert told.mean() < 0.05 + 2.0 * np.sqrt(0.05 * 0.95 / TIMES)


def test_a_burst_is_told_however_little_the_mean_says() -> None:
    stream = np.random.default_rng(4)
    noise = stream.normal(size=(STRETCHES, FRAMES, 3))
    noise[7] *= 4.0
    assert in_one_stretch(heights(noise)) < 1e-3


def test_equal_heights_say_nothing() -> None:
    assert in_one_stretch(np.ones(8)) == 1.0
