"""What the markers of one link contribute to a fit, whatever their number.

A cluster of weighted markers acts like a rigid cloud of point masses: its weight, its centroids in
the link and as measured, its second moment and the cross moment between model and measurement are
all that the cost, its gradient and its curvature need. Frames are the last axis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.kernels.laws import Array
from scaling_service.kernels.tree import Poses


@dataclass(frozen=True, slots=True, eq=False)
class Cluster:
    """Sufficient statistics of the markers of one link; the last axis is the frame (or 1 if constant)."""

    weight: Array  # (n,)
    local: Array  # (3, n|1) weighted centroid in the link
    seen: Array  # (3, n) weighted centroid measured
    second: Array  # (3, 3, n|1) weighted second moment of the local positions about the centroid
    cross: Array  # (3, 3, n) weighted cross moment: local row, measured column
    spread: Array  # (n,) both squared spreads about the centroids

    def take(self, rows: NDArray[np.intp]) -> Cluster:
        """The cluster in these frames."""
        pick = [
            a if a.shape[-1] == 1 and self.weight.shape[-1] != 1 else a[..., rows] for a in self._arrays()
        ]
        return Cluster(*pick)

    def _arrays(self) -> tuple[Array, ...]:
        return (self.weight, self.local, self.seen, self.second, self.cross, self.spread)


def cluster_of(local: Array, measured: Array, weight: Array) -> Cluster:
    """Statistics of one link's markers: local (m, 3, n|1), measured (m, 3, n), weight (m, n)."""
    total = weight.sum(axis=0)
    share = weight / np.where(total > 0.0, total, 1.0)
    constant = local.shape[-1] == 1 and bool((weight == weight[:, :1]).all())
    part = share[:, :1] if constant else share
    centre = np.einsum("mn,mcn->cn", part, np.broadcast_to(local, (*local.shape[:2], part.shape[1])))
    seen = np.einsum("mn,mcn->cn", share, measured)
    inner, outer = local - centre, measured - seen
    heavy = weight[:, :1] if constant else weight
    inner = np.broadcast_to(inner, (*inner.shape[:2], heavy.shape[1]))
    weighted = heavy[:, None] * inner
    second = np.einsum("man,mbn->abn", weighted, inner)
    cross_moment = np.einsum("man,mbn->abn", np.broadcast_to(weighted, outer.shape), outer)
    spread = np.einsum("mn,mcn,mcn->n", weight, outer, outer) + second[0, 0] + second[1, 1] + second[2, 2]
    return Cluster(total, centre, seen, second, cross_moment, spread)


def centre_of(cluster: Cluster, poses: Poses, link: int) -> Array:
    """Where the model has the cluster's weighted centroid, (3, n), m."""
    axes = poses.axes[link]
    centre: Array = poses.origins[link] + (
        axes[0] * cluster.local[0] + axes[1] * cluster.local[1] + axes[2] * cluster.local[2]
    )
    return centre


def curvature(
    cluster: Cluster, axes: Array, centre: Array, turned: Array, force: Array, near: Array
) -> Array:
    """Spatial inertia of a cluster of unit point masses, with second derivatives where ``near``."""
    n = axes.shape[2]
    if cluster.second.shape[2] == 1:
        half = (cluster.second[:, :, 0] @ axes.reshape(3, -1)).reshape(3, 3, n)
    else:
        half = np.einsum("jkn,kan->jan", cluster.second, axes)
    moment = np.einsum("jan,jbn->abn", axes, half)
    if near.any():
        exact = turned + centre[:, None] * force
        moment += near * (0.5 * (exact + exact.transpose(1, 0, 2)) - moment)
    first = cluster.weight * centre
    moment += first[:, None] * centre
    first = first + 0.5 * near * force
    trace = moment[0, 0] + moment[1, 1] + moment[2, 2]
    result = np.zeros((6, 6, n))
    np.negative(moment, out=result[:3, :3])
    for i in range(3):
        result[i, i] += trace
        result[3 + i, 3 + i] = cluster.weight
        j, k = (i + 1) % 3, (i + 2) % 3
        result[j, 3 + i] = result[3 + i, j] = first[k]
        result[i, 3 + j] = result[3 + j, i] = -first[k]
    return result


def wrench_of(turned: Array, centre: Array, force: Array) -> Array:
    """Weighted residuals of a cluster as moment about the ground origin and force, (6, n)."""
    result = np.empty((6, force.shape[1]))
    result[3:] = force
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        result[i] = turned[j, k] - turned[k, j] + centre[j] * force[k] - centre[k] * force[j]
    return result
