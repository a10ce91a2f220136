"""Where a surface ends: holes in it, and edges at which the image or a saw cut the bone off."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from scaling_service.core.arrays import Array

HOLE_M = 0.008  # chosen, a malleolus' radius: a whole tip, or the end of a fibula, is lost in a wider gap
NEAR_M = 0.010  # chosen: edges of triangles and a blunt tip's size


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Rims:
    """Vertices on edges that have one face only: ``points`` (n, 3), ``widths`` (n,) of their gaps, m."""

    points: Array = dataclasses.field(default_factory=lambda: np.zeros((0, 3)))
    widths: Array = dataclasses.field(default_factory=lambda: np.zeros(0))

    def measure_near(self, point: Array) -> float:
        """Width of the widest gap beside a point, m; 0 without any."""
        near = np.linalg.norm(self.points - point, axis=1) < NEAR_M
        return float(self.widths[near].max(initial=0.0))


def find_rims(points: Array, faces: NDArray[np.intp]) -> Rims:
    """Where a surface of ``points`` (n, 3), m, and ``faces`` (m, 3) ends."""
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    numbers, count = np.unique(edges @ np.array([len(points), 1]), return_counts=True)
    single = np.stack(np.divmod(numbers[count == 1], len(points)), axis=1)
    names, compact = np.unique(single, return_inverse=True)
    if not len(names):
        return Rims()
    ends = compact.reshape(-1, 2)
    graph = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(len(names), len(names)))
    loops, loop = connected_components(graph, directed=False)
    points = points[names]
    low, high = np.full((loops, 3), np.inf), np.full((loops, 3), -np.inf)
    np.minimum.at(low, loop, points)
    np.maximum.at(high, loop, points)
    return Rims(points, np.linalg.norm(high - low, axis=1)[loop])
