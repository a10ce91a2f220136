"""What the markers of each link contribute to a fit, whatever their number.

A cluster of weighted markers acts like a rigid cloud of point masses: its weight, its centroids in
the link and as measured, its second moment and the cross moment between model and measurement are
all that the cost, its gradient and its curvature need. All clusters are held together: the first
axis is the cluster, the last the frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from scaling_service.kernels.laws import Array
from scaling_service.kernels.masks import seen

_CYCLE = ((0, 1, 2), (1, 2, 0), (2, 0, 1))


@dataclass(frozen=True, slots=True, eq=False)
class Clusters:
    """Sufficient statistics of the markers of every link that carries some.

    ``local`` and ``second`` have one frame where they are the same in all.
    """

    weight: Array  # (k, n)
    local: Array  # (k, 3, n|1) weighted centroid in the link
    measured: Array  # (k, 3, n) weighted centroid as measured
    second: Array  # (k, 3, 3, n|1) weighted second moment of the local positions about the centroid
    cross: Array  # (k, 3, 3, n) weighted cross moment: local row, measured column
    spread: Array  # (n,) all squared spreads about the centroids

    def take(self, rows: NDArray[np.intp]) -> Clusters:
        """The clusters in these frames."""
        constant = self.local.shape[-1] == 1
        return replace(
            self,
            weight=self.weight[:, rows],
            local=self.local if constant else self.local[..., rows],
            measured=self.measured[..., rows],
            second=self.second if constant else self.second[..., rows],
            cross=self.cross[..., rows],
            spread=self.spread[rows],
        )


def clusters_of(groups: list[NDArray[np.intp]], local: Array, measured: Array, weight: Array) -> Clusters:
    """Gather the markers of each group.

    Parameters
    ----------
    groups : list of ndarray of int
        The markers of each cluster.
    local : ndarray, shape (n_markers, 3, n|1), m
    measured : ndarray, shape (n_markers, 3, n), m
        Anything where the weight is zero.
    weight : ndarray, shape (n_markers, n)
    """
    constant = local.shape[-1] == 1 and bool((weight == weight[:, :1]).all())
    parts = [_gather(local[g], measured[g], weight[g], constant=constant) for g in groups]
    weight, centre, middle, second, cross, spread = (np.stack(part) for part in zip(*parts, strict=True))
    return Clusters(weight, centre, middle, second, cross, spread.sum(axis=0))


def _gather(local: Array, measured: Array, weight: Array, *, constant: bool) -> tuple[Array, ...]:
    total = weight.sum(axis=0)
    share = weight / np.where(total > 0.0, total, 1.0)
    width = 1 if constant else weight.shape[1]
    local = np.broadcast_to(local, (*local.shape[:2], width))
    heavy, part = weight[:, :width], share[:, :width]
    centre = np.einsum("mn,mcn->cn", part, local)
    middle = np.einsum("mn,mcn->cn", share, measured)
    inner, outer = local - centre, measured - middle
    weighted = heavy[:, None] * inner
    second = np.einsum("man,mbn->abn", weighted, inner)
    cross = np.einsum("man,mbn->abn", np.broadcast_to(weighted, outer.shape), outer)
    spread = np.einsum("mn,mcn,mcn->n", weight, outer, outer) + np.einsum("aan->n", second)
    return total, centre, middle, second, cross, spread


def marker_weights(measured: Array, weights: Array) -> Array:
    """Weights (n_markers, n_frames), zero where a marker (n_frames, n_markers, 3) was not seen."""
    return np.where(seen(measured), weights, 0.0).T


@dataclass(frozen=True, slots=True, eq=False)
class Misfit:
    """How far the clusters are from where they were measured, in one pose.

    Parameters
    ----------
    axes : ndarray, shape (k, 3, 3, n)
        Of the clusters' links.
    centre, force : ndarray, shape (k, 3, n)
        The model's centroids (m), and the weighted gap to the measured ones.
    turned : ndarray, shape (k, 3, 3, n)
        Cross moments with the local part in ground.
    cost : ndarray, shape (n,), m2
        The weighted squared distance of all markers.
    """

    axes: Array
    centre: Array
    force: Array
    turned: Array
    cost: Array


def misfit_of(clusters: Clusters, axes: Array, origins: Array) -> Misfit:
    """Compare clusters with the pose of their links: axes (k, 3, 3, n) and origins (k, 3, n)."""
    centre = origins + np.einsum("kjan,kjn->kan", axes, clusters.local)
    gap = clusters.measured - centre
    force = clusters.weight[:, None] * gap
    turned = np.einsum("kjan,kjbn->kabn", axes, clusters.cross)
    cost = np.einsum("kan,kan->n", force, gap) + clusters.spread
    cost -= 2.0 * np.einsum("kaan->n", turned)
    return Misfit(axes, centre, force, turned, np.maximum(cost, 0.0))


def curvature_and_wrench(clusters: Clusters, misfit: Misfit, near: Array) -> Array:
    """Spatial inertia of the clusters beside their residual wrench, both about the ground origin.

    Parameters
    ----------
    near : ndarray, shape (n,)
        One where the exact second derivatives are wanted, zero for Gauss-Newton.

    Returns
    -------
    ndarray, shape (k, 6, 7, n)
        Columns 0-5 act on a twist (angular, linear); column 6 is moment and force.
    """
    axes, centre, force = misfit.axes, misfit.centre, misfit.force
    count, n = len(axes), axes.shape[-1]
    moment = np.einsum("kjan,kjbn->kabn", axes, _second_in_ground(clusters, axes))
    if near.any():
        exact = misfit.turned + centre[:, :, None] * force[:, None]
        moment += near * (0.5 * (exact + exact.transpose(0, 2, 1, 3)) - moment)
    first = clusters.weight[:, None] * centre
    moment += first[:, :, None] * centre[:, None]
    first += 0.5 * near * force
    trace = np.einsum("kaan->kn", moment)
    result = np.zeros((count, 6, 7, n))
    np.negative(moment, out=result[:, :3, :3])
    for i, j, k in _CYCLE:
        result[:, i, i] += trace
        result[:, 3 + i, 3 + i] = clusters.weight
        result[:, j, 3 + i] = result[:, 3 + i, j] = first[:, k]
        result[:, i, 3 + j] = result[:, 3 + j, i] = -first[:, k]
        result[:, i, 6] = misfit.turned[:, j, k] - misfit.turned[:, k, j]
        result[:, i, 6] += centre[:, j] * force[:, k] - centre[:, k] * force[:, j]
    result[:, 3:, 6] = force
    return result


def _second_in_ground(clusters: Clusters, axes: Array) -> Array:
    """Second moments times the links' axes, (k, 3, 3, n)."""
    if clusters.second.shape[-1] == 1:
        flat: Array = np.matmul(clusters.second[..., 0], axes.reshape(len(axes), 3, -1))
        return flat.reshape(axes.shape)
    half: Array = np.einsum("kjin,kian->kjan", clusters.second, axes)
    return half


def wrench_rate(twist: Array, wrench: Array) -> Array:
    """How wrenches (moment, force) turn with twists, both (c, 6, n): the spatial cross product."""
    result = np.empty(twist.shape)
    turn, shift, moment, force = twist[:, :3], twist[:, 3:], wrench[:, :3], wrench[:, 3:]
    for i, j, k in _CYCLE:
        result[:, i] = turn[:, j] * moment[:, k] - turn[:, k] * moment[:, j]
        result[:, i] += shift[:, j] * force[:, k] - shift[:, k] * force[:, j]
        result[:, 3 + i] = turn[:, j] * force[:, k] - turn[:, k] * force[:, j]
    return result
