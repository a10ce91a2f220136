"""By how much a number may differ from what is held, and why.

Measured on the cases ``scale``, ``scale_otherwise`` and ``dynamics``: with two threads instead of one,
and with the kernels of another processor (``OPENBLAS_CORETYPE=Nehalem``, numpy without AVX2), no number
leaves its tolerance. So no optimisation needs a softer one; a pattern may be added below where one does.
"""

from __future__ import annotations

import re
from dataclasses import dataclass


@dataclass(frozen=True)
class Tolerance:
    """Relative to the number (in a vector or a summary: to the largest one), and at least ``absolute``."""

    pattern: re.Pattern[str]
    relative: float
    absolute: float


RELATIVE = 1e-4
"""Unless said otherwise."""

ABSOLUTE = 1e-6
"""Unless said otherwise: 1 µm, 1 µrad, 1 mg where the unit is not in the name."""


def tolerance(pattern: str, relative: float, absolute: float) -> Tolerance:
    return Tolerance(re.compile(pattern), relative, absolute)


TOLERANCES = (
    # Curves of clinical angles are written with three decimals: a unit of the last one.
    tolerance(r"clinical.*curves", RELATIVE, 1.1e-3),
    # Written with four decimals: a unit of the last one, and half of one for the rounding of the snapshot.
    tolerance(r"_(mm|deg|N|Nm|pct|s|kg)(?=\W|_|$)", RELATIVE, 2e-4),
)
"""The first pattern found in a number's path counts."""


def find_tolerance(path: str) -> tuple[float, float]:
    """Relative and absolute tolerance of a number."""
    for one in TOLERANCES:
        if one.pattern.search(path):
            return one.relative, one.absolute
    return RELATIVE, ABSOLUTE
