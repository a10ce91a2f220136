"""Which markers and which frames carry the uncertainty of a residual.

Every marker has errors of its own size. Inverse kinematics passes them on to the coordinates by
``P = (J^T W J)^-1 J^T W``, the filter and the differences pass those on to the wrench. A marker's error has a
part of its own and a part that all markers of its segment have in common. How large they are follows from the
marker's residual, which is what the model cannot follow of both. All parts are taken as independent, so that
variances add up and each segment and marker has its share.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.dynamics.uncertainty import linear
from scaling_service.capabilities.dynamics.uncertainty import reference as references
from scaling_service.core.arrays import Array
from scaling_service.core.errors import InputError
from scaling_service.model import inertia
from scaling_service.numerics.multibody import motion
from scaling_service.numerics.multibody import tree as trees
from scaling_service.numerics.signals.filters import filter_butterworth
from scaling_service.numerics.signals.splines import differentiate_spline
from scaling_service.numerics.wrench import compute_regressor_blocks

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

MASS_SHARE, PLACE_M, TENSOR_SHARE = 0.1, 0.02, 0.2
"""How far parameters of a table may be off (standard deviations; chosen: regressions miss a segment's mass by
about 10 % and its centre of mass by 1 to 3 cm, Dumas et al. 2007 and the tables among each other)."""

INDEPENDENT = 2.0
"""Samples per period of the cutoff that are independent after the filter (Nyquist)."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MarkerUncertainty:
    """How the markers' errors show in the residual wrench."""

    markers: tuple[str, ...]
    # (n_markers,): standard deviation of the part of each marker's error that is its own, per direction,
    # after the filter
    sd_m: Array
    frames: NDArray[np.intp]  # (n,): the frames used
    covariance: Array  # (n, 6, 6), N and N m: of each frame's residual wrench
    # (n_markers, 6): of the mean variance of each component; a segment's common part is divided among its
    # markers
    shares: Array

    @property
    def sd(self) -> Array:
        """Standard deviation of each frame's residual wrench, shape (n, 6), N and N m."""
        return np.asarray(np.sqrt(np.einsum("ncc->nc", self.covariance)))


def propagate_marker_errors(
    recording: references.LoadedMotion, *, sd_m: Mapping[str, float] | None = None, shared: float = SHARED
) -> MarkerUncertainty:
    """Propagate each marker's error to the residual wrench.

    ``sd_m`` are standard deviations of markers' own errors per direction, m, after the filter; unless given,
    they are as large as the filtered residuals tell. ``shared`` is the share of the variance of a marker's
    whole error that its segment's markers have in common, below 1. Errors as ``propagate``.
    """
    reference = references.Reference.of(recording, "all")
    names = recording.motion.markers
    weights = np.array([recording.model.marker(name).weight for name in names])
    # Measured minus model after the filter, (n_markers, 3, n), m; NaN where not seen.
    low_pass = reference.low_pass
    placed = np.moveaxis(trees.pose_markers(reference.tree, np.nan_to_num(reference.q.T), reference.p), 0, -1)
    known = (reference.seen > 0) & np.isfinite(reference.q).all(axis=0)
    unfiltered = np.where(known[:, None], reference.measured - placed, np.nan)
    filtered = filter_butterworth(
        np.moveaxis(unfiltered, -1, 0),
        rate_hz=low_pass.rate_hz,
        cutoff_hz=low_pass.cutoff_hz,
        order=low_pass.order,
    )
    left = np.asarray(np.moveaxis(filtered.values, 0, -1))
    # Of filtered residuals between neighbouring frames, all markers together, shape (len(LAGS),)
    n = reference.n_frames
    found = [np.nanmean(left[..., : n - lag] * left[..., lag:]) for lag in range(len(linear.LAGS))]
    spread = linear.factor_noise(np.asarray(np.array(found) / found[0]))
    size = _estimate_sizes(reference, left, weights, shared)
    sizes = size if sd_m is None else np.array([sd_m.get(n, v) for n, v in zip(names, size, strict=True)])
    together = _spread_common_errors(reference, sizes, shared)
    covariances, frames, variance = [], [], np.zeros((len(names), 6))
    for block in linear.compute_wrench_jacobians(reference):
        # What unit errors of markers do by each factor of the noise in time, (n, n_factors, 6, n_markers,
        # 3)
        gain = _follow(reference, block, weights)[0]
        factors = np.einsum("ls,lvcn->nscv", spread, block.by_lag, optimize=True)
        length, count, _, varied = factors.shape
        effect = factors.reshape(length, -1, varied) @ gain.reshape(length, varied, -1)
        effect = np.asarray(effect.reshape(length, count, 6, gain.shape[2], 3))
        own, common = effect * sizes[:, None], np.einsum("nscma,gm->nscga", effect, together)
        covariances.append(_sum_outer_products(own) + _sum_outer_products(common))
        by_segment = (common**2).sum(axis=(0, 1, 4)).T
        weight = together**2 / np.maximum((together**2).sum(axis=1, keepdims=True), np.finfo(float).tiny)
        variance += (own**2).sum(axis=(0, 1, 4)).T + weight.T @ by_segment
        frames.append(block.rows)
    return MarkerUncertainty(
        markers=names,
        sd_m=sizes,
        frames=np.concatenate(frames),
        covariance=np.concatenate(covariances),
        shares=variance / variance.sum(axis=0),
    )


