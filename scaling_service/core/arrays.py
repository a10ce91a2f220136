"""Names for the arrays of numerical code."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Numbers, in SI units and radians unless a docstring says otherwise."""

Mask = NDArray[np.bool_]
