"""A residual's uncertainty by linear propagation of covariance: Muller's numbers without samples.

Filtered white noise of a coordinate is stationary, with a known autocovariance r. With K_l the derivative of
frame i's wrench with respect to the coordinates of frame i + l,

    Cov(W_i) = sigma^2 sum_{l, m} r(l - m) K_l K_m^T,

and with the markers' own derivatives J, Cov(x_i) = sigma^2 r(0) J J^T. Both indicators then follow as
functions of sigma, and so does the dispersion of one where the other is uniform. The wrench of frame i is a
function of the coordinates of frames i - HALO … i + HALO through their central differences.
"""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import toeplitz
from scipy.special import erf

from scaling_service.capabilities.dynamics.uncertainty import reference as references
from scaling_service.core.arrays import Array
from scaling_service.core.errors import InputError
from scaling_service.numerics.multibody import motion as motions
from scaling_service.numerics.multibody import tree as trees
from scaling_service.numerics.wrench import differentiate_wrench

LAGS = tuple(range(-references.HALO, references.HALO + 1))
"""Frames that a wrench depends on, relative to its own."""

UNIFORM_RANGE = np.sqrt(12.0)
"""Range of a uniform distribution over its standard deviation (Muller et al. 2017, eq. 10)."""

BEYOND = 0.1
"""Reference errors that the database reaches beyond the largest level (chosen; the paper: "arbitrarily")."""

EXACT_M = 1e-6
"""Reconstruction error below which markers are followed exactly (chosen: far below any camera's noise)."""

_BLOCK = 120  # frames together: 35 coordinates times 192 components are 7 MB
_GRID = 400  # sizes of the noise, and errors of a level: spread change by less than 1e-4 beyond


@dataclass(frozen=True, slots=True, eq=False)
class WrenchJacobian:
    """Derivatives of the residual wrench about the root segment's origin for a block of frames."""

    rows: NDArray[np.intp]  # (n,): frames, all of them used
    # (len(LAGS), n_varied, 6, n), N and N m per rad and m: with respect to the varied coordinates at frames
    # ``rows + lag``
    by_lag: Array
    poses: trees.Poses  # of these frames with their halo on both sides
    kept: NDArray[np.intp]  # (n,): where these frames stand in ``poses``


def compute_wrench_jacobians(
    reference: references.Reference, *, every: int = 1
) -> abc.Iterator[WrenchJacobian]:
    """Derivatives of the wrench of every frame used, or of every tenth and so on, in blocks."""
    for start, stop in reference.spans:
        for at in range(start, stop - 2 * references.HALO, _BLOCK):
            whole = slice(at, min(at + _BLOCK + 2 * references.HALO, stop))
            rows = np.arange(whole.start + references.HALO, whole.stop - references.HALO)
            kept = reference.used[rows] & (rows % every == 0)
            if kept.any():
                poses = trees.pose_links(
                    reference.tree, np.ascontiguousarray(reference.q[:, whole]), reference.p
                )
                by_lag = _by_lag(reference, reference.q[:, whole], reference.external[:3, rows])
                yield WrenchJacobian(
                    rows[kept], by_lag[..., kept], poses, references.HALO + np.flatnonzero(kept)
                )


def _by_lag(reference: references.Reference, q: Array, external: Array) -> Array:
    """All derivatives, (len(LAGS), n_varied, 6, n); ``external`` is the loads' force, (3, n).

    The wrench of a frame depends on its coordinates and their rates, and these, as differences, on the
    coordinates of the frames around it. ``q``: (n_coordinates, n + 2 HALO).
    """
    step = reference.step_s
    motion = motions.Motion(
        q[:, references.HALO : -references.HALO],
        references.difference_once(q, step),
        references.difference_twice(q, step),
    )
    screws = motions.list_screws(reference.mechanism, motion, reference.p, reference.varied)
    wrench, rates = differentiate_wrench(reference.mechanism, screws, len(reference.varied))
    by = rates.transpose(2, 3, 1, 0)  # q, qdot and qddot first
    # about the moving root, needed and provided alike: M - root x F
    root = screws.state.poses.origins[0]
    by[:, :, 3:] -= trees.cross(root, by[:, :, :3])
    carried = np.zeros((len(reference.varied), 3, motion.n))
    on_root = np.flatnonzero(reference.mechanism.carriers[screws.entries, 0])
    turns = screws.rates[0, on_root]
    np.add.at(carried, screws.columns[on_root], turns[:, :3] + trees.cross(turns[:, 3:], root))
    by[0, :, 3:] -= trees.cross(carried, wrench[:3] - external)
    first = [-w / step for w in references.SLOPES[::-1]] + [0.0] + [w / step for w in references.SLOPES]
    second = [
        w / step**2 for w in (*references.STENCIL[::-1], -2.0 * sum(references.STENCIL), *references.STENCIL)
    ]
    result = np.array([a * by[1] + b * by[2] for a, b in zip(first, second, strict=True)])
    result[references.HALO] += by[0]
    return result


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class KinematicUncertainty:
    """What the motion's uncertainty does to the residual; arrays (6,) as ``WrenchUncertainty`` has them."""

    error_m: float  # the reference's reconstruction error
    dr: Array
    slopes_per_cm: Array
    kinematic: Array
    r2: Array
    r2_centred: Array


