"""The span of frames in which something gains most."""

from __future__ import annotations

import numpy as np

from scaling_service.core.arrays import Array


def find_best_span(gains: Array) -> tuple[float, slice]:
    """The neighbouring frames with the largest sum, and that sum; none where nothing is positive.

    Kadane's algorithm (Bentley 1984, Commun ACM 27:865).

    Examples
    --------
    >>> find_best_span(np.array([-1.0, 2.0, -1.0, 3.0, -5.0]))
    (4.0, slice(1, 4, None))
    """
    total = np.concatenate([[0.0], np.cumsum(gains)])
    above = total - np.minimum.accumulate(total)
    end = int(np.argmax(above))
    return float(above[end]), slice(int(np.argmin(total[: end + 1])), end)
