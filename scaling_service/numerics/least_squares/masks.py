"""Which positions are there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]


def seen(positions: NDArray[np.float64]) -> Mask:
    """Whether each position is known.

    ``positions`` (..., 3): NaN in any coordinate means that the point was not seen.
    Returns bool (...).
    """
    return np.asarray(np.isfinite(positions).all(axis=-1))


def ever(flags: Mask) -> Mask:
    """Whether anything is true along the first axis (frames)."""
    return np.asarray(flags.any(axis=0))
