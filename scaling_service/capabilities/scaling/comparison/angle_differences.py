"""How far two methods' joint angles are apart in the same frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Difference:
    """Of two curves, over the frames in which both are known; NaN where there are none.

    Parameters
    ----------
    frames : int
    rms, mean, largest : float
        In the curves' unit; ``mean`` is first minus second.
    """

    frames: int
    rms: float
    mean: float
    largest: float


def difference(first: Array, second: Array) -> Difference:
    """The difference of two curves.

    Parameters
    ----------
    first, second : ndarray, shape (n_frames,)
        NaN where not known.

    Examples
    --------
    >>> found = difference(np.array([1.0, 2.0, np.nan]), np.array([4.0, -2.0, 0.0]))
    >>> found.frames, round(found.rms, 6), found.mean, found.largest
    (2, 3.535534, 0.5, 4.0)
    """
    apart = first - second
    known = apart[np.isfinite(apart)]
    if not known.size:
        return Difference(0, np.nan, np.nan, np.nan)
    return Difference(
        int(known.size),
        float(np.sqrt(np.mean(known**2))),
        float(known.mean()),
        float(np.abs(known).max()),
    )
