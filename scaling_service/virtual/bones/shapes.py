"""Solid shapes as distance fields: how far a point lies outside (above zero) or inside (below) them.

Shapes are put together by smooth unions, cuts and intersections, so that bones can be built of balls, rods,
plates and shafts with rounded transitions, while a part that must be exact stays exact.
Distances are exact near simple shapes and slightly short or long near composed ones; the zero surface, which
is what counts, is where it should be.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator

Array = NDArray[np.float64]
Bounds = tuple[Array, Array]
"""Lowest and highest corner of what may hold the shape, each (3,), m."""

_FAR = 1.0  # m; chosen: larger than any bone, so "nothing near"
_EVERYWHERE: Bounds = (np.full(3, -np.inf), np.full(3, np.inf))


class Shape(Protocol):
    """A solid."""

    @property
    def bounds(self) -> Bounds:
        """A box that holds it."""

    def distance(self, points: Array) -> Array:
        """Signed distance of points (n, 3), m: (n,), m, negative inside."""


@dataclass(frozen=True, slots=True, eq=False)
class Rod:
    """A rod with round ends, its radius going from one end's to the other's; a ball if both ends agree."""

    start: Array
    end: Array
    start_radius: float
    end_radius: float

    @property
    def bounds(self) -> Bounds:
        """A box that holds it."""
        thick = max(self.start_radius, self.end_radius)
        return np.minimum(self.start, self.end) - thick, np.maximum(self.start, self.end) + thick

    def distance(self, points: Array) -> Array:
        """Signed distance, (n,), m."""
        along, offset = self.end - self.start, points - self.start
        square = float(along @ along)
        share = np.clip(offset @ along / square, 0.0, 1.0) if square > 0.0 else np.zeros(len(points))
        offset -= share[:, None] * along
        away: Array = _length(offset) - self.start_radius - share * (self.end_radius - self.start_radius)
        return away


@dataclass(frozen=True, slots=True, eq=False)
class Plate:
    """A triangle (corners in rows) with a skin of some thickness around it."""

    corners: Array
    radius: float

    @property
    def bounds(self) -> Bounds:
        """A box that holds it."""
        return self.corners.min(axis=0) - self.radius, self.corners.max(axis=0) + self.radius

    def distance(self, points: Array) -> Array:
        """Signed distance, (n,), m."""
        sides = np.roll(self.corners, -1, axis=0) - self.corners
        normal = np.cross(sides[0], sides[1])
        normal /= np.linalg.norm(normal)
        above = (points - self.corners[0]) @ normal
        inside = np.ones(len(points), dtype=bool)
        edge = np.full(len(points), np.inf)
        for corner, side in zip(self.corners, sides, strict=True):
            offset = points - corner
            inside &= offset @ np.cross(normal, side) >= 0.0
            share = np.clip(offset @ side / float(side @ side), 0.0, 1.0)
            offset -= share[:, None] * side
            np.minimum(edge, _length(offset), out=edge)
        away: Array = np.where(inside, np.abs(above), edge) - self.radius
        return away


@dataclass(frozen=True, slots=True, eq=False)
class Shaft:
    """A column along y whose middle and half-widths change with height."""

    heights: Array  # (n_levels,), m: rising
    x: Array
    z: Array
    """``x``, ``z``: (n_levels,), m: middle at each height; smooth between."""
    half_x: Array
    half_z: Array
    """``half_x``, ``half_z``: (n_levels,), m."""
    ridge: float = 0.0
    """Share by which the section is drawn out to the front (x) and pressed in elsewhere, threefold."""
    rounding: float = 4e-3  # m: of the edges at both ends

    @property
    def bounds(self) -> Bounds:
        """A box that holds it."""
        wide_x, wide_z = (np.asarray(h) * (1.0 + abs(self.ridge)) for h in (self.half_x, self.half_z))
        low = np.array([(self.x - wide_x).min(), self.heights[0], (self.z - wide_z).min()])
        high = np.array([(self.x + wide_x).max(), self.heights[-1], (self.z + wide_z).max()])
        return low, high

    def distance(self, points: Array) -> Array:
        """Signed distance, (n,), m."""
        levels = np.column_stack([self.x, self.z, self.half_x, self.half_z])
        x, z, half_x, half_z = _smoothly(points[:, 1], self.heights, levels).T
        across, beside = (points[:, 0] - x) / half_x, (points[:, 2] - z) / half_z
        radius = np.hypot(across, beside)
        if self.ridge:
            angle = np.arctan2(beside, across)
            radius = radius / (1.0 + self.ridge * np.cos(3.0 * angle))
        wall = (radius - 1.0) * np.minimum(half_x, half_z)
        middle, half = 0.5 * (self.heights[0] + self.heights[-1]), 0.5 * np.ptp(self.heights)
        ends = np.abs(points[:, 1] - middle) - half
        return _smooth_max(wall, ends, self.rounding)


@dataclass(frozen=True, slots=True, eq=False)
class HalfSpace:
    """Everything on the far side of a plane from its normal."""

    point: Array
    normal: Array

    @property
    def bounds(self) -> Bounds:
        """It has none."""
        return _EVERYWHERE

    def distance(self, points: Array) -> Array:
        """Signed distance, (n,), m."""
        away: Array = (points - self.point) @ (self.normal / np.linalg.norm(self.normal))
        return away


@dataclass(frozen=True, slots=True, eq=False)
class Grown:
    """A shape thickened all round, m."""

    shape: Shape
    by: float

    @property
    def bounds(self) -> Bounds:
        """A box that holds it."""
        low, high = self.shape.bounds
        return low - self.by, high + self.by

    def distance(self, points: Array) -> Array:
        """Signed distance, (n,), m."""
        return self.shape.distance(points) - self.by


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A shape and how it joins what stands before it: added, cut away, or all else trimmed to it.

    ``blend`` is the length over which the joint is rounded, m; zero keeps both surfaces exact.
    """

    shape: Shape
    blend: float = 0.0
    how: Literal["add", "cut", "trim"] = "add"


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """Parts put together, one after the other."""

    parts: tuple[Part, ...]

    @property
    def bounds(self) -> Bounds:
        """A box that holds it."""
        boxes = [(part.shape.bounds, part.blend) for part in self.parts if part.how == "add"]
        low = np.min([box[0] - blend for box, blend in boxes], axis=0)
        return low, np.max([box[1] + blend for box, blend in boxes], axis=0)

    def distance(self, points: Array) -> Array:
        """Signed distance, (n,), m; only right in sign where every part is further away than its blend."""
        found = np.full(len(points), _FAR)
        low, high = points.min(axis=0), points.max(axis=0)
        for part in self.parts:
            bottom, top = part.shape.bounds
            margin = part.blend + _NEAR
            if part.how != "trim" and ((bottom - margin > high) | (top + margin < low)).any():
                continue
            own = part.shape.distance(points)
            if part.how == "add":
                found = -_smooth_max(-found, -own, part.blend)
            else:
                found = _smooth_max(found, own if part.how == "trim" else -own, part.blend)
        return found


