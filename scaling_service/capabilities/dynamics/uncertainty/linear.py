"""A residual's uncertainty by linear propagation of covariance: Muller's numbers without samples.

Filtered white noise of a coordinate is stationary, with a known autocovariance r. With K_l the derivative of
frame i's wrench with respect to the coordinates of frame i + l,

    Cov(W_i) = sigma^2 sum_{l, m} r(l - m) K_l K_m^T,

and with the markers' own derivatives J, Cov(x_i) = sigma^2 r(0) J J^T. Both indicators then follow as
functions of sigma, and so does the dispersion of one where the other is uniform.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import toeplitz
from scipy.special import erf

from scaling_service.capabilities.dynamics.uncertainty.jacobian import LAGS, WrenchJacobian, wrench_jacobians
from scaling_service.capabilities.dynamics.uncertainty.monte_carlo import (
    BEYOND,
    EXACT_M,
    UNIFORM_RANGE,
    slopes_through_zero,
)
from scaling_service.capabilities.dynamics.uncertainty.reference import NoiseOn, Recording, Reference
from scaling_service.core.errors import InputError
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.tree import jacobian, positions

_CM = 1e2
_GRID = 400  # sizes of the noise, and errors of a level: dispersions change by less than 1e-4 beyond


@dataclass(frozen=True, slots=True, eq=False)
class LinearUncertainty:
    """What linear propagation says of one recording.

    Parameters
    ----------
    frames : ndarray of int, shape (n,)
        The frames used.
    covariance : ndarray, shape (n, 6, 6), N and N m, per rad and m of noise
        Of each frame's residual wrench for white noise of unit size on every coordinate, after the filter.
    error_m : float
        The reference's reconstruction error.
    dr : ndarray, shape (6,)
        Its residual indicator.
    sizes : ndarray, shape (k,), rad and m
        Standard deviations of the noise before the filter.
    errors_m : ndarray, shape (k,)
        Expected reconstruction error at each size.
    indicators : ndarray, shape (k, 6)
        Expected residual indicator at each size.
    levels : tuple of float
    dispersion : ndarray, shape (n_levels, 6)
    slopes_per_cm, kinematic : ndarray, shape (6,)
        As ``WrenchUncertainty`` has them.
    r2 : ndarray, shape (6,)
    """

    frames: NDArray[np.intp]
    covariance: Array
    error_m: float
    dr: Array
    sizes: Array
    errors_m: Array
    indicators: Array
    levels: tuple[float, ...]
    dispersion: Array
    slopes_per_cm: Array
    kinematic: Array
    r2: Array


def propagate_linearly(
    recording: Recording,
    levels: tuple[float, ...] = (0.2, 0.4, 0.6, 0.8, 1.0),
    noise_on: NoiseOn = "rotations",
) -> LinearUncertainty:
    """The kinematic part of Muller's study in closed form.

    Parameters
    ----------
    recording : Recording
    levels : tuple of float
        Largest added reconstruction error over the reference's.
    noise_on : 'rotations' or 'all'
        Coordinates that are perturbed.

    Raises
    ------
    TrialUnusable, InputError
        As ``propagate``.
    """
    return linear_of(Reference.of(recording, noise_on), levels)


def linear_of(reference: Reference, levels: tuple[float, ...]) -> LinearUncertainty:
    """As :func:`propagate_linearly`, of a prepared recording."""
    error, residual = reference.residual(reference.q)
    if error < EXACT_M:
        raise InputError(
            "the model follows its markers without error, so nothing tells how uncertain the motion is",
            file=reference.trial,
            field="markers",
            remedy="Give the measured markers with the motion",
        )
    spread = noise_factors(reference.low_pass.autocovariance(len(LAGS) - 1))
    frames, covariances, apart, spreads = [], [], [], []
    for block in wrench_jacobians(reference):
        frames.append(block.rows)
        covariances.append(_wrench_covariance(block, spread))
        away, wide = _marker_spread(reference, block)
        apart.append(away)
        spreads.append(wide)
    covariance = np.concatenate(covariances)
    away = np.concatenate(apart)
    wide = np.concatenate(spreads) * np.sqrt(reference.low_pass.autocovariance(0)[0])
    dr = reference.indicator(residual)
    sizes = _sizes(error, away, wide, 1.0 + max(levels) + BEYOND)
    errors = np.array([_mean_distance(away, size * wide).mean() for size in sizes])
    # the reference's own place on the curve: the frames used only
    errors *= error / errors[0]
    variance = np.einsum("ncc->nc", covariance).mean(axis=0) / reference.scale**2
    indicators = np.sqrt(dr**2 + np.outer(sizes**2, variance))
    dispersion = np.array([_dispersion(error, level, errors, indicators) for level in levels])
    added = _CM * error * np.array(levels)
    slopes, r2, _ = slopes_through_zero(added, dispersion)
    return LinearUncertainty(
        np.concatenate(frames),
        covariance,
        error,
        dr,
        sizes,
        errors,
        indicators,
        levels,
        dispersion,
        slopes,
        _CM * error * slopes,
        r2,
    )


def noise_factors(autocovariance: Array) -> Array:
    """Weights S, (n_lags, n_factors), with ``S S^T`` the covariance of neighbouring frames."""
    values, vectors = np.linalg.eigh(toeplitz(autocovariance))
    return np.asarray(vectors * np.sqrt(np.clip(values, 0.0, None)))


def _wrench_covariance(block: WrenchJacobian, spread: Array) -> Array:
    """Of coordinates with independent noise of unit size, shape (n, 6, 6)."""
    factors = np.einsum("ls,lvcn->nsvc", spread, block.by_lag, optimize=True)
    joined = factors.reshape(len(factors), -1, 6)
    return np.asarray(joined.transpose(0, 2, 1) @ joined)


def _marker_spread(reference: Reference, block: WrenchJacobian) -> tuple[Array, Array]:
    """Of all markers seen in all frames: distance from the model's, and spread for unit size of the noise.

    Both are flat, in m; the spread is the standard deviation per direction, mean over the three.
    """
    tree, poses = reference.body.tree, block.poses
    placed = positions(tree, poses)
    moved = jacobian(tree, poses, placed, reference.varied)[..., block.kept]
    away = placed[..., block.kept] - reference.measured[..., block.rows]
    seen = reference.seen[:, block.rows] > 0
    wide = np.sqrt(np.einsum("vman,vman->mn", moved, moved) / 3.0)
    return np.linalg.norm(away, axis=1)[seen], wide[seen]


def _sizes(error: float, away: Array, wide: Array, reach: float) -> Array:
    """Sizes of noise from none to one whose expected error is ``reach`` times the reference's."""
    largest = error / float(wide.mean())
    while _mean_distance(away, largest * wide).mean() < reach * error:
        largest *= 1.5
    return np.linspace(0.0, largest, _GRID)


