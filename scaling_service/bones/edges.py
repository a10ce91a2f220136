"""Where a surface ends: holes in it, and edges at which the image or a saw cut the bone off."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from scaling_service.bones.surface import Surface

Array = NDArray[np.float64]

HOLE_M = 0.02  # chosen: a wider gap than a hole of the segmentation, narrower than a shaft or an iliac wing
NEAR_M = 0.010  # chosen: edges of triangles and a blunt tip's size


def find_cuts(surface: Surface) -> Array:
    """Vertices on edges of a surface that are wider than a hole, (n, 3), m, in its own frame."""
    edges = np.sort(surface.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, count = np.unique(edges, axis=0, return_counts=True)
    rim = unique[count == 1]
    if not len(rim):
        return np.zeros((0, 3))
    names, compact = np.unique(rim, return_inverse=True)
    ends = compact.reshape(-1, 2)
    graph = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(len(names), len(names)))
    count_loops, loop = connected_components(graph, directed=False)
    points = surface.points[names]
    low, high = np.full((count_loops, 3), np.inf), np.full((count_loops, 3), -np.inf)
    np.minimum.at(low, loop, points)
    np.maximum.at(high, loop, points)
    return np.asarray(points[np.linalg.norm(high - low, axis=1)[loop] > HOLE_M])


def refuse_cut(points: dict[str, Array], cuts: Array) -> dict[str, str]:
    """Takes out tips that lie where the surface is cut, and says so: beyond there may be more of the bone.

    ``points``: tips to (3,), m. ``cuts`` (n, 3): from :func:`find_cuts`, in the same frame.
    """
    on_edge = [
        name
        for name, at in points.items()
        if len(cuts) and float(np.linalg.norm(cuts - at, axis=1).min()) < NEAR_M
    ]
    for name in on_edge:
        del points[name]
    return dict.fromkeys(on_edge, "the surface ends there, so that it need not be the landmark")
