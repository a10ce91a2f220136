"""A mass on a spring and damper whose other end is shaken: how far it lags behind."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.linalg import expm

from tests.blind.body import Array


def accelerations(times: Array, path: Array) -> Array:
    """Second derivative of the quintic spline through positions (n, 3), m/s^2."""
    second: Array = make_interp_spline(times, path, k=5).derivative(2)(times)
    return second


def lag(times: Array, shaking: Array, frequency_hz: float, damping: float) -> tuple[Array, Array]:
    """Displacement of the mass against its support, and its second derivative, in an inertial frame.

    ``s'' + 2 damping w s' + w^2 s = -shaking``, w = 2 pi frequency, solved exactly for a shaking that is
    linear between the samples; it starts where a slow shaking would hold it.

    Parameters
    ----------
    times : ndarray, shape (n,), s
    shaking : ndarray, shape (n, 3), m/s^2
        Acceleration of the support.
    """
    w = 2 * np.pi * frequency_hz
    dt = float(times[1] - times[0])
    # States s, s' with the input and its slope as two more: the exact step for a linear input.
    system = np.zeros((4, 4))
    system[0, 1] = 1.0
    system[1] = [-(w**2), -2 * damping * w, -1.0, 0.0]
    system[2, 3] = 1.0
    step = expm(system * dt)
    s = np.empty((len(times), 2, shaking.shape[1]))
    slope = np.diff(shaking, axis=0) / dt
    s[0] = [-shaking[0] / w**2, -slope[0] / w**2]
    for n in range(len(times) - 1):
        s[n + 1] = step[:2, :2] @ s[n] + np.outer(step[:2, 2], shaking[n]) + np.outer(step[:2, 3], slope[n])
    second = -(w**2) * s[:, 0] - 2 * damping * w * s[:, 1] - shaking
    return s[:, 0], second
