"""How far points and axes on a bone may lie from where another expert or rule would put them.

All are root mean squares of distances in space, m, and of angles, rad: of three independent parts that are
added as variances. The fit: how well the surface determines a shape, its scatter alike over grains. The mesh:
its noise, its chords and holes beside a tip. The definition: how experts differ (``landmarks`` in
``people.yaml``); of a tip also the direction in which it is sought. Of errors alike in all directions 1.7
times such a deviation holds 95 % (1.61 in space, 1.73 of an axis).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from scipy.spatial import cKDTree

from scaling_service.bones import edges, fits
from scaling_service.bones.shapes import span_plane
from scaling_service.bones.surface import Surface
from scaling_service.core.arrays import Array, Mask
from scaling_service.model.people import read_people

GRAIN_M = 5e-3  # errors of a segmentation are alike over about so far; chosen, several voxels
TURN = float(np.deg2rad(5.0))
"""About each axis across: by as much do axes of one bone differ between published frames, chosen."""
_CAP = 0.25
"""How far a surface may bulge out of a gap, as a share of its width. Chosen: a ball a quarter wider."""
_ACROSS = float(np.sqrt(2.0 / 3.0))  # share of a distance in space that lies across a line


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Tip:
    """Where a part of a bone reaches furthest: see :func:`scaling_service.bones.fits.find_tip`."""

    surface: Surface
    direction: Array  # (3,), unit
    within: Mask  # (n,)
    _: dataclasses.KW_ONLY
    depth: float = fits.BLUNT_M  # m
    turn: float = TURN  # rad; standard deviation of the direction about each axis across it

    def find(self) -> Array:
        """The tip, (3,), m."""
        return fits.find_tip(self.surface, self.direction, self.within, self.depth)

    def is_cut(self) -> bool:
        """Whether what a wide gap in this part lacks may reach further than the tip that is there."""
        rims = self.surface.rims
        reach = rims.points @ self.direction + _CAP * rims.widths
        open_ = (rims.widths > edges.HOLE_M) & (reach > self.find() @ self.direction)
        if not open_.any():
            return False
        away, _ = cKDTree(self.surface.smooth[self.within]).query(rims.points[open_])
        return bool(away.min() < edges.NEAR_M)

    def deviate(self) -> float:
        """By the direction and the mesh, m: how far the tip goes when the direction turns by a deviation."""
        here, total = self.find(), 0.0
        for across in span_plane(self.direction):
            ways = (np.cos(self.turn) * self.direction + k * np.sin(self.turn) * across for k in (-1.0, 1.0))
            tips = [fits.find_tip(self.surface, each, self.within, self.depth) for each in ways]
            total += float(np.mean([(tip - here) @ (tip - here) for tip in tips]))
        hole = 0.5 * self.surface.rims.measure_near(here)
        return float(np.sqrt(total + hole**2 + measure_mesh_error(self.surface, fits.WINDOW_M) ** 2))


def find_tips(tips: Mapping[str, Tip]) -> tuple[dict[str, Array], dict[str, str]]:
    """Those tips that the surface holds, each (3,), m, and why it does not hold the others."""
    cut = [name for name, tip in tips.items() if tip.is_cut()]
    why = "the surface ends there or has a hole, so that it need not be the landmark"
    return {name: tip.find() for name, tip in tips.items() if name not in cut}, dict.fromkeys(cut, why)


def measure_mesh_error(surface: Surface, radius: float) -> float:
    """Of a place on the surface, m: its noise, and the height of its edges' arcs on a radius, m."""
    return float(np.hypot(surface.noise, surface.edge**2 / (8.0 * radius)))


def deviate_sphere(surface: Surface, ball: fits.SphereOnBone) -> float:
    """Of a sphere's centre by its fit, m: the root of the trace of the least squares' covariance."""
    offset = surface.smooth - ball.centre
    distance = np.maximum(np.linalg.norm(offset, axis=1), 1e-9)
    columns = np.column_stack([offset / distance[:, None], np.ones(len(offset))])
    covariance = _invert(surface, ball.support, columns, ball.rms, ball.radius)
    return float(np.sqrt(np.trace(covariance[:3, :3])))


def deviate_cylinder(surface: Surface, tube: fits.CylinderOnBone) -> tuple[float, float]:
    """Of a cylinder's axis by its fit: across it, m, and its direction, rad."""
    first, second = span_plane(tube.direction)
    offset = surface.smooth - tube.point
    along = offset @ tube.direction
    middle = float(np.average(along, weights=tube.support * surface.areas))
    radial = offset - along[:, None] * tube.direction
    radial = radial / np.maximum(np.linalg.norm(radial, axis=1), 1e-9)[:, None]
    u1, u2 = radial @ first, radial @ second
    columns = np.column_stack([u1, u2, (along - middle) * u1, (along - middle) * u2, np.ones(len(u1))])
    covariance = _invert(surface, tube.support, columns, tube.rms, tube.radius)
    return float(np.sqrt(np.trace(covariance[:2, :2]))), float(np.sqrt(np.trace(covariance[2:4, 2:4])))


def deviate_line(length: float, *ends: float) -> float:
    """Of the direction of a line between two points, rad, by the deviations of its ends; lengths in m.

    Examples
    --------
    >>> round(deviate_line(0.05, 0.001, 0.001), 4)
    0.0231
    """
    return _ACROSS * float(np.linalg.norm(ends)) / length


def add_definitions(
    points: Mapping[str, float], axes: Mapping[str, float]
) -> tuple[dict[str, float], dict[str, float]]:
    """Deviations of points, m, and axes, rad, with what experts differ by; names with or without a side."""
    people = read_people()
    return (
        {name: _add(name, size, people.landmark_points) for name, size in points.items()},
        {name: _add(name, size, people.landmark_axes) for name, size in axes.items()},
    )


def _add(name: str, size: float, table: Mapping[str, float]) -> float:
    return float(np.hypot(size, table[name.removesuffix("_r").removesuffix("_l")]))


def _invert(surface: Surface, support: Array, columns: Array, rms: float, radius: float) -> Array:
    """Covariance of a least-squares fit whose vertices count by the grains of area that they stand for."""
    grain = max(GRAIN_M, surface.edge)
    counts = support * surface.areas / grain**2
    normal = columns.T @ (counts[:, None] * columns)
    scatter = float(np.hypot(rms, measure_mesh_error(surface, radius)))
    return np.asarray(scatter**2 * np.linalg.pinv(normal))
