"""Where the sphere of a joint's facet may lie: all spheres weighed by what they explain, not the best one.

A talus's head is no sphere, and of the hollow on its heel a few degrees are seen: which patch a least-squares
fit settles on changes with a grain of noise, its centre by 7 mm. The mean over all spheres does not jump.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.bones.deviations import GRAIN_M
from scaling_service.bones.surface import Surface
from scaling_service.core.arrays import Array

_OFF_M = 1e-3
"""How far a facet departs from its sphere; chosen: three persons' rms are 0.3-0.5 mm, and half a voxel."""
_ODDS = 8.0
"""Density of a place on the sphere over one elsewhere, both as likely: chosen, 20 mm of bone over
the root of 2 pi times what a facet departs."""
_NONE, _WHOLE = (float(np.cos(np.deg2rad(angle))) for angle in (45.0, 20.0))
"""Normals further off do not belong to the sphere, nearer ones do; chosen about the 35 degrees of fits."""

_REACH_M = 8e-3  # of the first search to either side; chosen: above the 7 mm by which starts differ
_LEAST_REACH_M = 2e-3  # of the second, which spans three deviations
_TICKS = 9  # places along each axis, and radii
_CELL_M = 2e-3  # chosen: what lies in one counts as one place, of which a facet has hundreds


@dataclass(frozen=True, slots=True, kw_only=True)
class LikelySphere:
    """The mean of a sphere's centre, (3,), and of its radius, m, in the surface's own frame.

    ``deviation`` m: root mean square distance in space. ``area`` m2: expected to lie on it. ``rms`` m: of
    what lies near it.
    """

    centre: Array
    radius: float
    deviation: float
    area: float
    rms: float

    @property
    def covered(self) -> float:
        """Share of the whole sphere."""
        return self.area / float(4.0 * np.pi * self.radius**2)


@dataclass(frozen=True, slots=True, kw_only=True)
class Usual:
    """Radius, and where it is known the centre, of persons alike: means and standard deviations, m.

    ``centre``: (3,). ``axes``: (3, 3), unit vectors in rows, along which ``spread`` (3,) stands.
    """

    radius: float
    radius_sd: float
    centre: Array | None = None
    axes: Array | None = None
    spread: Array | None = None

    def weigh(self, centres: Array, radii: Array) -> Array:
        """Logarithm of the prior density, shape (n_centres, n_radii), up to a constant."""
        weight = -0.5 * ((radii - self.radius) / self.radius_sd) ** 2 + np.zeros((len(centres), 1))
        if self.centre is None or self.axes is None or self.spread is None:
            return weight
        away = (centres - self.centre) @ self.axes.T / self.spread
        return np.asarray(weight - 0.5 * (away**2).sum(axis=1)[:, None])


def average_spheres(surface: Surface, start: Array, usual: Usual, *, hollow: bool = False) -> LikelySphere:
    """The mean of all spheres near a place, each weighed by its posterior probability.

    A grain of the surface lies on the sphere, up to a normal departure of 1 mm, or anywhere, with equal
    chances. ``start``: (3,), m. ``hollow``: a socket, whose normals point to its centre.
    """
    found, reach = _average(surface, start, usual, _REACH_M, hollow), _LEAST_REACH_M
    return _average(surface, found.centre, usual, max(reach, 3.0 * found.deviation), hollow)


def _average(surface: Surface, start: Array, usual: Usual, reach: float, hollow: bool) -> LikelySphere:
    ticks = np.linspace(-reach, reach, _TICKS)
    centres = start + np.stack(np.meshgrid(ticks, ticks, ticks), axis=-1).reshape(-1, 3)
    radii = usual.radius + usual.radius_sd * np.linspace(-2.0, 2.0, _TICKS)
    furthest = radii[-1] + np.sqrt(3.0) * reach + 3.0 * _OFF_M
    points, normals, areas = _gather(surface, ((surface.smooth - start) ** 2).sum(axis=1) < furthest**2)
    offset = (points**2).sum(axis=1) - 2.0 * centres @ points.T + (centres**2).sum(axis=1)[:, None]
    distance = np.sqrt(np.maximum(offset, 1e-12))
    outwards = (np.einsum("ij,ij->i", points, normals) - centres @ normals.T) / distance
    aligned = np.clip(((-outwards if hollow else outwards) - _NONE) / (_WHOLE - _NONE), 0.0, 1.0)
    weight, area = usual.weigh(centres, radii), np.empty((len(centres), len(radii)))
    for k, radius in enumerate(radii):
        odds = _ODDS * aligned * np.exp(-0.5 * ((distance - radius) / _OFF_M) ** 2)
        weight[:, k] += np.log1p(odds) @ areas / GRAIN_M**2
        area[:, k] = (odds / (1.0 + odds)) @ areas
    share = np.exp(weight - weight.max())
    share /= share.sum()
    centre, radius = share.sum(axis=1) @ centres, float(share.sum(axis=0) @ radii)
    gap = np.linalg.norm(points - centre, axis=1) - radius
    near = areas * (np.abs(gap) < 3.0 * _OFF_M)
    return LikelySphere(
        centre=centre,
        radius=radius,
        deviation=float(np.sqrt(share.sum(axis=1) @ ((centres - centre) ** 2).sum(axis=1))),
        area=float((share * area).sum()),
        rms=float(np.sqrt((near @ gap**2) / max(float(near.sum()), 1e-12))),
    )


def _gather(surface: Surface, within: NDArray[np.bool_]) -> tuple[Array, Array, Array]:
    """Means of places (n, 3) and normals (n, 3) of the vertices in each cell, and the cells' areas (n,)."""
    places, areas = surface.smooth[within], surface.areas[within]
    of = np.unique(np.floor(places / _CELL_M).astype(np.intp), axis=0, return_inverse=True)[1].ravel()
    whole = np.bincount(of, areas).astype(float)
    points, normals = (
        np.column_stack([np.bincount(of, areas * column) for column in values.T]) / whole[:, None]
        for values in (places, surface.normals[within])
    )
    return points, normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-9)[:, None], whole
