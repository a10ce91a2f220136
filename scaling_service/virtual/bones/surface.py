"""The surface of a solid as a closed mesh of triangles whose corners lie on it."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from scaling_service.virtual.bones.shapes import Array, Shape

Faces = NDArray[np.intp]

_LEAST = (
    0.15  # chosen: share of a step below which no corner comes near a grid point, so that no face is a sliver
)
_BLOCK = 16  # chosen: grid points a side at a time, so that parts that lie elsewhere are not computed
_PULLS = 2  # chosen: the second leaves less than a hundredth of a millimetre
_STEP_M = 2e-5  # chosen: for slopes, far below the smallest rounding


def surface_of(shape: Shape, step: float) -> tuple[Array, Faces]:
    """Contour a solid on a grid, and pull the corners onto its surface.

    Parameters
    ----------
    step : float, m
        Of the grid; edges are about as long.

    Returns
    -------
    vertices : (n, 3), m
    faces : (m, 3)
        Closed, corners counter-clockwise seen from outside.
    """
    low, high = shape.bounds
    low = low - 2.0 * step
    size = np.ceil((high - low) / step).astype(int) + 3
    vertices, faces = _contour(_sampled(shape, low, size, step), size)
    vertices = low + step * vertices
    for _ in range(_PULLS):
        vertices = vertices - _pull(shape, vertices)
    return vertices, faces


def _sampled(shape: Shape, low: Array, size: NDArray[np.intp], step: float) -> Array:
    """Distances at all grid points, x fastest, in steps; none nearly zero."""
    field = np.empty((size[2], size[1], size[0]))
    for first in product(*(range(0, n, _BLOCK) for n in field.shape)):
        block = tuple(slice(k, min(k + _BLOCK, n)) for k, n in zip(first, field.shape, strict=True))
        z, y, x = np.mgrid[block]
        points = low + step * np.column_stack([x.ravel(), y.ravel(), z.ravel()])
        field[block] = shape.distance(points).reshape(x.shape) / step
    field = np.where(np.abs(field) < _LEAST, np.copysign(_LEAST, field), field)
    return np.asarray(field.ravel())


def _contour(field: Array, size: NDArray[np.intp]) -> tuple[Array, Faces]:
    """Where a field changes sign: corners (n, 3) in steps, and faces that look towards larger values."""
    import pyvista  # only here: it takes half a second, which who makes no bones should not wait

    grid = pyvista.ImageData(dimensions=tuple(int(n) for n in size))
    found = grid.contour([0.0], scalars=field, compute_normals=False, method="flying_edges")
    faces = np.asarray(found.faces).reshape(-1, 4)[:, :0:-1].astype(np.intp)
    return np.asarray(found.points, dtype=float), faces


def _pull(shape: Shape, points: Array) -> Array:
    """From each point's foot on the surface to the point, (n, 3), m: distance along slope (Newton)."""
    order = np.argsort(points[:, 1], kind="stable")
    pull = np.empty_like(points)
    for chunk in np.array_split(order, max(1, len(order) // 1500)):
        pull[chunk] = _newton(shape, points[chunk])
    return pull


def _newton(shape: Shape, points: Array) -> Array:
    n = len(points)
    moved = np.concatenate([points, *(points + _STEP_M * axis for axis in np.eye(3))])
    value = shape.distance(moved)
    slope = (value[n:].reshape(3, n) - value[:n]).T / _STEP_M
    square = np.maximum(np.einsum("ij,ij->i", slope, slope), 0.25)  # where slopes meet, half a step is enough
    return np.asarray(value[:n, None] * slope / square[:, None])