def propagate_motion_noise(
    reference: references.Reference, levels: abc.Sequence[float]
) -> KinematicUncertainty:
    """Muller's spread of the indicator at levels of added reconstruction error, in closed form.

    ``levels``: over the reference's error. Raises InputError: the markers are followed without any error, so
    that nothing scales a perturbation.
    """
    error, dr = compute_error_and_indicator(reference)
    spread = factor_noise(reference.low_pass.autocovariance(len(LAGS) - 1))
    covariances, apart, spreads = [], [], []
    for block in compute_wrench_jacobians(reference):
        # Of coordinates with independent noise of unit size, shape (n, 6, 6).
        factors = np.einsum("ls,lvcn->nsvc", spread, block.by_lag, optimize=True)
        joined = factors.reshape(len(factors), -1, 6)
        covariances.append(np.asarray(joined.transpose(0, 2, 1) @ joined))
        # Of all markers seen in all frames: distance from the model's, and spread for unit size of the
        # noise. Both are flat, in m; the spread is the standard deviation per direction, mean over the
        # three.
        tree, poses = reference.tree, block.poses
        placed = trees.place_tree_markers(tree, poses)
        moved = trees.compute_jacobian(tree, poses, placed, reference.varied)[..., block.kept]
        gaps = placed[..., block.kept] - reference.measured[..., block.rows]
        seen = reference.seen[:, block.rows] > 0
        widths = np.sqrt(np.einsum("vman,vman->mn", moved, moved) / 3.0)
        away, wide = np.linalg.norm(gaps, axis=1)[seen], widths[seen]
        apart.append(away)
        spreads.append(wide)
    covariance = np.concatenate(covariances)
    away = np.concatenate(apart)
    wide = np.concatenate(spreads) * np.sqrt(reference.low_pass.autocovariance(0)[0])
    # Sizes of noise from none to one whose expected error is `reach` times the reference's.
    reach = 1.0 + max(levels) + BEYOND
    largest = error / float(wide.mean())
    while _expect_distance(away, largest * wide).mean() < reach * error:
        largest *= 1.5
    sizes = np.linspace(0.0, largest, _GRID)
    errors = np.array([_expect_distance(away, size * wide).mean() for size in sizes])
    # the reference's own place on the curve: the frames used only
    errors *= error / errors[0]
    variance = np.einsum("ncc->nc", covariance).mean(axis=0) / reference.scale**2
    indicators = np.sqrt(dr**2 + np.outer(sizes**2, variance))
    dispersions = []
    for level in levels:
        # Of the indicators, where the error is uniform up to a level; shape (6,).
        wanted = error * (1.0 + level * (np.arange(_GRID) + 0.5) / _GRID)
        found = np.array([np.interp(wanted, errors, column) for column in indicators.T])
        dispersions.append(np.asarray(UNIFORM_RANGE * found.std(axis=1)))
    dispersion = np.array(dispersions)
    slopes, r2, centred = fit_slopes_through_zero(1e2 * error * np.array(levels), dispersion)  # per cm
    return KinematicUncertainty(
        error_m=error,
        dr=dr,
        slopes_per_cm=slopes,
        kinematic=1e2 * error * slopes,
        r2=r2,
        r2_centred=centred,
    )


def compute_error_and_indicator(reference: references.Reference) -> tuple[float, Array]:
    """Of the reference motion itself, which must not follow its markers exactly."""
    error, residual = reference.residual(reference.q)
    if error < EXACT_M:
        raise InputError(
            "the model follows its markers without error, so nothing tells how uncertain the motion is",
            file=reference.trial,
            field="markers",
            remedy="Give the measured markers with the motion",
        )
    return error, reference.indicator(residual)


def fit_slopes_through_zero(x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Least-squares lines without intercept, and how well they fit.

    Of x (n,) and y (n, k): slopes (k,), ``r2 = 1 - SSE / sum y^2`` (right without intercept: Eisenhauer 2003,
    Teach Stat 25:76-80), and the centred ``1 - SSE / sum (y - mean)^2``, which is never larger.

    Examples
    --------
    >>> import numpy as np
    >>> fitted = fit_slopes_through_zero(np.array([1.0, 2.0]), np.array([[2.0], [4.0]]))
    >>> [values.tolist() for values in fitted]
    [[2.0], [1.0], [1.0]]
    """
    slopes = x @ y / (x @ x)
    left = ((y - np.outer(x, slopes)) ** 2).sum(axis=0)
    centred = 1.0 - left / ((y - y.mean(axis=0)) ** 2).sum(axis=0)
    return slopes, 1.0 - left / (y**2).sum(axis=0), centred


def factor_noise(autocovariance: Array) -> Array:
    """Weights S, (n_lags, n_factors), with ``S S^T`` the covariance of neighbouring frames."""
    values, vectors = np.linalg.eigh(toeplitz(autocovariance))
    return np.asarray(vectors * np.sqrt(np.clip(values, 0.0, None)))


def _expect_distance(away: Array, wide: Array) -> Array:
    """Expected length of a vector of length ``away`` plus Gaussian noise alike in all directions.

    With ``a`` the length and ``s`` the standard deviation per direction, the mean of the noncentral Maxwell
    distribution: ``s sqrt(2/pi) exp(-a^2 / 2 s^2) + (a + s^2 / a) erf(a / s sqrt 2)``.

    Examples
    --------
    >>> [round(float(x), 6) for x in _expect_distance(np.array([5.0, 1e-9]), np.array([1e-9, 1.0]))]
    [5.0, 1.595769]
    """
    a, s = np.maximum(away, 1e-9 * (away.max() + wide.max())), np.maximum(wide, 1e-9 * away.max())
    ratio = a / s
    with np.errstate(under="ignore"):
        expected: Array = s * np.sqrt(2 / np.pi) * np.exp(-0.5 * ratio**2)
    expected += (a + s**2 / a) * erf(ratio / np.sqrt(2.0))
    return expected
