"""Something on a spring that its support drives: ``u'' + 2 z w u' + w^2 u = -a``."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import scipy

from scaling_service.core.arrays import Array
from scaling_service.numerics.signals.filters import filter_butterworth
from scaling_service.numerics.signals.splines import differentiate_spline

CUTOFF_HZ = 20.0
"""Chosen: above the frequencies of soft tissue, below what differentiation makes of noise."""

_PASS = 2  # order of each of the filter's two passes
_FIRST_S = 0.05  # chosen: long enough to even out noise, short for soft tissue


def compute_pull(places: Array, step: float) -> Array:
    """Minus the acceleration of points, of the shape (n, any) or (n, any, 3), m/s2, in six frames or more."""
    flat = places.reshape(len(places), -1)
    smooth = filter_butterworth(
        flat, rate_hz=1 / step, cutoff_hz=min(CUTOFF_HZ, 0.4 / step), order=2 * _PASS
    ).values
    return -differentiate_spline(step * np.arange(len(flat)), smooth)[1].reshape(places.shape)


def simulate_oscillator(pull: Array, step: float, frequency_hz: float, damping: float) -> tuple[Array, Array]:
    """Displacement (m) and speed (m/s) of oscillators, each shaped as ``pull`` (m/s2).

    At first they rest where a steady pull as strong as that of the first moments would hold them.
    """
    steady = pull[: max(1, round(_FIRST_S / step))].mean(axis=0)
    place, speed = (
        np.asarray(scipy.signal.lfilter(above, below, pull - steady, axis=0))
        for above, below in _design_filters(step, frequency_hz, damping)
    )
    return place + steady / (2.0 * np.pi * frequency_hz) ** 2, speed


@lru_cache(maxsize=512)
def _design_filters(step: float, frequency_hz: float, damping: float) -> tuple[tuple[Array, Array], ...]:
    """Numerators and denominators of place and speed for inputs that run straight from frame to frame."""
    w = 2.0 * np.pi * frequency_hz
    below = [1.0, 2.0 * damping * w, w * w]
    found = []
    for above in ([1.0], [1.0, 0.0]):
        numerator, denominator, _ = scipy.signal.cont2discrete((above, below), step, "foh")
        found.append((np.ravel(numerator), np.asarray(denominator)))
    return tuple(found)