def _estimate_sizes(reference: references.Reference, left: Array, weights: Array, shared: float) -> Array:
    """Standard deviation of each marker's own error per direction, m.

    What is left of errors e is ``(1 - J P) e``: the variance that unit errors would leave of each marker is
    compared with what is left of it.
    """
    count = len(weights)
    common = _spread_common_errors(reference, np.ones(count), shared)
    remains = []
    for block in linear.compute_wrench_jacobians(reference, every=_THIN):
        gain, moved, seen = _follow(reference, block, weights)
        n = len(gain)
        follows = moved.reshape(n, moved.shape[1], -1).transpose(0, 2, 1) @ gain.reshape(n, gain.shape[1], -1)
        follows = follows.reshape(n, count, 3, count, 3)
        rest = np.eye(3 * count).reshape(count, 3, count, 3) - follows
        own = np.einsum("nmakb,nmakb->nm", rest, rest)
        joint = np.einsum("nmakb,gk->nmagb", rest, common, optimize=True)
        whole = own + np.einsum("nmagb,nmagb->nm", joint, joint)
        remains.append(np.where(seen, whole / 3.0, np.nan))
    unit = np.nanmean(np.concatenate(remains), axis=0)
    variance = np.nanmean((left**2).sum(axis=1), axis=1) / 3.0
    return np.asarray(np.sqrt(variance / np.maximum(unit, _LEAST)))


def _spread_common_errors(reference: references.Reference, sizes: Array, shared: float) -> Array:
    """How far each segment's common error moves each marker, shape (n_links, n_markers), m."""
    links = reference.tree.marker_link
    on = links[None, :] == np.arange(len(reference.tree.links))[:, None]
    mean = np.divide(on @ sizes**2, on.sum(axis=1), out=np.zeros(len(on)), where=on.any(axis=1))
    return np.asarray(on * np.sqrt(shared / (1.0 - shared) * mean)[:, None])


