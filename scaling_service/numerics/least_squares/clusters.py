"""What the markers of each link contribute to a fit, whatever their number.

A cluster of weighted markers acts like a rigid cloud of point masses: its weight, its centroids in
the link and as measured, its second moment and the cross moment between model and measurement are
all that the cost, its gradient and its curvature need. All clusters are held together: the first
axis is the cluster, the last the frame.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.arrays import Array
from scaling_service.numerics.multibody.tree import CYCLE, cross


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Clusters:
    """Sufficient statistics of the markers of every link.

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
        return dataclasses.replace(
            self,
            weight=self.weight[:, rows],
            local=self.local if constant else self.local[..., rows],
            measured=self.measured[..., rows],
            second=self.second if constant else self.second[..., rows],
            cross=self.cross[..., rows],
            spread=self.spread[rows],
        )


def gather_clusters(
    carrier: NDArray[np.intp],
    count: int,
    local: Array,
    measured: Array,
    weight: Array,
    placed: Array | None = None,
) -> Clusters:
    """Gather the markers of each of ``count`` links; a link without markers gets a cluster without weight.

    ``carrier`` int (n_markers,): the link, hence the cluster, of each marker.
    ``local``: (n_markers, 3, n|1), m.
    ``measured`` (n_markers, 3, n), m: anything where the weight is zero.
    ``weight``: (n_markers, n).
    ``placed``: see :class:`scaling_service.numerics.multibody.tree.Tree`. Directions have second and cross
    moments about the origin, and neither weight nor centroid.
    """
    member = np.equal(carrier, np.arange(count)[:, None]).astype(float)
    heavy = weight if placed is None else placed[:, None] * weight
    total = member @ heavy
    share = heavy / np.where(total > 0.0, total, 1.0)[carrier]
    constant = local.shape[-1] == 1 and bool((weight == weight[:, :1]).all())
    width = 1 if constant else weight.shape[1]
    centre = _sum_by_cluster(member, share[:, None, :width] * local)
    middle = _sum_by_cluster(member, share[:, None] * measured)
    around, about = centre[carrier], middle[carrier]
    if placed is not None:
        around, about = placed[:, None, None] * around, placed[:, None, None] * about
    inner, outer = local - around, measured - about
    weighted = weight[:, None, :width] * inner
    second = _sum_by_cluster(member, weighted[:, :, None] * inner[:, None])
    cross_moment = _sum_by_cluster(member, weighted[:, :, None] * outer[:, None])
    spread = np.einsum("mn,mcn,mcn->n", weight, outer, outer) + np.einsum("kaan->n", second)
    return Clusters(
        weight=total, local=centre, measured=middle, second=second, cross=cross_moment, spread=spread
    )


def _sum_by_cluster(member: Array, values: Array) -> Array:
    """Values by marker (m, ...) added up by cluster, (k, ...)."""
    return np.asarray((member @ values.reshape(len(values), -1)).reshape(len(member), *values.shape[1:]))


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Misfit:
    """How far the clusters are from where they were measured, in one pose."""

    axes: Array  # (k, 3, 3, n): of the clusters' links
    # centre, force: (k, 3, n): the model's centroids (m), and the weighted gap to the measured ones
    centre: Array
    force: Array
    turned: Array  # (k, 3, 3, n): cross moments with the local part in ground
    cost: Array  # (n,), m2: the weighted squared distance of all markers

    def take(self, rows: NDArray[np.intp]) -> Misfit:
        """The misfit in these frames."""
        return Misfit(**{f.name: getattr(self, f.name)[..., rows] for f in dataclasses.fields(self)})


def compute_misfit(clusters: Clusters, axes: Array, origins: Array) -> Misfit:
    """Compare clusters with the pose of their links: axes (k, 3, 3, n) and origins (k, 3, n)."""
    centre = origins + np.einsum("kjan,kjn->kan", axes, clusters.local)
    gap = clusters.measured - centre
    force = clusters.weight[:, None] * gap
    turned = np.einsum("kjan,kjbn->kabn", axes, clusters.cross)
    cost = np.einsum("kan,kan->n", force, gap) + clusters.spread
    cost -= 2.0 * np.einsum("kaan->n", turned)
    return Misfit(axes=axes, centre=centre, force=force, turned=turned, cost=np.maximum(cost, 0.0))


def compute_curvature_and_wrench(clusters: Clusters, misfit: Misfit, near: Array) -> Array:
    """Spatial inertia of the clusters beside their residual wrench, both about the ground origin.

    ``near`` (n,): one where the exact second derivatives are wanted, zero for Gauss-Newton.
    Returns (k, 6, 7, n): columns 0-5 act on a twist (angular, linear); column 6 is moment and force.
    """
    axes, centre, force = misfit.axes, misfit.centre, misfit.force
    count, n = len(axes), axes.shape[-1]
    # Second moments times the links' axes, (k, 3, 3, n)
    if clusters.second.shape[-1] == 1:
        turned = np.matmul(clusters.second[..., 0], axes.reshape(len(axes), 3, -1)).reshape(axes.shape)
    else:
        turned = np.einsum("kjin,kian->kjan", clusters.second, axes)
    moment = np.einsum("kjan,kjbn->kabn", axes, turned)
    if near.any():
        exact = misfit.turned + centre[:, :, None] * force[:, None]
        moment += near * (0.5 * (exact + exact.transpose(0, 2, 1, 3)) - moment)
    first = clusters.weight[:, None] * centre
    moment += first[:, :, None] * centre[:, None]
    first += 0.5 * near * force
    trace = np.einsum("kaan->kn", moment)
    result = np.zeros((count, 6, 7, n))
    np.negative(moment, out=result[:, :3, :3])
    for i, j, k in CYCLE:
        result[:, i, i] += trace
        result[:, 3 + i, 3 + i] = clusters.weight
        result[:, j, 3 + i] = result[:, 3 + i, j] = first[:, k]
        np.negative(first[:, k], out=result[:, i, 3 + j])
        result[:, 3 + j, i] = result[:, i, 3 + j]
        np.subtract(misfit.turned[:, j, k], misfit.turned[:, k, j], out=result[:, i, 6])
    result[:, :3, 6] += cross(centre, force)
    result[:, 3:, 6] = force
    return result


def compute_wrench_rate(twist: Array, wrench: Array) -> Array:
    """How wrenches (moment, force) turn with twists, both (c, 6, n): the spatial cross product."""
    pairs = (len(twist), 2, 3, twist.shape[-1])
    result = cross(twist[:, None, :3], wrench.reshape(pairs)).reshape(twist.shape)
    result[:, :3] += cross(twist[:, 3:], wrench[:, 3:])
    return result
