"""Spheres, cylinders and tips on a surface: robust, geometric, judged by how much is covered."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.bones import results, shapes
from scaling_service.bones.surface import Surface
from scaling_service.core.arrays import Array

_MOST_PEAKS = 6  # to refine; chosen
_CELL_M = 3e-3  # chosen: the votes of a rough MRI head scatter by about as much
_RADIUS_STEP_M = 1e-3
_APART_M = 10e-3  # chosen: less than half of the smallest head's radius
_ALIGNED = np.cos(np.deg2rad(35.0))  # chosen: a normal further off does not belong to the sphere
_SPREAD = 3.0  # Tukey's weight vanishes at this many robust standard deviations; chosen, 4.7 on clean data
_NARROWEST, _WIDEST = 0.02, 0.08  # shares of the radius between which that limit is held; chosen
_START, _CLOSING = 0.25, 0.8  # first limit as a share of the radius, and how it closes with each step
_SPHERE_STEPS = 60
_SETTLED_M = 1e-7
# Of an ellipsoid, as shares of the radius: the vertices looked at, how far off they may be at first (chosen:
# a ball stretched by a quarter), and the step at which it has settled.
_REACH, _LOOSE, _SETTLED = 1.5, 0.15, 1e-6
_ROOM = 1.5  # chosen: centres move by a few mm
_CLOSED = 6  # steps after which the limit has closed to its widest final value

_FEWEST = 12  # chosen: three times what a sphere needs

_CYLINDER_STEPS = 40
_BAND = 0.15  # share of the radius beyond which a point has no weight; chosen
_SECTORS = 72  # of 5 degrees, to measure the arc that is covered

BLUNT_M = 1e-3
"""Depth below the furthest vertex over which a vertex's weight falls to 1/e, for spines and epicondyles.

