"""Which positions are there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]


def find_seen(positions: NDArray[np.float64]) -> Mask:
    """Whether each position is known.

    ``positions`` (..., 3): NaN in any coordinate means that the point was not seen.
    Returns bool (...).
    """
    return np.asarray(np.isfinite(positions).all(axis=-1))


def find_shown(positions: NDArray[np.float64]) -> Mask:
    """Which markers some frame shows.

    ``positions`` (n_frames, n_markers, 3). Returns bool (n_markers,).
    """
    return np.asarray(find_seen(positions).any(axis=0))
