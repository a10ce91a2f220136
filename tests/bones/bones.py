"""Bones of balls, rods and hollows, whose centres are known: the zero surfaces of a distance field."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray
from pyvista import ImageData

Array = NDArray[np.float64]
Mesh = tuple[Array, NDArray[np.intp]]
Field = Callable[[Array], Array]

HIP_CENTRE = np.array([12.0, 405.0, -42.0])
CONDYLE_MEDIAL = np.array([0.0, 0.0, -23.0])
CONDYLE_LATERAL = np.array([0.0, 1.0, 24.0])
RADII = {"head": 24.0, "medial": 21.5, "lateral": 20.5}
MALLEOLUS_MEDIAL = np.array([4.0, -398.0, -24.0])  # centre of the ball at its tip, radius 7
MALLEOLUS_LATERAL = np.array([-10.0, -408.0, 34.0])  # the same
FIBULA_HEAD = np.array([-22.0, -42.0, 38.0])  # centre of the ball, radius 11
TALUS_POINT, TALUS_RADIUS = np.array([-2.0, -408.0, 4.0]), 21.0


def rod(a: object, b: object, radius_a: float, radius_b: float | None = None) -> Field:
    """A rod with round ends between two points, its radius going from one to the other."""
    start, end = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    last = radius_a if radius_b is None else radius_b
    along = end - start
    square = max(float(along @ along), 1e-9)

    def distance(p: Array) -> Array:
        t = np.clip(((p - start) @ along) / square, 0.0, 1.0)
        near: Array = (
            np.linalg.norm(p - start - t[:, None] * along, axis=1) - radius_a - t * (last - radius_a)
        )
        return near

    return distance


def ball(centre: object, radius: float) -> Field:
    return rod(centre, centre, radius)


def meshed(parts: list[Field], low: object, high: object, *, step: float = 2.0) -> Mesh:
    """The surface of the union of some parts, in mm."""
    corner, top = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    size = np.ceil((top - corner) / step).astype(int) + 1
    grid = ImageData(dimensions=tuple(size), spacing=(step,) * 3, origin=tuple(corner))
    points = np.asarray(grid.points, dtype=float)
    field = np.min([part(points) for part in parts], axis=0)
    surface = grid.contour([0.0], scalars=field).triangulate()
    # The contour's triangles face the falling values, which is inwards.
    faces = np.asarray(surface.faces).reshape(-1, 4)[:, :0:-1].astype(np.intp)
    return np.asarray(surface.points, dtype=float), faces


@cache
def femur() -> Mesh:
    """A right femur in mm: x forward, y up, z right, the origin between the condyles."""
    parts = [
        ball(HIP_CENTRE, RADII["head"]),
        rod([8, 372, 2], HIP_CENTRE, 14),
        ball([5, 380, 10], 19),
        rod([16, 370, 2], [16, 80, 0], 14),
        rod([16, 90, 0], [18, 24, 0], 14, 27),
        rod(CONDYLE_MEDIAL, np.add(CONDYLE_MEDIAL, [24, 4, 2]), RADII["medial"], 20),
        rod(CONDYLE_LATERAL, np.add(CONDYLE_LATERAL, [24, 4, -2]), RADII["lateral"], 20),
        rod([24, 8, -18], [24, 8, 18], 18),
        rod([10, 8, -14], [10, 8, 14], 18),
        rod([8, 12, -30], [8, 12, -40], 9, 5),
        rod([8, 12, 30], [8, 12, 41], 9, 5),
    ]
    return meshed(parts, [-30, -30, -75], [60, 435, 55])


@cache
def tibia(*, grown_together: bool = False) -> Mesh:
    """The right tibia and fibula below that femur, two shells, or one."""
    parts = [
        rod([-6, -36, -22], [-6, -36, 22], 17),
        rod([6, -40, -14], [6, -40, 14], 18),
        rod([2, -45, 0], [4, -110, 0], 26, 14),
        ball([24, -68, 2], 11),
        rod([4, -100, 0], [0, -385, 0], 13, 12),
        rod([0, -360, 0], [0, -378, 2], 12, 19),
        rod([4, -376, -16], MALLEOLUS_MEDIAL, 9, 7),
    ]
    fibula = [
        rod(FIBULA_HEAD, [-20, -80, 36], 11, 6),
        rod([-20, -80, 36], [-10, -370, 32], 6),
        rod([-10, -370, 32], MALLEOLUS_LATERAL, 8, 7),
    ]
    if grown_together:
        bridges = [rod(FIBULA_HEAD, [-5, -45, 15], 5), rod([-10, -385, 32], [0, -380, 8], 5)]
        return meshed([*parts, *fibula, *bridges], [-40, -420, -55], [50, -5, 60])
    vertices, faces = meshed(parts, [-40, -420, -55], [50, -5, 60])
    more, others = meshed(fibula, [-40, -420, 10], [10, -25, 60])
    return np.vstack([vertices, more]), np.vstack([faces, others + len(vertices)])


@cache
def talus() -> Mesh:
    """A talus below that tibia: a drum with a neck and a body that is no cylinder."""
    axis = np.array([0.05, 0.0, 1.0]) / np.linalg.norm([0.05, 0.0, 1.0])

    def drum(p: Array) -> Array:
        offset = p - TALUS_POINT
        along = offset @ axis
        radial = np.linalg.norm(offset - along[:, None] * axis, axis=1)
        inside: Array = np.maximum(
            np.maximum(radial - TALUS_RADIUS, np.abs(along) - 14.0), -6.0 - offset[:, 1]
        )
        return inside

    parts = [drum, rod([12, -412, 0], [34, -416, -6], 9, 12), rod([-12, -416, 2], [14, -418, 2], 9)]
    return meshed(parts, [-35, -440, -30], [60, -380, 35], step=1.0)


def turned(mesh: Mesh, rng: np.random.Generator) -> tuple[Mesh, Callable[[Array], Array]]:
    """The mesh in a random pose, and what takes points back."""
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    R = q * np.sign(np.linalg.det(q))
    shift = rng.normal(size=3)
    return (mesh[0] @ R.T + shift, mesh[1]), lambda points: (points - shift) @ R


def metres(mesh: Mesh) -> Mesh:
    return mesh[0] * 1e-3, mesh[1]


def mirrored(mesh: Mesh) -> Mesh:
    """Left for right; the faces are turned too."""
    return mesh[0] * [1.0, 1.0, -1.0], mesh[1][:, ::-1]


def joined(*meshes: Mesh) -> Mesh:
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in meshes[:-1])])
    faces = [faces + start for (_, faces), start in zip(meshes, starts, strict=True)]
    return np.vstack([vertices for vertices, _ in meshes]), np.vstack(faces)


def above(mesh: Mesh, height: float, sign: float = 1.0) -> Mesh:
    """Only the faces above (below) a height."""
    kept = sign * (mesh[0][:, 1] - height) > 0
    return mesh[0], mesh[1][kept[mesh[1]].all(axis=1)]
