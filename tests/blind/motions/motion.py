"""Coordinates over time with exact rates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.signal import butter, sosfiltfilt

from tests.blind.body import Array

RATE_HZ = 100.0
MARGIN_S = 0.5
"""Cut off at both ends, where filters and splines have less to go by."""


@dataclass(frozen=True)
class Motion:
    """A movement.

    Parameters
    ----------
    name : str
    times : ndarray, shape (n,), s
    coordinates : names, length k
    q, qd, qdd : ndarray, shape (n, k), rad, m, s
    """

    name: str
    times: Array
    coordinates: tuple[str, ...]
    q: Array
    qd: Array
    qdd: Array

    def column(self, coordinate: str) -> Array:
        """One coordinate over time, (n,)."""
        column: Array = self.q[:, self.coordinates.index(coordinate)]
        return column

    def ordered(self, coordinates: tuple[str, ...]) -> Motion:
        """The same with its coordinates in another order."""
        order = [self.coordinates.index(c) for c in coordinates]
        return Motion(
            self.name, self.times, coordinates, self.q[:, order], self.qd[:, order], self.qdd[:, order]
        )

    def with_coordinate(self, name: str, values: Array) -> Motion:
        """One more coordinate, given at ``times``."""
        added = rates(self.times, values[:, None])
        parts = (np.hstack([a, b]) for a, b in zip((self.q, self.qd, self.qdd), added, strict=True))
        return Motion(self.name, self.times, (*self.coordinates, name), *parts)


def clock(duration_s: float, rate_hz: float = RATE_HZ) -> Array:
    """Frame times with the margins, s; zero is the first frame that is kept."""
    n = round((duration_s + 2 * MARGIN_S) * rate_hz)
    return np.arange(n) / rate_hz - MARGIN_S


def rates(times: Array, q: Array) -> tuple[Array, Array, Array]:
    """Values, first and second derivatives of the quintic spline through samples (n, k)."""
    spline = make_interp_spline(times, q, k=5)
    return q, spline.derivative(1)(times), spline.derivative(2)(times)


def low_passed(q: Array, cutoff_hz: float, rate_hz: float = RATE_HZ) -> Array:
    """Zero-phase Butterworth of fourth order."""
    filtered: Array = sosfiltfilt(butter(2, cutoff_hz / (rate_hz / 2), output="sos"), q, axis=0)
    return filtered


def finished(name: str, times: Array, columns: Mapping[str, Array]) -> Motion:
    """A motion from coordinates on ``clock``'s times, margins cut off."""
    q, qd, qdd = rates(times, np.stack([np.broadcast_to(c, times.shape) for c in columns.values()], axis=1))
    kept = (times > -1e-9) & (times < times[-1] - MARGIN_S + 1e-9)
    return Motion(name, times[kept], tuple(columns), q[kept], qd[kept], qdd[kept])


def wander(
    rng: np.random.Generator,
    times: Array,
    rms: float,
    low_hz: float = 0.2,
    high_hz: float = 1.5,
    terms: int = 6,
) -> Array:
    """A smooth random signal between two frequencies with zero mean and this RMS, shape (n,)."""
    frequencies = rng.uniform(low_hz, high_hz, terms)
    phases = rng.uniform(0, 2 * np.pi, terms)
    weights = rng.normal(size=terms)
    signal = np.cos(2 * np.pi * frequencies * times[:, None] + phases) @ weights
    signal -= signal.mean()
    result: Array = signal * rms / np.sqrt(np.mean(signal**2))
    return result
