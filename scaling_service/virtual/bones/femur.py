"""A femur around the hip centre, the knee centre and the knee axis of a person.

Everything is in the thigh's frame of a right leg: origin at the hip centre, x forward, y up from the
knee to the hip centre, z to the right. Lengths along the bone grow with it; thicknesses with its knee.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from scaling_service.virtual.bones.proportions import LegShape
from scaling_service.virtual.bones.shapes import (
    Array,
    HalfSpace,
    Part,
    Plate,
    Shaft,
    Shape,
    Solid,
    ball,
    chain,
    rod,
)

BREADTH_M = 0.0827  # epicondylar breadth for which thicknesses are given below: men, Kapur et al.
_CONDYLES_APART = 0.57  # of the epicondylar breadth; chosen, centres of both spheres lie 45-50 mm apart
_WALL_M = 4.5e-3  # chosen: the epicondyles stand out this far beyond the condyles' sides
_EPICONDYLE_M = 10e-3  # chosen: radius of an epicondyle's tip
_UPPER = (0.35, 0.5, 0.7, 0.88, 1.0)  # levels of the shaft above its flare, shares of its height
_SHAFT_TILT = np.radians(6.0)  # between shaft and mechanical axis; chosen, usual are 5-7 degrees


@dataclass(frozen=True, slots=True, eq=False)
class Femur:
    """A femur's solid, and what is true of it, in the thigh's frame of a right leg, m.

    ``condyles`` are the centres of the medial and the lateral sphere; ``landmarks`` lie on the surface.
    """

    solid: Shape
    condyles: tuple[Array, Array]
    landmarks: dict[str, Array]


def femur(shape: LegShape, length: float, axis: Array) -> Femur:
    """Build a right femur.

    Parameters
    ----------
    length : float, m
        From hip to knee centre.
    axis : (3,)
        Unit vector along the knee's true axis, to the right.
    """
    w = shape.epicondylar_breadth / BREADTH_M
    knee = np.array([0.0, -length, 0.0])
    half = 0.5 * _CONDYLES_APART * shape.epicondylar_breadth
    medial, lateral = knee - half * axis, knee + half * axis
    tips = {"MFE": knee - _to_side(shape), "LFE": knee + _to_side(shape)}
    parts = [
        Part(_shaft(shape, length, w)),
        *_upper_end(shape, w),
        Part(_condyles(shape, knee, axis, w), 6e-3),
        *(_epicondyle(tips[name], sign * axis, knee, w) for name, sign in (("MFE", -1.0), ("LFE", 1.0))),
        *_hollows(knee, w),
        Part(ball(np.zeros(3), shape.head_radius), 3e-3),
    ]
    return Femur(Solid(tuple(parts)), (medial, lateral), tips)


def _to_side(shape: LegShape) -> Array:
    return np.array([0.0, 0.0, 0.5 * shape.epicondylar_breadth])


def _neck_base(shape: LegShape) -> Array:
    """Where the neck's axis meets the shaft's."""
    from_shaft = np.pi - shape.neck_shaft
    down = from_shaft - _SHAFT_TILT
    reach = shape.femoral_offset / np.sin(from_shaft)
    out = reach * np.sin(down)
    return np.array(
        [-out * np.sin(shape.anteversion), -reach * np.cos(down), out * np.cos(shape.anteversion)]
    )


def _shaft(shape: LegShape, length: float, w: float) -> Shaft:
    """From the neck's base into the condyles, bowed forward, flaring at both ends."""
    top = np.add(_neck_base(shape), [0.0, 8e-3, 0.0])
    bottom = _shifted(np.array([0.0, -length, 0.0]), (18, 18, 0), w)
    share = np.concatenate([1e-3 * w * np.array([0.0, 18.0, 38.0, 70.0]) / (top - bottom)[1], _UPPER])
    line = bottom + share[:, None] * (top - bottom)
    line[:, 0] += shape.femoral_bow * 4.0 * share * (1.0 - share)
    r, mm = shape.shaft_radius, 1e-3 * w
    half_x = [20 * mm, 19 * mm, 17 * mm, 1.12 * r, r, r, r, 1.1 * r, 1.15 * r]
    half_z = [32 * mm, 28 * mm, 22 * mm, 1.25 * r, 1.05 * r, 0.95 * r, 1.0 * r, 1.15 * r, 1.2 * r]
    return Shaft(
        line[:, 1], line[:, 0], line[:, 2], np.array(half_x), np.array(half_z), ridge=-0.03, rounding=10e-3
    )


