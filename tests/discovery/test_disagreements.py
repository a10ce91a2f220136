"""Disagreement in one stretch of time is told from chance, and chance is not told as disagreement."""

from __future__ import annotations

import numpy as np
import pytest

from scaling_service.capabilities.discovery.search.unexplained import in_one_block
from scaling_service.numerics.multibody.laws import Array

FRAMES, TIMES, PLACES = 50, 2000, 30
LEVEL = 0.05 / (2 * PLACES)
"""What one place needs where thirty are looked at, by two tests each."""


def heights(noise: Array) -> Array:
    """Log mean squares of blocks, for noise of unit variance (..., n_stretches, n_frames, 3)."""
    return np.asarray(np.log(np.square(noise).mean(axis=(-2, -1))))


@pytest.mark.parametrize("blocks", [12, 30])
@pytest.mark.parametrize("degrees", [3, 5, 1000])
def test_noise_is_not_reported_as_a_burst(degrees: int, blocks: int) -> None:
    """Over all places, also where its tails are so heavy that its squares have no variance."""
    noise = np.random.default_rng(3).standard_t(degrees, size=(TIMES, blocks, FRAMES, 3))
    reported = np.array([in_one_block(height) for height in heights(noise)]) < LEVEL
    assert PLACES * reported.mean() < 0.05 + PLACES * 2.0 * np.sqrt(LEVEL / TIMES)


def test_a_burst_is_reported_however_little_the_mean_says() -> None:
    """One that stands as far above its floor as exchanged labels do."""
    stream = np.random.default_rng(4)
    noise = stream.normal(size=(30, FRAMES, 3))
    noise[7] *= 15.0
    assert in_one_block(heights(noise)) < LEVEL


def test_equal_heights_say_nothing() -> None:
    assert in_one_block(np.ones(8)) == 1.0
