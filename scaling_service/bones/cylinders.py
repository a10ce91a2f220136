"""A cylinder on a part of a surface: robust, geometric, judged by coverage."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.bones.surface import Surface
from scaling_service.numerics.geometry.fits import across, fit_cylinder

Array = NDArray[np.float64]

_STEPS = 40
_SETTLED_M = 1e-7
_BAND = 0.15  # share of the radius beyond which a point has no weight; chosen
_ALIGNED = np.cos(np.deg2rad(35.0))  # as for spheres
_FEWEST = 12
_SECTORS = 72  # of 5 degrees, to measure the arc that is covered


@dataclass(frozen=True, slots=True)
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


def refined_cylinder(
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
    for _ in range(_STEPS):
        offset = chosen.smooth - point
        radial = offset - (offset @ direction)[:, None] * direction
        distance = np.maximum(np.linalg.norm(radial, axis=1), 1e-9)
        facing = np.einsum("ij,ij->i", radial, chosen.normals) / distance
        gap = distance - radius
        near = (np.abs(gap) < limit) & (facing > _ALIGNED) & (np.abs(chosen.normals @ direction) < ridge)
        if int(near.sum()) < _FEWEST:
            return None
        support = np.where(near, (1.0 - (gap / limit) ** 2) ** 2, 0.0)
        fit = fit_cylinder(chosen.points[near], direction, point, (support * chosen.areas)[near])
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
    first, second = across(direction)
    angle = np.arctan2(radial[near] @ second, radial[near] @ first)
    sectors = np.unique(((angle + np.pi) * (_SECTORS / (2 * np.pi))).astype(int) % _SECTORS)
    whole = np.zeros(len(surface.points))
    whole[within] = support
    area = float(chosen.areas[near].sum())
    return CylinderOnBone(point, direction, radius, fit.rms, len(sectors) / _SECTORS, area, whole)
