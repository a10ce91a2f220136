"""Which markers and which frames carry the uncertainty of a residual.

Every marker has errors of its own size. Inverse kinematics passes them on to the coordinates by
``P = (J^T W J)^-1 J^T W``, the filter and the differences pass those on to the wrench. A marker's error has a
part of its own and a part that all markers of its segment have in common. How large they are is told by the
marker's residual, which is what the model cannot follow of both. All parts are taken as independent, so that
variances add up and each segment and marker has its share.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.dynamics.uncertainty.jacobian import LAGS, WrenchJacobian, wrench_jacobians
from scaling_service.capabilities.dynamics.uncertainty.linear import noise_factors
from scaling_service.capabilities.dynamics.uncertainty.reference import Recording, Reference
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.tree import jacobian, marker_positions, positions
from scaling_service.numerics.signals.filters import butterworth

SHARED = 0.75
"""Share of the variance of a marker's error that is its segment's: skin markers move together by about 18
mm and against each other by 4 to 16 mm (fluoroscopy of six knees, PMC8631460), so about 18^2 / (18^2 +
10^2)."""

_STEADY = 1e-9  # of the mean diagonal: keeps a frame solvable in which too few markers are seen
_LEAST = 0.1
"""Least variance that a unit error leaves of its marker (chosen): a marker that the model follows entirely
shows nothing of its error, which then counts as three times what is left."""

_THIN = 10
"""Of the frames, every tenth tells how much of an error is left (chosen: it hardly changes from frame to
frame)."""


@dataclass(frozen=True, slots=True, eq=False)
class MarkerUncertainty:
    """How the markers' errors show in the residual wrench.

    Parameters
    ----------
    markers : tuple of str
    sd_m : ndarray, shape (n_markers,)
        Standard deviation of the part of each marker's error that is its own, per direction, after the
        filter.
    leverage : ndarray, shape (n_markers,)
        Share of a marker's error that the model follows, mean over the frames.
    correlation : ndarray, shape (len(LAGS),)
        Of these errors between frames 0, 1, 2 … apart.
    frames : ndarray of int, shape (n,)
        The frames used.
    covariance : ndarray, shape (n, 6, 6), N and N m
        Of each frame's residual wrench.
    shares : ndarray, shape (n_markers, 6)
        Of the mean variance of each component; a segment's common part is divided among its markers.
    """

    markers: tuple[str, ...]
    sd_m: Array
    leverage: Array
    correlation: Array
    frames: NDArray[np.intp]
    covariance: Array
    shares: Array

    @property
    def sd(self) -> Array:
        """Standard deviation of each frame's residual wrench, shape (n, 6), N and N m."""
        return np.asarray(np.sqrt(np.einsum("ncc->nc", self.covariance)))


def marker_uncertainty(
    recording: Recording, *, sd_m: Mapping[str, float] | None = None, shared: float = SHARED
) -> MarkerUncertainty:
    """Propagate each marker's error to the residual wrench.

    Parameters
    ----------
    recording : Recording
    sd_m : mapping, optional
        Marker to the standard deviation of its own error per direction, m, after the filter. Unless given:
        as large as its filtered residual tells.
    shared : float
        Share of the variance of a marker's whole error that its segment's markers have in common, below 1.

    Raises
    ------
    TrialUnusable, InputError
        As ``propagate``.
    """
    reference = Reference.of(recording, "all")
    names = recording.motion.markers
    weights = np.array([recording.model.marker(name).weight for name in names])
    left = _filtered_residuals(reference)
    correlation = _correlation(left, reference)
    spread = noise_factors(correlation)
    leverage, size = _sizes(reference, left, weights, shared)
    sizes = size if sd_m is None else np.array([sd_m.get(n, v) for n, v in zip(names, size, strict=True)])
    together = _together(reference, sizes, shared)
    covariances, frames, variance = [], [], np.zeros((len(names), 6))
    for block in wrench_jacobians(reference):
        effect = _effect(block, _followed(reference, block, weights)[0], spread)
        own, common = (
            effect * sizes[None, None, None, :, None],
            np.einsum("nscma,gm->nscga", effect, together),
        )
        covariances.append(_outer(own) + _outer(common))
        by_segment = (common**2).sum(axis=(0, 1, 4)).T
        weight = together**2 / np.maximum((together**2).sum(axis=1, keepdims=True), np.finfo(float).tiny)
        variance += (own**2).sum(axis=(0, 1, 4)).T + weight.T @ by_segment
        frames.append(block.rows)
    return MarkerUncertainty(
        names,
        sizes,
        leverage,
        correlation,
        np.concatenate(frames),
        np.concatenate(covariances),
        variance / variance.sum(axis=0),
    )