On a paraboloid the noise of the result is, along each axis, that of the vertices times
sqrt(area of a vertex / 8 pi) / depth, whatever its radius. A crooked tip pulls the result aside, the more
the deeper one looks. Chosen: on virtual bones these points are 0.6-1.7 mm off the truth, with 2 mm of
depth 1.4-2.7 mm; 1 mm of noise on 60,000 faces leaves 0.3 mm per axis."""

SHARP_M = 2e-3
"""The same for the ends of tibia and fibula, which are small and even: chosen, half the noise, and the
malleoli of virtual bones stay within 0.3 mm of the truth."""

WINDOW_M = 8e-3
"""Standard deviation of the window around the tip, across the direction: chosen, about the radius of a
malleolus, so that a second bump or a long ridge beside the tip counts little."""

_TIP_STEPS = 40
_NOTHING = 1e-9  # share of the largest weight below which a vertex is left out, only to be quick


@dataclass(frozen=True, slots=True, kw_only=True)
class SphereOnBone:
    """A sphere with the share of it that the surface covers.

    ``radius``, ``rms``: m.
    """

    centre: Array  # (3,), m; in the surface's own frame
    radius: float
    rms: float
    covered: float  # share of the sphere's full solid angle
    support: Array  # (n,); weight of every vertex, 0 to 1


def place_sphere(surface: Surface, ball: SphereOnBone) -> results.Sphere:
    """The sphere in the image."""
    return results.Sphere(surface.to_image(ball.centre), ball.radius, results.Quality(ball.rms, ball.covered))


def find_spheres(surface: Surface, radii: tuple[float, float], *, hollow: bool = False) -> list[SphereOnBone]:
    """The spheres that most of the surface lies on, the best covered first.

    Every vertex votes, with its area, for the centres that lie behind it (before it, if ``hollow``)
    at each radius, as in a Hough transform; the peaks are refined by geometric least squares.

    ``radii`` m: smallest and largest. ``hollow``: sockets, whose normals point to their centre, in place of
    balls.
    """
    found: list[SphereOnBone] = []
    for centre, radius in _find_peaks(surface, radii, hollow):
        sphere = refine_sphere(surface, centre, radius, hollow=hollow)
        if sphere is None or not radii[0] <= sphere.radius <= radii[1]:
            continue
        if all(np.linalg.norm(sphere.centre - other.centre) > _APART_M for other in found):
            found.append(sphere)
    return sorted(found, key=lambda sphere: -sphere.covered)


def refine_sphere(
    surface: Surface, centre: Array, radius: float, *, hollow: bool = False
) -> SphereOnBone | None:
    """The robust least-squares sphere near a first guess, or None where there is none.

    Selection uses the smoothed surface, the fit the vertices themselves, each weighted by its area and
    by Tukey's biweight of its distance, the limit of which follows the scatter that is found.
    """
    sign = -1.0 if hollow else 1.0
    limit = _START * radius
    about = _Around.of(surface, centre, radius + limit)
    for step in range(_SPHERE_STEPS):
        about = about.widen(surface, centre, radius + limit)
        chosen = about.part
        offset = chosen.smooth - centre
        distance = np.maximum(np.sqrt(np.einsum("ij,ij->i", offset, offset)), 1e-9)
        facing = sign * np.einsum("ij,ij->i", offset, chosen.normals) / distance
        gap = distance - radius
        near = (np.abs(gap) < limit) & (facing > _ALIGNED)
        if int(near.sum()) < _FEWEST:
            return None
        weight = (1.0 - (gap[near] / limit) ** 2) ** 2
        fit = shapes.fit_sphere(chosen.points[near], weight * chosen.areas[near], start=centre)
        moved = float(np.linalg.norm(fit.centre - centre)) + abs(fit.radius - radius)
        if not fit.converged or moved > 0.5 * radius:
            return None
        centre, radius = fit.centre, fit.radius
        values = np.abs(gap[near])
        weights = chosen.areas[near]
        order = np.argsort(values)
        total = np.cumsum(weights[order])
        scatter = 1.4826 * float(values[order][np.searchsorted(total, 0.5 * total[-1])])
        # A vote finds the centre to a few mm and the radius less well: the limit closes in from wide.
        widest = max(_WIDEST, _START * _CLOSING ** (step + 1)) * radius
        limit = float(np.clip(_SPREAD * scatter, _NARROWEST * radius, widest))
        if moved < _SETTLED_M and step > _CLOSED:
            break
    support = np.zeros(len(surface.points))
    support[about.rows[near]] = weight
    return SphereOnBone(
        centre=centre,
        radius=radius,
        rms=fit.rms,
        covered=measure_coverage(surface, centre, support),
        support=support,
    )


def measure_stretch(surface: Surface, ball: SphereOnBone) -> tuple[float, Array]:
    """By how much a ball is longer along one direction than along another, as a share, and the direction.

    The ellipsoid of least distances about the sphere, selected as the sphere is but by its own distances: a
    point x lies on it where (I - S)(x - c) has the length R, with S symmetric and without a trace.
    Returns the difference between the extreme eigenvalues of S and the direction (3,), in the surface's own
    frame, of the one that is further from nought.
    """
    centre, radius, strain = ball.centre, ball.radius, np.zeros((3, 3))
    reach = np.flatnonzero(np.linalg.norm(surface.smooth - centre, axis=1) < _REACH * radius)
    smooth, points = surface.smooth[reach] - centre, surface.points[reach] - centre
    normals, areas = surface.normals[reach], surface.areas[reach]
    centre = np.zeros(3)
    for step in range(_SPHERE_STEPS):
        limit = max(_WIDEST, _LOOSE * _CLOSING**step) * radius
        mapped = (smooth - centre) @ (np.eye(3) - strain)
        length = np.maximum(np.linalg.norm(mapped, axis=1), 1e-9)
        outward = mapped @ (np.eye(3) - strain)
        facing = np.einsum("ij,ij->i", outward, normals) / np.maximum(np.linalg.norm(outward, axis=1), 1e-9)
        gap = length - radius
        near = (np.abs(gap) < limit) & (facing > _ALIGNED)
        weight = (1.0 - (gap[near] / limit) ** 2) ** 2 * areas[near]
        mapped = (points[near] - centre) @ (np.eye(3) - strain)
        length = np.maximum(np.linalg.norm(mapped, axis=1), 1e-9)
        a, b, c = u = (mapped / length[:, None]).T
        parts = [a * a - c * c, b * b - c * c, 2.0 * a * b, 2.0 * a * c, 2.0 * b * c]
        columns = np.column_stack([*u, np.ones(len(a)), *(radius * part for part in parts)])
        root = np.sqrt(weight)
        move = np.linalg.lstsq(root[:, None] * columns, root * (length - radius), rcond=None)[0]
        centre, radius = centre + move[:3], radius + float(move[3])
        xx, yy, xy, xz, yz = move[4:]
        strain = strain + np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, -xx - yy]])
        if np.abs(move).max() < _SETTLED:
            break
    values, directions = np.linalg.eigh(strain)
    return float(values[2] - values[0]), directions[:, int(np.argmax(np.abs(values)))]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Around:
    """The vertices around a place: a sphere is on a small part of a bone."""

    centre: Array  # (3,), m
    reach: float  # m; no vertex nearer to the centre is missing
    rows: NDArray[np.intp]  # (n,); which vertices of the surface these are
    part: Surface  # these vertices

    @classmethod
    def of(cls, surface: Surface, centre: Array, reach: float) -> _Around:
        """All vertices nearer than half as far again, so that a centre may move."""
        wide = _ROOM * reach
        rows = np.flatnonzero(((surface.smooth - centre) ** 2).sum(axis=1) < wide**2)
        return cls(centre=centre, reach=wide, rows=rows, part=surface.part(rows))

    def widen(self, surface: Surface, centre: Array, reach: float) -> _Around:
        """The same where it holds all vertices within reach of a centre, else anew."""
        held = float(np.linalg.norm(centre - self.centre)) + reach <= self.reach
        return self if held else _Around.of(surface, centre, reach)


def measure_coverage(surface: Surface, centre: Array, support: Array) -> float:
    """Share of the full solid angle that the supporting vertices take up."""
    offset = (surface.smooth - centre)[support > 0]
    distance = np.linalg.norm(offset, axis=1)
    facing = np.abs(np.einsum("ij,ij->i", offset, surface.normals[support > 0])) / distance
    return float((surface.areas[support > 0] * facing / distance**2).sum() / (4.0 * np.pi))


def _find_peaks(surface: Surface, radii: tuple[float, float], hollow: bool) -> list[tuple[Array, float]]:
    """Where the votes are densest over position and radius, the best first, apart from each other."""
    inwards = surface.normals if hollow else -surface.normals
    tried = np.arange(radii[0], radii[1] + 1e-9, _RADIUS_STEP_M)
    ends = np.concatenate([surface.smooth + radius * inwards for radius in (tried[0], tried[-1])])
    low = surface.smooth.min(axis=0) - radii[1]
    low += _CELL_M * np.floor((ends.min(axis=0) - low) / _CELL_M)
    shape = tuple(((ends.max(axis=0) - low) / _CELL_M).astype(int) + 1)
    best = np.zeros(shape)
    best_radius = np.zeros(shape)
    for radius in tried:
        cell = ((surface.smooth + radius * inwards - low) / _CELL_M).astype(np.intp)
        flat = np.ravel_multi_index((cell[:, 0], cell[:, 1], cell[:, 2]), shape)
        votes = np.bincount(flat, surface.areas, int(np.prod(shape))).reshape(shape)
        share = _add_neighbours(votes) / (4.0 * np.pi * radius**2)
        np.copyto(best_radius, radius, where=share > best)
        np.maximum(best, share, out=best)
    centres = low + _CELL_M * (np.argwhere(best > 0) + 0.5)
    scores, of = best[best > 0], best_radius[best > 0]
    found: list[tuple[Array, float]] = []
    while len(found) < _MOST_PEAKS and len(scores) and scores.max() > 0:
        k = int(np.argmax(scores))
        found.append((centres[k], float(of[k])))
        scores = np.where(np.linalg.norm(centres - centres[k], axis=1) < _APART_M, 0.0, scores)
    return found


def _add_neighbours(votes: Array) -> Array:
    """Of every cell its own votes and those of the 26 around it."""
    for axis in range(votes.ndim):
        own = np.moveaxis(votes, axis, 0)
        votes = np.empty_like(votes)
        total = np.moveaxis(votes, axis, 0)
        total[0] = own[0]
        np.add(own[1:], own[:-1], out=total[1:])
        total[:-1] += own[1:]
    return votes


@dataclass(frozen=True, slots=True, kw_only=True)
class CylinderOnBone:
    """A cylinder in the surface's own frame, m.

    ``covered`` is the share of the full turn that the supporting points span, ``area`` (m2) what lies
    on it, ``support`` the weight of every vertex.
    """

    point: Array
    direction: Array
    radius: float
    rms: float
    covered: float
    area: float
    support: Array


def refine_cylinder(
    surface: Surface,
    point: Array,
    direction: Array,
    radius: float,
    *,
    ridge: float,
    within: NDArray[np.bool_],
) -> CylinderOnBone | None:
    """The robust least-squares cylinder near a first guess, or None where there is none.

    ``ridge``: largest sine of the angle between a normal and the plane across the axis: small values keep
    to the ridges of barrel-shaped condyles. ``within`` (n,): the only vertices to use.
    """
    chosen = surface.part(within)
    limit = _BAND * radius
    for _ in range(_CYLINDER_STEPS):
        offset = chosen.smooth - point
        radial = offset - (offset @ direction)[:, None] * direction
        distance = np.maximum(np.linalg.norm(radial, axis=1), 1e-9)
        facing = np.einsum("ij,ij->i", radial, chosen.normals) / distance
        gap = distance - radius
        near = (np.abs(gap) < limit) & (facing > _ALIGNED) & (np.abs(chosen.normals @ direction) < ridge)
        if int(near.sum()) < _FEWEST:
            return None
        support = np.where(near, (1.0 - (gap / limit) ** 2) ** 2, 0.0)
        fit = shapes.fit_cylinder(chosen.points[near], direction, point, (support * chosen.areas)[near])
        moved = float(
            np.linalg.norm(fit.point - point)
            + abs(fit.radius - radius)
            + radius * np.linalg.norm(fit.direction - direction)
        )
        if not fit.converged or moved > radius:
            return None
        point, direction, radius = fit.point, fit.direction, fit.radius
        limit = _BAND * radius
        if moved < _SETTLED_M:
            break
    first, second = shapes.span_plane(direction)
    angle = np.arctan2(radial[near] @ second, radial[near] @ first)
    sectors = np.unique(((angle + np.pi) * (_SECTORS / (2 * np.pi))).astype(int) % _SECTORS)
    whole = np.zeros(len(surface.points))
    whole[within] = support
    area = float(chosen.areas[near].sum())
    return CylinderOnBone(
        point=point,
        direction=direction,
        radius=radius,
        rms=fit.rms,
        covered=len(sectors) / _SECTORS,
        area=area,
        support=whole,
    )


def find_tip(surface: Surface, direction: Array, within: NDArray[np.bool_], depth: float = BLUNT_M) -> Array:
    """Where the chosen part reaches furthest, shape (3,), m.

    The mean over the surface, weighted by area, by the exponential of the height over ``depth`` and by a
    window that is moved to the mean until both agree (mean shift; Comaniciu and Meer 2002). It starts from
    the mean without a window, not from the highest vertex, which noise and decimation choose. Heights of
    a paraboloid are then distributed so that their variance over the depth is what the mean lies below
    the summit; by that the mean is lifted.

    ``direction`` (3,): unit vector. ``within``: (n,). ``depth``: m.
    """
    points = surface.smooth[within]
    height = points @ direction
    reach = surface.areas[within] * np.exp((height - height.max()) / depth)
    reaching = reach > _NOTHING * reach.max()
    points, height, reach = points[reaching], height[reaching], reach[reaching]
    weight = reach / reach.sum()
    for _ in range(_TIP_STEPS):
        mean = weight @ points
        offset = points - mean
        across = np.einsum("ij,ij->i", offset, offset) - (offset @ direction) ** 2
        weight = reach * np.exp(-0.5 * across / WINDOW_M**2)
        weight = weight / weight.sum()
        if np.linalg.norm(weight @ points - mean) < _SETTLED_M:
            break
    below = weight @ (height - weight @ height) ** 2 / depth
    return np.asarray(weight @ points + below * direction)