def _follow(
    reference: references.Reference, block: linear.WrenchJacobian, weights: Array
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """How inverse kinematics follows the markers in every frame.

    Coordinates by marker errors and markers by coordinates, both (n, n_varied, n_markers, 3), and which are
    seen, (n, n_markers).
    """
    tree, poses = reference.tree, block.poses
    by_variable = trees.compute_jacobian(
        tree, poses, trees.place_tree_markers(tree, poses), reference.varied
    )[..., block.kept]
    moved = np.ascontiguousarray(np.moveaxis(by_variable, -1, 0))
    seen = reference.seen[:, block.rows].T > 0
    weighted = moved * (weights * seen)[:, None, :, None]
    n, count = moved.shape[:2]
    normal = weighted.reshape(n, count, -1) @ moved.reshape(n, count, -1).transpose(0, 2, 1)
    steady = _STEADY * np.einsum("nvv->n", normal) / count
    normal += steady[:, None, None] * np.eye(count)
    gain = np.linalg.solve(normal, weighted.reshape(n, count, -1))
    return np.asarray(gain).reshape(moved.shape), moved, seen


def _sum_outer_products(effect: Array) -> Array:
    """Covariance of independent errors, (n, s, 6, m, 3) to (n, 6, 6)."""
    flat = np.moveaxis(effect, 2, 1).reshape(len(effect), 6, -1)
    return np.asarray(flat @ flat.transpose(0, 2, 1))


@dataclass(frozen=True, slots=True)
class Window:
    """A piece of a recording."""

    # start, stop: frames
    start: int
    stop: int
    gain: float  # information that it adds to the windows before it, nats
    # mean standard deviation of the residual force over body weight, the three directions' mean
    uncertainty: float


@dataclass(frozen=True, slots=True, eq=False)
class FrameChoice:
    """Windows in the order in which they are worth taking."""

    windows: tuple[Window, ...]
    total: float  # information of the whole recording, nats

    @property
    def share(self) -> float:
        """Information of the chosen windows over that of all frames."""
        return sum(w.gain for w in self.windows) / self.total


def choose_frames(
    recording: references.LoadedMotion,
    uncertainty: MarkerUncertainty,
    *,
    window_s: float = 1.0,
    count: int = 10,
) -> FrameChoice:
    """The windows that tell most of the inertial parameters, given how uncertain each frame is.

    Muller et al. 2017 (sec. 3.3) propose sequences of small uncertainty, of good excitation, or both. Here a
    window is worth the information that it adds about the inertial parameters, its frames weighted by the
    inverse covariance of their residual wrench; windows are taken one by one, the best first (greedy
    D-optimality), until there are ``count`` or no more. Refuses one shorter than one independent sample.
    """
    if count < 1 or window_s * recording.cutoff_hz * INDEPENDENT < 1.0:
        raise InputError(
            f"{count} windows of {window_s:g} s cannot be chosen",
            field="window_s",
            remedy="Take one window at least, of 1 s",
        )
    reference = references.Reference.of(recording, "all")
    length = round(window_s / reference.step_s)
    thin = max(1, round(reference.low_pass.rate_hz / (INDEPENDENT * recording.cutoff_hz)))
    picked = np.arange(0, len(uncertainty.frames), thin)
    place = uncertainty.frames[picked] // length
    # Window number to its information in units of what a table leaves open
    rows, q = uncertainty.frames[picked], reference.q.T
    first, second = differentiate_spline(recording.motion.times, q)
    rates = motion.Motion.of_frames(q[rows], first[rows], second[rows])
    blocks = compute_regressor_blocks(inertia.compile_mechanism(recording.model), rates, reference.p)
    regressor = np.concatenate([block for _, block in blocks])
    # Standard deviation of all inertial parameters before the recording, shape (10 n_segments,).
    inertias = inertia.gather_inertias(recording.model)
    result = np.empty((len(inertias.mass), motion.N_PARAMETERS))
    mass = inertias.mass
    result[:, 0] = MASS_SHARE * mass
    result[:, 1:4] = PLACE_M * mass[:, None]
    result[:, 4:] = TENSOR_SHARE * np.einsum("kii->k", inertias.tensor)[:, None] / 3.0
    scale = result.ravel()
    root = np.linalg.inv(np.linalg.cholesky(uncertainty.covariance[picked]))
    whitened = root @ (regressor * scale)
    pieces = {}
    for part in np.unique(place).tolist():
        own = whitened[place == part].reshape(-1, len(scale))
        pieces[part] = own.T @ own
    order, gains = _choose_greedily(list(pieces.values()), min(count, len(pieces)))
    numbers = np.array(list(pieces))[order]
    weight = reference.scale[0]
    windows = []
    for number, gain in zip(numbers.tolist(), gains, strict=True):
        start, stop = number * length, min((number + 1) * length, reference.n_frames)
        inside = (uncertainty.frames >= start) & (uncertainty.frames < stop)
        windows.append(Window(start, stop, gain, float(uncertainty.sd[inside, :3].mean() / weight)))
    whole = np.eye(len(next(iter(pieces.values())))) + sum(pieces.values())
    return FrameChoice(tuple(windows), float(np.linalg.slogdet(whole)[1]))


def _choose_greedily(pieces: list[Array], count: int) -> tuple[list[int], list[float]]:
    """Places of the pieces that raise ``log det (1 + sum)`` most, one by one, and by how much."""
    total, value = np.eye(len(pieces[0])), 0.0
    order: list[int] = []
    gains: list[float] = []
    for _ in range(count):
        rest = [k for k in range(len(pieces)) if k not in order]
        values = [float(np.linalg.slogdet(total + pieces[k])[1]) for k in rest]
        best = int(np.argmax(values))
        order.append(rest[best])
        gains.append(values[best] - value)
        total, value = total + pieces[rest[best]], values[best]
    return order, gains
