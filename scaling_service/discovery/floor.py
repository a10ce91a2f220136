"""How much of the disagreement is noise, told from the recording itself.

A body moves smoothly from frame to frame, a camera's noise does not: third differences of a marker's path
keep the noise and next to nothing of the movement.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scaling_service.kernels.laws import Array

LEAST_M = 2e-4
"""m; moving markers are told no better than this by camera systems (chosen: 0.15 mm at best, Windolf et al.
2008, J Biomech 41:2776). What is smaller comes from recordings that were smoothed before."""

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


def leverage_free(seen: NDArray[np.bool_], left: Array) -> Array:
    """Share of each marker's noise that stays in the residual once the pose has followed it.

    Parameters
    ----------
    seen : ndarray of bool, shape (n_frames, n_markers)
    left : ndarray, shape (n_frames, n_markers)
        One minus the mean leverage of the marker's three coordinates.

    Returns
    -------
    ndarray, shape (n_markers,)
        Of its standard deviation.
    """
    count = np.maximum(seen.sum(axis=0), 1)
    return np.asarray(np.sqrt(np.where(seen, left, 0.0).sum(axis=0) / count))