def _mean_distance(away: Array, wide: Array) -> Array:
    """Expected length of a vector of length ``away`` plus Gaussian noise alike in all directions.

    With ``a`` the length and ``s`` the standard deviation per direction, the mean of the noncentral Maxwell
    distribution: ``s sqrt(2/pi) exp(-a^2 / 2 s^2) + (a + s^2 / a) erf(a / s sqrt 2)``.

    Examples
    --------
    >>> [round(float(x), 6) for x in _mean_distance(np.array([5.0, 1e-9]), np.array([1e-9, 1.0]))]
    [5.0, 1.595769]
    """
    a, s = np.maximum(away, 1e-9 * (away.max() + wide.max())), np.maximum(wide, 1e-9 * away.max())
    ratio = a / s
    with np.errstate(under="ignore"):
        expected: Array = s * np.sqrt(2 / np.pi) * np.exp(-0.5 * ratio**2)
    expected += (a + s**2 / a) * erf(ratio / np.sqrt(2.0))
    return expected


def _dispersion(error: float, level: float, errors: Array, indicators: Array) -> Array:
    """Of the indicators, where the error is uniform up to a level; shape (6,)."""
    wanted = error * (1.0 + level * (np.arange(_GRID) + 0.5) / _GRID)
    found = np.array([np.interp(wanted, errors, column) for column in indicators.T])
    return np.asarray(UNIFORM_RANGE * found.std(axis=1))
