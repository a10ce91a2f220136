"""What the residuals of a fit say about its noise: how large, and for how many frames it lasts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scaling_service.kernels.laws import Array
from scaling_service.kernels.masks import seen
from scaling_service.kernels.problem import Problem, residuals

_RESOLUTION_M = 1e-6  # chosen: no camera resolves less, so a perfect fit is not taken for certainty
_FADED = 0.05  # chosen: autocorrelation below which the rest of its sum is noise


@dataclass(frozen=True, slots=True)
class Noise:
    """Noise of one marker coordinate.

    Parameters
    ----------
    variance : float, m2
        Of one frame.
    lasts : float
        Frames that carry the information of one, at least 1 (the integrated autocorrelation time;
        Sokal 1997): soft tissue moves slowly, so neighbouring frames repeat each other.
    """

    variance: float
    lasts: float

    @property
    def effective(self) -> float:
        """The variance that each frame would have if frames were independent, m2."""
        return self.variance * self.lasts


def residual_noise(problem: Problem, q: Array, p: Array) -> Noise:
    """Noise from the residuals at a solution, with the degrees of freedom that the fit left.

    Parameters
    ----------
    q : ndarray, shape (n_frames, n_coordinates)
    p : ndarray, shape (n_parameters,)

    Notes
    -----
    Frames are taken in their order; weights scale the residuals.
    """
    shown = seen(problem.measured)
    gaps = residuals(problem, q, p) * np.sqrt(problem.weights)[:, None]
    gaps = np.where(shown[:, :, None], gaps, 0.0).reshape(problem.n_frames, -1)
    total = float((gaps**2).sum())
    spent = problem.n_frames * len(problem.coordinates) + len(problem.parameters)
    left = max(3 * int(shown.sum()) - spent, 1)
    variance = max(total / left, _RESOLUTION_M**2)
    return Noise(variance, _lasting(gaps, total))


def _lasting(gaps: Array, total: float) -> float:
    """Integrated autocorrelation time of rows in order, in rows."""
    lasting = 1.0
    if total <= 0.0:
        return lasting
    for lag in range(1, len(gaps) // 2):
        share = float((gaps[:-lag] * gaps[lag:]).sum()) / total
        if share < _FADED:
            break
        lasting += 2.0 * share
    return lasting
