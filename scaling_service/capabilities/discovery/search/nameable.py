"""From which size an effect is named at all."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy

from scaling_service.capabilities.discovery.laws.additions import Sized
from scaling_service.capabilities.discovery.search.judging import Fitted
from scaling_service.numerics.multibody.laws import Array

POWER = 0.9
"""Of naming an effect of the smallest size that is called nameable."""


def smallest_nameable(effect: Sized, fitted: Fitted, level: float) -> Mapping[str, float]:
    """Sizes of the columns, in proportion as found, from which nine in ten would pass the first gate.

    Parameters
    ----------
    level : float
        P-value that one candidate must reach.
    """
    k = len(fitted.size)
    spread = np.sqrt(np.diag(fitted.covariance)) if k else np.zeros(0)
    if not k or not np.isfinite(fitted.freedom) or fitted.freedom < 2.0 or not spread.all():
        return {}
    needed = scipy.stats.f.isf(level, k, fitted.freedom)

    def missed(strength: float) -> float:
        return float(scipy.stats.ncf.sf(needed, k, fitted.freedom, strength)) - POWER

    top = 10.0
    while missed(top) < 0.0 and top < 1e9:
        top *= 4.0
    strength = scipy.optimize.brentq(missed, 1e-9, top) if missed(top) > 0.0 else float("inf")
    found: Array = effect.size
    own = float(found @ np.linalg.pinv(fitted.covariance) @ found)
    share = np.sqrt(strength / own) if own > 0.0 else float("inf")
    return {
        column.name: abs(column.unit * size) * share
        for column, size in zip(effect.candidate.columns, found.tolist(), strict=True)
    }