def _upper_end(shape: LegShape, w: float) -> list[Part]:
    """Neck and trochanters."""
    base, r = _neck_base(shape), shape.head_radius
    corners = [_shifted(base, at, w) for at in ((4, -13, 12.5), (-20, -7, 12.5), (-16, 28, 11))]
    return [
        Part(Plate(np.array(corners), 11.5e-3 * w), 9e-3),
        Part(ball(_shifted(base, (-12, -36, -12), w), 9.5e-3 * w), 10e-3),
        Part(rod(0.25 * base, base, 0.62 * r, 0.72 * r), 7e-3),
    ]


def _condyles(shape: LegShape, knee: Array, axis: Array, w: float) -> Solid:
    """Both condyles with the trochlea, their sides cut square to the axis.

    Behind and below, each is a sphere about its centre on the axis; in front it grows into the trochlea.
    """
    parts = []
    half = 0.5 * _CONDYLES_APART * shape.epicondylar_breadth
    for sign, radius in zip((-1.0, 1.0), shape.condyle_radii, strict=True):
        centre = knee + sign * half * axis
        ahead = centre + 1e-3 * w * np.array([22.0, 3.0, -3.0 * sign])
        parts.append(Part(rod(centre, ahead, radius, 0.97 * radius)))
    front = [_shifted(knee, at, w) for at in ((24, 9, -17), (27, 11, 18))]
    parts.append(Part(rod(front[0], front[1], 18e-3 * w, 19e-3 * w), 5e-3))
    above = [_shifted(knee, at, w) for at in ((12, 20, -14), (12, 20, 14))]
    parts.append(Part(rod(above[0], above[1], 20e-3 * w), 6e-3))
    wall = 0.5 * shape.epicondylar_breadth - _WALL_M
    parts += [Part(HalfSpace(knee + s * wall * axis, s * axis), 5e-3, "trim") for s in (-1.0, 1.0)]
    return Solid(tuple(parts))


def _epicondyle(tip: Array, outward: Array, knee: Array, w: float) -> Part:
    """A bump whose furthest point along the knee's axis is the tip."""
    radius = _EPICONDYLE_M * w
    centre = tip - radius * outward
    inner = np.array([0.012 * w, knee[1] + 0.024 * w, 0.6 * centre[2]])
    return Part(rod(centre, inner, radius, 1.4 * radius), 4e-3)


def _hollows(knee: Array, w: float) -> list[Part]:
    """The groove of the kneecap in front and the notch between the condyles."""
    groove = [_shifted(knee, at, w) for at in ((52, 40, 2), (57, 14, 2), (50, -14, 1), (30, -31, 0))]
    notch = [_shifted(knee, at, w) for at in ((-34, -4, 0), (-12, -16, 0), (6, -24, 0))]
    return [
        Part(chain(groove, [13e-3 * w, 13e-3 * w, 12e-3 * w, 10e-3 * w]), 5e-3, "cut"),
        Part(chain(notch, [9e-3 * w, 9e-3 * w, 8e-3 * w]), 4e-3, "cut"),
    ]


def _shifted(point: Array, by_mm: ArrayLike, w: float) -> Array:
    moved: Array = point + 1e-3 * w * np.asarray(by_mm, dtype=float)
    return moved
