"""Solid shapes as distance fields: how far a point lies outside (above zero) or inside (below) them.

Shapes are put together by smooth unions, cuts and intersections, so that bones can be built of balls, rods,
plates and shafts with rounded transitions, while a part that must be exact stays exact.
Distances are exact near simple shapes and slightly short or long near composed ones; the zero surface, which
is what counts, is where it should be.
"""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from scaling_service.core.arrays import Array

_FAR = 1.0  # m; chosen: larger than any bone, so "nothing near"
_NEAR = 8e-3  # m; chosen: more than two steps of a grid, so that its zero surface feels nothing left out

_LEAST = 0.15  # chosen: of a step; no corner comes nearer to a grid point, so that no face is a sliver
_BLOCK = 16  # chosen: grid points a side at a time, so that parts that lie elsewhere are not computed
_PULLS = 2  # chosen: the second leaves less than a hundredth of a millimetre
_STEP_M = 2e-5  # chosen: for slopes, far below the smallest rounding


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """A solid: a box that holds it, and how far points are from its surface.

    ``low``, ``high``: corners of the box, (3,), m. ``distance``: of points (n, 3), m, (n,), negative inside.
    """

    low: Array
    high: Array
    distance: abc.Callable[[Array], Array]


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A shape and how it joins what stands before it: added, cut away, or all else trimmed to it.

    ``blend`` is the length over which the joint is rounded, m; zero keeps both surfaces exact.
    """

    shape: Shape
    blend: float = 0.0
    how: Literal["add", "cut", "trim"] = "add"


def make_rod(start: ArrayLike, end: ArrayLike, start_radius: float, end_radius: float | None = None) -> Shape:
    """A rod between two points with round ends, as thick all along by default, in m."""
    first, last = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    growth = 0.0 if end_radius is None else end_radius - start_radius
    thick = start_radius + max(growth, 0.0)
    along = last - first
    square = float(along @ along)

    def distance(points: Array) -> Array:
        offset = points - first
        share = np.clip(offset @ along / square, 0.0, 1.0) if square > 0.0 else np.zeros(len(points))
        offset -= share[:, None] * along
        return np.asarray(_measure_length(offset) - start_radius - share * growth)

    return Shape(np.minimum(first, last) - thick, np.maximum(first, last) + thick, distance)


def make_ball(centre: ArrayLike, radius: float) -> Shape:
    """A ball, in m."""
    return make_rod(centre, centre, radius)


def make_plate(corners: Array, radius: float) -> Shape:
    """A triangle (corners in rows) with a skin of some thickness around it, in m."""
    sides = np.roll(corners, -1, axis=0) - corners
    normal = np.cross(sides[0], sides[1])
    normal /= np.linalg.norm(normal)
    inwards = np.cross(normal, sides)

    def distance(points: Array) -> Array:
        above = (points - corners[0]) @ normal
        inside = np.ones(len(points), dtype=bool)
        edge = np.full(len(points), np.inf)
        for corner, side, inward in zip(corners, sides, inwards, strict=True):
            offset = points - corner
            inside &= offset @ inward >= 0.0
            share = np.clip(offset @ side / float(side @ side), 0.0, 1.0)
            offset -= share[:, None] * side
            np.minimum(edge, _measure_length(offset), out=edge)
        return np.where(inside, np.abs(above), edge) - radius

    return Shape(corners.min(axis=0) - radius, corners.max(axis=0) + radius, distance)


def make_shaft(
    *,
    heights: Array,
    x: Array,
    z: Array,
    half_x: Array,
    half_z: Array,
    ridge: float = 0.0,
    rounding: float = 4e-3,
) -> Shape:
    """A column along y whose middle (x, z) and half-widths change with height, smoothly between levels.

    All are (n_levels,), m, heights rising. ``ridge``: share by which the section is drawn out to the front
    (x) and pressed in elsewhere, threefold. ``rounding`` (m): of the edges at both ends.
    """
    # Values (n, m) between knots by monotone cubics, held at both ends
    levels = scipy.interpolate.PchipInterpolator(heights, np.column_stack([x, z, half_x, half_z]))
    middle, half = 0.5 * (heights[0] + heights[-1]), 0.5 * np.ptp(heights)

    def distance(points: Array) -> Array:
        at_x, at_z, wide, deep = levels(np.clip(points[:, 1], heights[0], heights[-1])).T
        across, beside = (points[:, 0] - at_x) / wide, (points[:, 2] - at_z) / deep
        radius = np.hypot(across, beside)
        if ridge:
            radius = radius / (1.0 + ridge * np.cos(3.0 * np.arctan2(beside, across)))
        wall = (radius - 1.0) * np.minimum(wide, deep)
        return _smooth_max(wall, np.abs(points[:, 1] - middle) - half, rounding)

    wide_x, wide_z = (np.asarray(h) * (1.0 + abs(ridge)) for h in (half_x, half_z))
    low = np.array([(x - wide_x).min(), heights[0], (z - wide_z).min()])
    high = np.array([(x + wide_x).max(), heights[-1], (z + wide_z).max()])
    return Shape(low, high, distance)


def make_half_space(point: Array, normal: Array) -> Shape:
    """Everything on the far side of a plane from its normal."""
    unit = normal / np.linalg.norm(normal)
    return Shape(np.full(3, -np.inf), np.full(3, np.inf), lambda points: np.asarray((points - point) @ unit))


def grow_shape(shape: Shape, by: float) -> Shape:
    """A shape thickened all round, m."""
    return Shape(shape.low - by, shape.high + by, lambda points: shape.distance(points) - by)


def join_parts(parts: abc.Sequence[Part]) -> Shape:
    """Parts put together, one after the other.

    Its distance is only right in sign where every part is further away than its blend.
    """

    def distance(points: Array) -> Array:
        found = np.full(len(points), _FAR)
        low, high = points.min(axis=0), points.max(axis=0)
        for part in parts:
            shape, margin = part.shape, part.blend + _NEAR
            if part.how != "trim" and ((shape.low - margin > high) | (shape.high + margin < low)).any():
                continue
            own = shape.distance(points)
            if part.how == "add":
                found = -_smooth_max(-found, -own, part.blend)
            else:
                found = _smooth_max(found, own if part.how == "trim" else -own, part.blend)
        return found

    added = [part for part in parts if part.how == "add"]
    return Shape(
        np.min([part.shape.low - part.blend for part in added], axis=0),
        np.max([part.shape.high + part.blend for part in added], axis=0),
        distance,
    )


def place_at_mm(at: ArrayLike, w: float) -> Array:
    """Places given in mm for a bone of the usual size, on one that is ``w`` times as large, m."""
    return 1e-3 * w * np.asarray(at, dtype=float)


def make_chain(points: ArrayLike, radii: abc.Sequence[float]) -> Shape:
    """A bent rod from point to point (n, 3), m, as thick at each as ``radii`` says."""
    at = np.asarray(points, dtype=float)
    pieces = zip(at, at[1:], radii, radii[1:], strict=False)
    return join_parts([Part(make_rod(*piece)) for piece in pieces])


def strip(upper: ArrayLike, lower: ArrayLike, radius: float) -> Shape:
    """A folded plate between two rows of as many points, (n, 3) each, m."""
    top, bottom = np.asarray(upper, dtype=float), np.asarray(lower, dtype=float)
    corners = []
    for k in range(len(top) - 1):
        corners += [(top[k], top[k + 1], bottom[k]), (top[k + 1], bottom[k + 1], bottom[k])]
    return join_parts([Part(make_plate(np.array(three), radius)) for three in corners])


def _smooth_max(a: Array, b: Array, blend: float) -> Array:
    """The larger of two, rounded where they differ by less than ``blend`` (quadratic; Quilez 2013)."""
    larger = np.maximum(a, b)
    if blend == 0.0:
        return larger
    near = np.maximum(blend - np.abs(a - b), 0.0)
    return larger + near * near * (0.25 / blend)


def _measure_length(vectors: Array) -> Array:
    length: Array = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
    return length


Faces = NDArray[np.intp]


def contour_shape(shape: Shape, step: float) -> tuple[Array, Faces]:
    """Contour a solid on a grid, and pull the corners onto its surface.

    ``step`` (m): of the grid; edges are about as long. Returns ``vertices`` ((n, 3), m); ``faces`` ((m, 3)):
    closed, corners counter-clockwise seen from outside.
    """
    import pyvista  # only here: it takes half a second, which who makes no bones should not wait

    low = shape.low - 2.0 * step
    size = np.ceil((shape.high - low) / step).astype(int) + 3
    # Distances at all grid points, x fastest, in steps; none nearly zero.
    field = np.empty((size[2], size[1], size[0]))
    for first in product(*(range(0, n, _BLOCK) for n in field.shape)):
        block = tuple(slice(k, min(k + _BLOCK, n)) for k, n in zip(first, field.shape, strict=True))
        z, y, x = np.mgrid[block]
        points = low + step * np.column_stack([x.ravel(), y.ravel(), z.ravel()])
        field[block] = shape.distance(points).reshape(x.shape) / step
    field = np.where(np.abs(field) < _LEAST, np.copysign(_LEAST, field), field)
    # Where the field changes sign: corners (n, 3) in steps, and faces that look towards larger values
    grid = pyvista.ImageData(dimensions=tuple(int(n) for n in size))
    found = grid.contour([0.0], scalars=field.ravel(), compute_normals=False, method="flying_edges")
    faces = np.asarray(found.faces).reshape(-1, 4)[:, :0:-1].astype(np.intp)
    vertices = low + step * np.asarray(found.points, dtype=float)
    for _ in range(_PULLS):
        # From each point's foot on the surface to the point, (n, 3), m: distance along slope (Newton).
        order = np.argsort(vertices[:, 1], kind="stable")
        pull = np.empty_like(vertices)
        for chunk in np.array_split(order, max(1, len(order) // 1500)):
            points = vertices[chunk]
            n = len(points)
            moved = np.concatenate([points, *(points + _STEP_M * axis for axis in np.eye(3))])
            value = shape.distance(moved)
            slope = (value[n:].reshape(3, n) - value[:n]).T / _STEP_M
            square = np.maximum(
                np.einsum("ij,ij->i", slope, slope), 0.25
            )  # where slopes meet, half a step is enough
            pull[chunk] = np.asarray(value[:n, None] * slope / square[:, None])
        vertices = vertices - pull
    return vertices, faces
