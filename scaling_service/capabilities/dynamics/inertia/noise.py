"""How large the error of a ground wrench is that inertia is not to blame for."""

from __future__ import annotations

import numpy as np

from scaling_service.numerics.multibody.laws import Array

QUIET_N = 0.07
"""Least error of a force: what a plate cannot resolve. 0.22 N at three standard deviations (AMTI's data
sheet as Muller et al. 2017 cite it)."""

_STEPS = 400  # of a grid over the logarithm of the noise: 2 % apart over three decades


def most_likely_noise(gains: Array, slopes: Array, squares: float, count: float) -> float:
    """The noise that makes the recorded errors most likely, whatever the parameters are.

    Parameters
    ----------
    gains : ndarray, shape (k,)
        Eigenvalues of the whitened information at a noise of one.
    slopes : ndarray, shape (k,)
        Slopes at the prior along their vectors, at a noise of one.
    squares : float
        Sum of the squared errors of the prior.
    count : float
        How many independent errors these are.

    Returns
    -------
    float
        Between ``QUIET_N`` and the errors of the prior themselves.

    Notes
    -----
    The marginal likelihood of a linear model with a Gaussian prior (MacKay D. J. C. (1992) Bayesian
    interpolation. Neural Comput 4:415-447): a fit that takes up freedom is not mistaken for small errors.
    """
    largest = max(np.sqrt(squares / count), QUIET_N)
    sizes = np.geomspace(QUIET_N, largest, _STEPS)
    ratio = np.clip(gains, 0.0, None) / sizes[:, None] ** 2
    explained = (slopes**2 / sizes[:, None] ** 4 / (1.0 + ratio)).sum(axis=1)
    cost = count * np.log(sizes) + 0.5 * np.log1p(ratio).sum(axis=1) + 0.5 * (squares / sizes**2 - explained)
    return float(sizes[np.argmin(cost)])