def _sizes(reference: Reference, left: Array, weights: Array, shared: float) -> tuple[Array, Array]:
    """Mean leverage of each marker, and the standard deviation of its own error per direction, m.

    What is left of errors e is ``(1 - J P) e``: the variance that unit errors would leave of each marker is
    compared with what is left of it.
    """
    count = len(weights)
    common = _together(reference, np.ones(count), shared)
    leverages, remains = [], []
    for block in wrench_jacobians(reference, every=_THIN):
        gain, moved, seen = _followed(reference, block, weights)
        n = len(gain)
        follows = moved.reshape(n, moved.shape[1], -1).transpose(0, 2, 1) @ gain.reshape(n, gain.shape[1], -1)
        follows = follows.reshape(n, count, 3, count, 3)
        leverages.append(np.where(seen, np.einsum("nmama->nm", follows) / 3.0, np.nan))
        rest = np.eye(3 * count).reshape(count, 3, count, 3) - follows
        own = np.einsum("nmakb,nmakb->nm", rest, rest)
        joint = np.einsum("nmakb,gk->nmagb", rest, common, optimize=True)
        whole = own + np.einsum("nmagb,nmagb->nm", joint, joint)
        remains.append(np.where(seen, whole / 3.0, np.nan))
    unit = np.nanmean(np.concatenate(remains), axis=0)
    variance = np.nanmean((left**2).sum(axis=1), axis=1) / 3.0
    leverage = np.asarray(np.nanmean(np.concatenate(leverages), axis=0))
    return leverage, np.asarray(np.sqrt(variance / np.maximum(unit, _LEAST)))


def _together(reference: Reference, sizes: Array, shared: float) -> Array:
    """How far each segment's common error moves each marker, shape (n_links, n_markers), m."""
    links = reference.body.tree.marker_link
    on = links[None, :] == np.arange(len(reference.body.tree.links))[:, None]
    mean = np.divide(on @ sizes**2, on.sum(axis=1), out=np.zeros(len(on)), where=on.any(axis=1))
    return np.asarray(on * np.sqrt(shared / (1.0 - shared) * mean)[:, None])


def _filtered_residuals(reference: Reference) -> Array:
    """Measured minus model after the filter, (n_markers, 3, n), m; NaN where not seen."""
    body, low_pass = reference.body, reference.low_pass
    placed = np.moveaxis(marker_positions(body.tree, np.nan_to_num(reference.q.T), body.p), 0, -1)
    known = (reference.seen > 0) & np.isfinite(reference.q).all(axis=0)
    left = np.where(known[:, None], reference.measured - placed, np.nan)
    filtered = butterworth(
        np.moveaxis(left, -1, 0),
        rate_hz=low_pass.rate_hz,
        cutoff_hz=low_pass.cutoff_hz,
        order=low_pass.order,
    )
    return np.asarray(np.moveaxis(filtered.values, 0, -1))


def _correlation(left: Array, reference: Reference) -> Array:
    """Of filtered residuals between neighbouring frames, all markers together, shape (len(LAGS),)."""
    n = reference.n_frames
    found = [np.nanmean(left[..., : n - lag] * left[..., lag:]) for lag in range(len(LAGS))]
    return np.asarray(np.array(found) / found[0])


def _followed(
    reference: Reference, block: WrenchJacobian, weights: Array
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """How inverse kinematics follows the markers in every frame.

    Returns
    -------
    gain, moved : ndarray, shape (n, n_varied, n_markers, 3)
        Coordinates by marker errors, and markers by coordinates.
    seen : ndarray of bool, shape (n, n_markers)
    """
    tree, poses = reference.body.tree, block.poses
    by_variable = jacobian(tree, poses, positions(tree, poses), reference.varied)[..., block.kept]
    moved = np.ascontiguousarray(np.moveaxis(by_variable, -1, 0))
    seen = reference.seen[:, block.rows].T > 0
    weighted = moved * (weights * seen)[:, None, :, None]
    n, count = moved.shape[:2]
    normal = weighted.reshape(n, count, -1) @ moved.reshape(n, count, -1).transpose(0, 2, 1)
    steady = _STEADY * np.einsum("nvv->n", normal) / count
    normal += steady[:, None, None] * np.eye(count)
    gain = np.linalg.solve(normal, weighted.reshape(n, count, -1))
    return np.asarray(gain).reshape(moved.shape), moved, seen


def _effect(block: WrenchJacobian, gain: Array, spread: Array) -> Array:
    """What a unit error of each marker does to the wrench, factor by factor of the noise in time.

    Returns
    -------
    ndarray, shape (n, n_factors, 6, n_markers, 3)
    """
    factors = np.einsum("ls,lvcn->nscv", spread, block.by_lag, optimize=True)
    n, count, _, varied = factors.shape
    effect = factors.reshape(n, -1, varied) @ gain.reshape(n, varied, -1)
    return np.asarray(effect.reshape(n, count, 6, gain.shape[2], 3))


def _outer(effect: Array) -> Array:
    """Covariance of independent errors, (n, s, 6, m, 3) to (n, 6, 6)."""
    flat = np.moveaxis(effect, 2, 1).reshape(len(effect), 6, -1)
    return np.asarray(flat @ flat.transpose(0, 2, 1))