_NEAR = 8e-3  # m; chosen: more than two steps of a grid, so that its zero surface feels nothing left out


def at_mm(at: ArrayLike, w: float) -> Array:
    """Places given in mm for a bone of the usual size, on one that is ``w`` times as large, m."""
    return 1e-3 * w * np.asarray(at, dtype=float)


def ball(centre: ArrayLike, radius: float) -> Rod:
    """A ball, in m."""
    middle = np.asarray(centre, dtype=float)
    return Rod(middle, middle, radius, radius)


def rod(start: ArrayLike, end: ArrayLike, start_radius: float, end_radius: float | None = None) -> Rod:
    """A rod between two points, as thick all along unless told otherwise, in m."""
    last = start_radius if end_radius is None else end_radius
    return Rod(np.asarray(start, dtype=float), np.asarray(end, dtype=float), start_radius, last)


def chain(points: ArrayLike, radii: Sequence[float]) -> Solid:
    """A bent rod from point to point (n, 3), m, as thick at each as ``radii`` says."""
    at = np.asarray(points, dtype=float)
    pieces = zip(at, at[1:], radii, radii[1:], strict=False)
    return Solid(tuple(Part(rod(*piece)) for piece in pieces))


def strip(upper: ArrayLike, lower: ArrayLike, radius: float) -> Solid:
    """A folded plate between two rows of as many points, (n, 3) each, m."""
    top, bottom = np.asarray(upper, dtype=float), np.asarray(lower, dtype=float)
    corners = []
    for k in range(len(top) - 1):
        corners += [(top[k], top[k + 1], bottom[k]), (top[k + 1], bottom[k + 1], bottom[k])]
    return Solid(tuple(Part(Plate(np.array(three), radius)) for three in corners))


def _smooth_max(a: Array, b: Array, blend: float) -> Array:
    """The larger of two, rounded where they differ by less than ``blend`` (quadratic; Quilez 2013)."""
    larger = np.maximum(a, b)
    if blend == 0.0:
        return larger
    near = np.maximum(blend - np.abs(a - b), 0.0)
    rounded: Array = larger + near * near * (0.25 / blend)
    return rounded


def _smoothly(at: Array, knots: Array, values: Array) -> Array:
    """Values (n, m) between knots by monotone cubics, held at both ends."""
    inside: Array = PchipInterpolator(knots, values)(np.clip(at, knots[0], knots[-1]))
    return inside


def _length(vectors: Array) -> Array:
    length: Array = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
    return length


Faces = NDArray[np.intp]

_LEAST = 0.15  # chosen: of a step; no corner comes nearer to a grid point, so that no face is a sliver
_BLOCK = 16  # chosen: grid points a side at a time, so that parts that lie elsewhere are not computed
_PULLS = 2  # chosen: the second leaves less than a hundredth of a millimetre
_STEP_M = 2e-5  # chosen: for slopes, far below the smallest rounding


def surface_of(shape: Shape, step: float) -> tuple[Array, Faces]:
    """Contour a solid on a grid, and pull the corners onto its surface.

    ``step`` (m): of the grid; edges are about as long. Returns ``vertices`` ((n, 3), m); ``faces`` ((m, 3)):
    closed, corners counter-clockwise seen from outside.
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
