"""The talus: the ankle's axis from a cylinder on its trochlea, the subtalar one from spheres on facets."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from scaling_service.bones import fits, posterior_sphere, results, shapes
from scaling_service.bones import surface as surfaces
from scaling_service.bones.deviations import add_definitions, deviate_cylinder, deviate_line
from scaling_service.bones.pieces import require_one_bone
from scaling_service.bones.tibia import TibiaFrame
from scaling_service.core.arrays import Array

RADII_M = (0.013, 0.032)  # trochleae have radii of 18-25 mm in adults; chosen around them

SIZE_M = (0.035, 0.085)  # length of a talus, a child's to a giant's; adults have 50-65 mm

ARC = 0.15  # least arc of the trochlea as a share of the turn: chosen, half of the usual 100-120 degrees
AREA = 0.5  # least supporting area as a share of the squared radius: chosen, a third of the usual 1.5-2

HEAD_RADII_M = (0.009, 0.025)  # chosen around 12-14 mm on three adults
HEAD_COVERED = 0.3
"""Least share of a head's sphere that is expected to lie on the bone; chosen, four adults have 0.36-0.53 on
clean, coarse, noisy and voxelled surfaces. That of the best fit alone hangs on a grain of noise."""
HEAD_OFF_M = 0.01  # least way from the ankle's axis to the head; chosen, three adults have 16-25 mm
FACET_RADII_M = (0.013, 0.030)  # of the hollow that sits on the heel bone; chosen around 17-22 mm
FACET_AREA = 0.3  # least area of it as a share of the squared radius; chosen, three adults have 0.5-1.1

_FACET_AT, _FACET_SD = (-0.55, -1.0, 0.5), (0.3, 0.4, 0.25)
"""Where the centre of the facet's sphere lies from the ankle's, forward, up and lateral, in radii of the
trochlea. Four persons have -0.42 to -0.73, -0.77 to -1.32 and 0.40 to 0.60; the deviations are the whole
range, which each of them is within when the others set it."""
_HEAD_SIZE, _FACET_SIZE = (0.67, 0.06), (0.9, 0.15)
"""Radii of head and facet over the trochlea's, mean and deviation: four persons' 0.59-0.74 and 0.76-1.08."""
_ANOTHER_M = 10e-3  # chosen: half a facet's radius; nearer ones are one hollow
_FACET_UNLIKE = 16.3  # squared deviations in space that one of a thousand exceeds

_GAP_M = 6e-3
"""What of a talus is nearer to tibia and fibula than this is its part of the joint: chosen, a joint space of
2-5 mm and a step of the meshes."""

_ENDS_M = 1e-3  # chosen: along the axis the trochlea's ends are blunt

MORTISE = 0.12
"""Least share of the surface in the mortise: chosen, half of the 0.25-0.29 of three persons; a heel bone in
its place has 0, one that is pushed up until it touches the tibia 0.03-0.08. A fourth person, measured after
it was chosen, has 0.31."""

_RIDGE = float(np.sin(np.deg2rad(25.0)))  # keeps to the dome; its sides stand across
_DIRECTIONS = 150  # chosen: about 11 degrees apart on the half sphere
_CELL_M = 2e-3
_TRIED = 5


def find_talus_landmarks(
    vertices: Array, faces: NDArray[np.integer], *, named_side: results.Side | None = None, tibia: TibiaFrame
) -> results.BoneLandmarks:
    """The centres and axes of the ankle and of the subtalar joint from a talus beside its tibia.

    ``vertices``: (n, 3), m. ``faces``: (m, 3). ``named_side`` {"r", "l"}: a talus alone is what it is
    called. ``tibia``: of the same image: the trochlea faces it, and the axis is signed by it. A talus alone
    has other cylinders (its neck, the rims of its facets) that carry as much surface. Returns points
    ``ankle_centre`` and, on the subtalar axis, ``subtalar_centre``, cylinder ``trochlea``, spheres ``head``
    and ``heel_facet``, axes ``ankle`` and ``subtalar``, which points forward; what is subtalar is refused
    where a sphere is not found. Raises MeshRefused: it is no talus, or no part of it is a cylinder of a
    trochlea's size.

    The subtalar axis runs through the centres of spheres on the talonavicular and the posterior talocalcaneal
    facet (Parr et al. 2012, J Biomech 45:1103-1107; Montefiori et al. 2019, J Biomech 85:27-36).
    """
    surface, notes = require_one_bone(surfaces.prepare(vertices, faces), "talus")
    length = float(np.ptp(surface.points[:, 0]))
    if not SIZE_M[0] <= length <= SIZE_M[1]:
        raise results.MeshRefused(
            f"it is {1e3 * length:.4g} mm long; a talus has {1e3 * SIZE_M[0]:.0f}-{1e3 * SIZE_M[1]:.0f} mm",
            remedy="Check the unit (mm or m), and that it is a talus",
        )
    _require_mortise(surface, tibia)
    up, right = surface.R_image_own.T @ tibia.y, surface.R_image_own.T @ tibia.z
    found = _find_trochlea(surface, up, right)
    axis = found.direction * np.sign(found.direction @ right)
    supported = found.support > 0
    along = (surface.points[supported] - found.point) @ axis
    centre = found.point + axis * 0.5 * float(np.quantile(along, 0.02) + np.quantile(along, 0.98))
    head, facet = _find_subtalar_spheres(
        surface, centre, axis if named_side != "l" else -axis, up, found.radius
    )
    spheres = {
        name: results.Sphere(
            surface.to_image(ball.centre), ball.radius, results.Quality(ball.rms, ball.covered)
        )
        for name, ball in (("head", head), ("heel_facet", facet))
        if ball is not None
    }
    across, turned = deviate_cylinder(surface, found)
    off, turns = {"ankle_centre": float(np.hypot(across, _ENDS_M))}, {"ankle": turned}
    points, axes = {"ankle_centre": surface.to_image(centre)}, {"ankle": surface.turn_to_image(axis)}
    words = {"ankle_centre": "middle of the trochlea on the axis of its least-squares cylinder"}
    if head is not None and facet is not None:
        forward = spheres["head"].centre - spheres["heel_facet"].centre
        points["subtalar_centre"], axes["subtalar"] = (
            spheres["heel_facet"].centre,
            forward / np.linalg.norm(forward),
        )
        off["subtalar_centre"] = facet.deviation
        turns["subtalar"] = deviate_line(float(np.linalg.norm(forward)), head.deviation, facet.deviation)
        words["subtalar_centre"] = "centre of the sphere on the facet that sits on the heel bone"
    deviations, axis_deviations = add_definitions(off, turns)
    missing = "head" if head is None else "facet that sits on the heel bone"
    return results.BoneLandmarks(
        bone="talus",
        side=named_side,
        side_from="name",
        points=points,
        deviations=deviations,
        axis_deviations=axis_deviations,
        spheres=spheres,
        cylinders={
            "trochlea": results.Cylinder(
                surface.to_image(centre),
                surface.turn_to_image(axis),
                found.radius,
                results.Quality(found.rms, found.covered),
            )
        },
        axes=axes,
        definitions=words,
        refused={} if "subtalar" in axes else {"subtalar_centre": f"no sphere fits its {missing}"},
        warnings=(*surface.notes, *notes),
    )


def _require_mortise(surface: surfaces.Surface, tibia: TibiaFrame) -> None:
    """Raises MeshRefused: tibia and fibula do not hold it, as they do a talus and no other bone."""
    gap = np.asarray(cKDTree(tibia.surface).query(surface.to_image(surface.smooth))[0])
    held = float(surface.areas[gap < _GAP_M].sum() / surface.areas.sum())
    if held < MORTISE:
        raise results.MeshRefused(
            f"at its nearest it lies {1e3 * float(gap.min()):.0f} mm from the tibia, and {100 * held:.0f} % "
            f"of it within {1e3 * _GAP_M:.0f} mm of tibia and fibula, which hold a talus by a quarter: it is "
            "another bone (a heel bone lies below the talus) or was moved",
            remedy="Give the talus and its tibia of one image, not moved apart",
        )


def _find_subtalar_spheres(
    surface: surfaces.Surface, ankle: Array, lateral: Array, up: Array, radius: float
) -> tuple[posterior_sphere.LikelySphere | None, posterior_sphere.LikelySphere | None]:
    """Its head, and the hollow behind the ankle's axis that sits on the heel bone.

    ``lateral`` (3,): along the ankle's axis. ``radius``: of the trochlea, m. Of the hollows the one counts
    whose area and place are likeliest together; one is sought where it usually is, too, and a deviation
    beside it. Where they are found is where the mean over all
    spheres is sought; a head is one by that mean.
    """
    balls = fits.find_spheres(surface, HEAD_RADII_M)
    off = [float(np.linalg.norm(np.cross(ball.centre - ankle, lateral))) for ball in balls]
    ball = next((ball for ball, away in zip(balls, off, strict=True) if away >= HEAD_OFF_M), None)
    if ball is None:
        return None, None
    mean, sd = radius * np.array(_HEAD_SIZE)
    head = posterior_sphere.average_spheres(
        surface, ball.centre, posterior_sphere.Usual(radius=mean, radius_sd=sd)
    )
    if head.covered < HEAD_COVERED:
        return None, None
    to_head = head.centre - ankle
    forward = to_head - float(to_head @ lateral) * lateral
    forward = forward / np.linalg.norm(forward)
    above = np.cross(lateral, forward)
    above *= np.sign(above @ up)
    axes = np.stack([forward, above, lateral])
    behind = surface.part(((surface.points - ankle) @ to_head < 0.0) & (surface.normals @ above < 0.0))
    usual = ankle + radius * np.array(_FACET_AT) @ axes
    tried = fits.find_spheres(behind, FACET_RADII_M, hollow=True)
    spread = radius * np.diag(_FACET_SD) @ axes
    for start in usual + np.vstack([np.zeros(3), spread, -spread]):
        there = fits.refine_sphere(behind, start, _FACET_SIZE[0] * radius, hollow=True)
        if there is None or not FACET_RADII_M[0] <= there.radius <= FACET_RADII_M[1]:
            continue
        if all(np.linalg.norm(there.centre - other.centre) > _ANOTHER_M for other in tried):
            tried.append(there)
    best, facet = 0.0, None
    for sphere in tried:
        area = float(sphere.support @ behind.areas) / sphere.radius**2
        unlike = float(np.sum((axes @ (sphere.centre - usual) / (radius * np.array(_FACET_SD))) ** 2))
        likely = area * np.exp(-0.5 * unlike)
        if area > FACET_AREA and unlike < _FACET_UNLIKE and likely > best:
            best, facet = likely, sphere
    if facet is None:
        return head, None
    mean, sd = radius * np.array(_FACET_SIZE)
    place = posterior_sphere.Usual(
        radius=mean, radius_sd=sd, centre=usual, axes=axes, spread=radius * np.array(_FACET_SD)
    )
    return head, posterior_sphere.average_spheres(behind, facet.centre, place, hollow=True)


def _find_trochlea(surface: surfaces.Surface, up: Array, right: Array) -> fits.CylinderOnBone:
    """The convex cylinder that carries most of the surface, among those that face the tibia."""
    facing = surface.normals @ up > 0.2
    directions = shapes.spread_directions(_DIRECTIONS)
    directions = directions[np.abs(directions @ up) < 0.5]
    directions = directions[np.abs(directions @ right) > 0.5]
    guesses = sorted((_vote_for_circle(surface, facing, d) for d in directions), key=lambda g: -g[0])
    found: list[fits.CylinderOnBone] = []
    for _, point, direction, radius in guesses[:_TRIED]:
        cylinder = fits.refine_cylinder(surface, point, direction, radius, ridge=_RIDGE, within=facing)
        if cylinder is not None and RADII_M[0] <= cylinder.radius <= RADII_M[1]:
            found.append(cylinder)
    if not found:
        raise results.MeshRefused(
            "no part of it is a cylinder of a trochlea's size", remedy="Give the surface of one talus"
        )
    best = max(found, key=lambda c: c.area / (1.0 + (20.0 * c.rms / c.radius) ** 2))
    if best.covered < ARC or best.area < AREA * best.radius**2 or best.rms > 0.08 * best.radius:
        raise results.MeshRefused(
            f"the best cylinder spans {360 * best.covered:.0f} degrees with {1e3 * best.rms:.1f} mm rms, "
            "too little for a trochlea",
            remedy="Give the surface of one talus",
        )
    return best


def _vote_for_circle(
    surface: surfaces.Surface, facing: NDArray[np.bool_], direction: Array
) -> tuple[float, Array, Array, float]:
    """Votes for the best circle seen along a direction: share of it, a point on its axis, radius."""
    chosen = facing & (np.abs(surface.normals @ direction) < _RIDGE)
    first, second = shapes.span_plane(direction)
    plane = np.stack([first, second])
    points, normals = surface.smooth[chosen] @ plane.T, surface.normals[chosen] @ plane.T
    areas = surface.areas[chosen]
    low = surface.smooth @ plane.T
    corner, size = low.min(axis=0) - RADII_M[1], np.ptp(low, axis=0) + 2 * RADII_M[1]
    n = int(np.ceil(size.max() / _CELL_M)) + 1
    best = (0.0, np.zeros(3), direction, RADII_M[0])
    middle = surface.middle()
    for radius in np.arange(RADII_M[0], RADII_M[1], 1.5e-3):
        cell = ((points - radius * normals - corner) / _CELL_M).astype(np.intp)
        votes = np.bincount(cell[:, 0] * n + cell[:, 1], areas, n * n).reshape(n, n)
        pooled = votes[:-1, :-1] + votes[1:, :-1] + votes[:-1, 1:] + votes[1:, 1:]
        k = int(np.argmax(pooled))
        # By radius, so that a wide arc of a small cylinder and a narrow one of a large are alike.
        score = float(pooled.ravel()[k]) / radius
        if score > best[0]:
            i, j = np.unravel_index(k, pooled.shape)
            flat = corner + _CELL_M * np.array([i + 1.0, j + 1.0])
            point = plane.T @ flat + direction * float(middle @ direction)
            best = (score, point, direction, float(radius))
    return best
