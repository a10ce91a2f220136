"""How much of the disagreement is noise, told from the recording itself.

A body moves smoothly from frame to frame, a camera's noise does not: third differences of a marker's path
keep the noise and next to nothing of the movement.
"""

from __future__ import annotations

import numpy as np

from scaling_service.numerics.multibody.laws import Array

LEAST_M = 2e-4
"""m; the least noise of a moving marker that is believed (chosen: cameras tell moving markers to some tenths
of a millimetre). Recordings that show less were smoothed before."""

_GROWTH = np.sqrt(20.0)
"""White noise of unit variance has third differences of variance 1 + 9 + 9 + 1."""

_NORMAL = 1.4826
"""Standard deviation over median absolute deviation of a normal distribution."""

_ENOUGH = 30
"""Third differences from which a spread is told (chosen: its own error is then 15 %)."""


def marker_floor(measured: Array) -> Array:
    """Standard deviation of one coordinate's noise for each marker.

    Parameters
    ----------
    measured : ndarray, shape (n_frames, n_markers, 3), m
        Not smoothed; NaN where not seen.

    Returns
    -------
    ndarray, shape (n_markers,), m
        A marker seen too briefly gets the median of the others.
    """
    steps = np.diff(measured, n=3, axis=0)
    spread = np.array([_spread(steps[:, m]) for m in range(measured.shape[1])])
    typical = float(np.nanmedian(spread)) if np.isfinite(spread).any() else LEAST_M
    return np.maximum(np.where(np.isfinite(spread), spread, typical), LEAST_M)


def _spread(steps: Array) -> float:
    known = steps[np.isfinite(steps).all(axis=1)]
    if len(known) < _ENOUGH:
        return float("nan")
    return float(_NORMAL * np.median(np.abs(known)) / _GROWTH)
