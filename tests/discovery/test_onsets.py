"""When a force begins and ends: against courses whose beginnings are known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from scaling_service.capabilities.discovery.laws.contacts import estimate_onset
from scaling_service.core.arrays import Array

TIMES = np.arange(0.0, 2.0, 0.01)
BEGINNING = 0.63


def smooth(u: Array) -> Array:
    v = np.clip(u, 0.0, 1.0)
    return v**3 * (10.0 - 15.0 * v + 6.0 * v**2)


COURSES: dict[str, Callable[[Array], Array]] = {
    "at once": lambda t: (t > 0.0) * 1.0,
    "slowly": lambda t: smooth(t / 0.7),
    "like half a sine": lambda t: np.where(t > 0.0, np.sin(np.clip(np.pi * t / 2.4, 0.0, np.pi)), 0.0),
    "and wavers": lambda t: smooth(t / 0.3) * (1.0 + 0.1 * np.sin(9.0 * t)),
}


@pytest.mark.parametrize("name", COURSES)
def test_a_beginning_is_found_under_noise(name: str) -> None:
    """Thirty courses with 3 % noise that remembers five frames: a few hundredths off, and as far as told."""
    rng = np.random.default_rng(1)
    off, reported = [], []
    for _ in range(30):
        noise = np.convolve(rng.normal(size=len(TIMES) + 4), np.ones(5) / np.sqrt(5.0), "valid")
        found, sd = estimate_onset(TIMES, 30.0 * COURSES[name](TIMES - BEGINNING) + noise, 1.0, 5.0)
        off.append(found - BEGINNING)
        reported.append(sd)
    assert np.median(np.abs(off)) < 0.06
    assert np.mean(np.abs(off) < 2.0 * np.array(reported)) >= 0.8
    assert np.mean(reported) < 0.1


def test_what_begins_before_the_first_frame_begins_there() -> None:
    found, _ = estimate_onset(TIMES, np.ones(len(TIMES)), 0.01, 1.0)
    assert found < TIMES[5]
