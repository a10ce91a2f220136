"""The bones of a virtual person's leg: how they differ between persons, and how they are built.

A femur is built around the hip centre, the knee centre and the knee axis of a person, in the thigh's frame:
origin at the hip centre. A tibia and a fibula are built between knee and ankle centre, in the shank's frame:
origin at the knee centre. Both are a right leg's: x forward, y up along the line of the centres, z to the
right. Lengths along a bone grow with it; thicknesses with the knee. The malleoli stand under the places of
the skin markers, so that the midpoint of their tips is the ankle centre.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from scaling_service.core.arrays import Array
from scaling_service.core.streams import stream
from scaling_service.virtual.bones import shapes
from scaling_service.virtual.subject import Sex

Side = Literal["r", "l"]

Spread = tuple[tuple[float, float], tuple[float, float], float]
"""Mean and SD of men and of women, and the correlation with the length of the bone."""

LONGEST = 2.0
"""Standard deviations beyond which nothing is drawn; chosen, the persons are healthy adults."""

SIDES_ALIKE = 0.9
"""Correlation between a person's two sides, chosen: they differ by less than half of what persons do."""

SOCKET_GAP_M = 2.5e-3
"""Between the head's and the socket's radius: chosen within 1-3 mm of cartilage on both sides."""

BREADTH_M = 0.0827  # epicondylar breadth for which thicknesses are given below: men, Kapur et al.
_CONDYLES_APART = 0.57  # of the epicondylar breadth; chosen, centres of both spheres lie 45-50 mm apart
_WALL_M = 4.5e-3  # chosen: the epicondyles stand out this far beyond the condyles' sides
_EPICONDYLE_M = 10e-3  # chosen: radius of an epicondyle's tip
_UPPER = (0.35, 0.5, 0.7, 0.88, 1.0)  # levels of the shaft above its flare, shares of its height
_SHAFT_TILT = np.radians(6.0)  # between shaft and mechanical axis; chosen, usual are 5-7 degrees

JOINT_SPACE_M = 4.5e-3  # chosen: both cartilages, about 2 mm each (J Orthop Surg 2016;24, posterior condyles)
MALLEOLUS_M = 8e-3  # chosen: radius of a malleolus' end
FIBULA_HEAD_M = 9.5e-3  # chosen: radius of the fibula's head
_APART_M = 2.5e-3  # chosen: least gap between tibia and fibula
_PLAFOND_M = 0.018  # chosen: the tibia's end over the ankle centre, about the radius of the talus

SIZES_MM: Mapping[str, Spread] = {
    # Femoral heads: facts of forensic anthropology (diameters 48 (2.5) and 42.5 (2.2)), halved.
    "head_radius": ((24.0, 1.25), (21.25, 1.1), 0.6),
    # Kapur et al., Folia Medica, 52 men and 48 women, dry bone.
    "epicondylar_breadth": ((82.65, 3.96), (72.47, 3.49), 0.6),
    # The mean of both condyles, 21.5 (1.8) mm (of the order of Iwaki et al. 2000); women a tenth less.
    "condyle_radius": ((21.5, 1.6), (19.4, 1.5), 0.6),
    # Medial over lateral: 22 against 21 mm (as above); SD chosen, no difference found by Li et al. 2012.
    "condyle_difference": ((1.0, 0.8), (0.9, 0.7), 0.0),
    # From the head's centre to the shaft's axis, square to it; chosen, usual in planning hip prostheses.
    "femoral_offset": ((42.0, 4.0), (38.0, 4.0), 0.4),
    # How far the shaft bows forward off the line between its ends; chosen.
    "femoral_bow": ((9.0, 2.0), (8.5, 2.0), 0.0),
    # Half the width in mid-shaft; chosen, the width is 26-29 mm.
    "shaft_radius": ((14.0, 0.9), (12.6, 0.8), 0.4),
}
"""Correlations with length are chosen: large bones are large all over, but not strictly."""

ANGLES_DEG: Mapping[str, Spread] = {
    # Computed tomography of 600 hips (Egypt J Radiol Nucl Med 2023, 54:96).
    "neck_shaft": ((129.65, 4.13), (129.28, 3.71), 0.0),
    # van der Linden 2015, 50 femora, both sexes.
    "anteversion": ((11.7, 8.2), (11.7, 8.2), 0.0),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class LegShape:
    """Sizes (m) and angles (rad) of one leg's bones, beside their lengths."""

    head_radius: float
    epicondylar_breadth: float
    condyle_radius: float
    condyle_difference: float
    femoral_offset: float
    femoral_bow: float
    shaft_radius: float
    neck_shaft: float
    anteversion: float

    @property
    def condyle_radii(self) -> tuple[float, float]:
        """Of the medial and the lateral condyle, m."""
        return (
            self.condyle_radius + 0.5 * self.condyle_difference,
            self.condyle_radius - 0.5 * self.condyle_difference,
        )


def make_leg_shape(seed: int, side: Side, sex: Sex, length: float) -> LegShape:
    """The bones of one leg of a person.

    ``length``: of the person's femurs and tibias, in standard deviations from the mean of the sex.

    Examples
    --------
    >>> make_leg_shape(1, "r", "M", 0.0) == make_leg_shape(1, "r", "M", 0.0)
    True
    """
    sizes = {name: 1e-3 * _draw_size(seed, name, side, sex, length, s) for name, s in SIZES_MM.items()}
    angles = {
        name: float(np.radians(_draw_size(seed, name, side, sex, length, s)))
        for name, s in ANGLES_DEG.items()
    }
    return LegShape(**sizes, **angles)


def _draw_size(seed: int, name: str, side: Side, sex: Sex, length: float, spread: Spread) -> float:
    men, women, rho = spread
    mean, sd = men if sex == "M" else women
    both, one = stream(seed, "bones", name).normal(), stream(seed, "bones", name, side).normal()
    own = np.sqrt(SIDES_ALIKE) * both + np.sqrt(1.0 - SIDES_ALIKE) * one
    share = np.clip(rho * length + np.sqrt(1.0 - rho**2) * own, -LONGEST, LONGEST)
    return float(mean + sd * share)


def build_femur(
    shape: LegShape, length: float, axis: Array
) -> tuple[shapes.Shape, tuple[Array, Array], dict[str, Array]]:
    """A right femur's solid, the centres of its condyles and its landmarks, in the thigh's frame, m.

    ``length`` (m): from hip to knee centre. ``axis`` (3,): unit vector along the knee's true axis, to the
    right.
    """
    w = shape.epicondylar_breadth / BREADTH_M
    knee = np.array([0.0, -length, 0.0])
    half = 0.5 * _CONDYLES_APART * shape.epicondylar_breadth
    medial, lateral = knee - half * axis, knee + half * axis
    tips = {"MFE": knee - _to_side(shape), "LFE": knee + _to_side(shape)}
    # From the neck's base into the condyles, bowed forward, flaring at both ends
    top = np.add(_find_neck_base(shape), [0.0, 8e-3, 0.0])
    bottom = _place_beside(np.array([0.0, -length, 0.0]), (18, 18, 0), w)
    share = np.concatenate([1e-3 * w * np.array([0.0, 18.0, 38.0, 70.0]) / (top - bottom)[1], _UPPER])
    line = bottom + share[:, None] * (top - bottom)
    line[:, 0] += shape.femoral_bow * 4.0 * share * (1.0 - share)
    r, mm = shape.shaft_radius, 1e-3 * w
    half_x = [20 * mm, 19 * mm, 17 * mm, 1.12 * r, r, r, r, 1.1 * r, 1.15 * r]
    half_z = [32 * mm, 28 * mm, 22 * mm, 1.25 * r, 1.05 * r, 0.95 * r, 1.0 * r, 1.15 * r, 1.2 * r]
    # Neck and trochanters
    base, head = _find_neck_base(shape), shape.head_radius
    corners = [_place_beside(base, at, w) for at in ((4, -13, 12.5), (-20, -7, 12.5), (-16, 28, 11))]
    # The groove of the kneecap in front and the notch between the condyles
    groove = [_place_beside(knee, at, w) for at in ((52, 40, 2), (57, 14, 2), (50, -14, 1), (30, -31, 0))]
    notch = [_place_beside(knee, at, w) for at in ((-34, -4, 0), (-12, -16, 0), (6, -24, 0))]
    parts = [
        shapes.Part(
            shapes.make_shaft(
                heights=line[:, 1],
                x=line[:, 0],
                z=line[:, 2],
                half_x=np.array(half_x),
                half_z=np.array(half_z),
                ridge=-0.03,
                rounding=10e-3,
            )
        ),
        shapes.Part(shapes.make_plate(np.array(corners), 11.5e-3 * w), 9e-3),
        shapes.Part(shapes.make_ball(_place_beside(base, (-12, -36, -12), w), 9.5e-3 * w), 10e-3),
        shapes.Part(shapes.make_rod(0.25 * base, base, 0.62 * head, 0.72 * head), 7e-3),
        shapes.Part(_build_condyles(shape, knee, axis, w), 6e-3),
        *(
            _build_epicondyle(tips[name], sign * axis, knee, w)
            for name, sign in (("MFE", -1.0), ("LFE", 1.0))
        ),
        shapes.Part(shapes.make_chain(groove, [13e-3 * w, 13e-3 * w, 12e-3 * w, 10e-3 * w]), 5e-3, "cut"),
        shapes.Part(shapes.make_chain(notch, [9e-3 * w, 9e-3 * w, 8e-3 * w]), 4e-3, "cut"),
        shapes.Part(shapes.make_ball(np.zeros(3), shape.head_radius), 3e-3),
    ]
    return shapes.join_parts(parts), (medial, lateral), tips


def _to_side(shape: LegShape) -> Array:
    return np.array([0.0, 0.0, 0.5 * shape.epicondylar_breadth])


def _find_neck_base(shape: LegShape) -> Array:
    """Where the neck's axis meets the shaft's."""
    from_shaft = np.pi - shape.neck_shaft
    down = from_shaft - _SHAFT_TILT
    reach = shape.femoral_offset / np.sin(from_shaft)
    out = reach * np.sin(down)
    return np.array(
        [-out * np.sin(shape.anteversion), -reach * np.cos(down), out * np.cos(shape.anteversion)]
    )


def _build_condyles(shape: LegShape, knee: Array, axis: Array, w: float) -> shapes.Shape:
    """Both condyles with the trochlea, their sides cut square to the axis.

    Behind and below, each is a sphere about its centre on the axis; in front it grows into the trochlea.
    """
    parts = []
    half = 0.5 * _CONDYLES_APART * shape.epicondylar_breadth
    for sign, radius in zip((-1.0, 1.0), shape.condyle_radii, strict=True):
        centre = knee + sign * half * axis
        ahead = centre + 1e-3 * w * np.array([22.0, 3.0, -3.0 * sign])
        parts.append(shapes.Part(shapes.make_rod(centre, ahead, radius, 0.97 * radius)))
    front = [_place_beside(knee, at, w) for at in ((24, 9, -17), (27, 11, 18))]
    parts.append(shapes.Part(shapes.make_rod(front[0], front[1], 18e-3 * w, 19e-3 * w), 5e-3))
    above = [_place_beside(knee, at, w) for at in ((12, 20, -14), (12, 20, 14))]
    parts.append(shapes.Part(shapes.make_rod(above[0], above[1], 20e-3 * w), 6e-3))
    wall = 0.5 * shape.epicondylar_breadth - _WALL_M
    parts += [
        shapes.Part(shapes.make_half_space(knee + s * wall * axis, s * axis), 5e-3, "trim")
        for s in (-1.0, 1.0)
    ]
    return shapes.join_parts(parts)


def _build_epicondyle(tip: Array, outward: Array, knee: Array, w: float) -> shapes.Part:
    """A bump whose furthest point along the knee's axis is the tip."""
    radius = _EPICONDYLE_M * w
    centre = tip - radius * outward
    inner = np.array([0.012 * w, knee[1] + 0.024 * w, 0.6 * centre[2]])
    return shapes.Part(shapes.make_rod(centre, inner, radius, 1.4 * radius), 4e-3)


def _place_beside(point: Array, by_mm: ArrayLike, w: float) -> Array:
    return point + shapes.place_at_mm(by_mm, w)


@dataclass(frozen=True, slots=True, eq=False)
class Places:
    """Where the malleoli stand out furthest and the fibula's head lies under the skin, shank's frame, m."""

    malleolus_lateral: Array
    malleolus_medial: Array
    fibula_head: Array


def build_tibia(
    shape: LegShape, length: float, condyles: tuple[Array, Array], places: Places
) -> tuple[shapes.Shape, shapes.Shape, dict[str, Array]]:
    """Solids of a right tibia and its fibula, and their landmarks, in the shank's frame, m.

    ``length`` (m): from knee to ankle centre. ``condyles`` (two (3,), m): centres of the femur's medial and
    lateral condyle with the knee straight. ``places``: the tips of the malleoli lie straight below their
    ends' middle.
    """
    w = shape.epicondylar_breadth / BREADTH_M
    ankle = np.array([0.0, -length, 0.0])
    end, head = MALLEOLUS_M * w, FIBULA_HEAD_M * w
    medial = np.add(places.malleolus_medial, [0.0, end, end])
    lateral = np.add(places.malleolus_lateral, [0.0, end, -end])
    upper = places.fibula_head - [0.0, 0.0, head]
    # Head, a thin shaft, and the lateral malleolus
    under, above = upper + shapes.place_at_mm((2, -32, -1), w), lateral + shapes.place_at_mm((1, 45, -3), w)
    middle = 0.5 * (under + above) + shapes.place_at_mm((-4, 0, 2), w)
    line = np.array([upper, under, middle, above, lateral + shapes.place_at_mm((0, 14, 0), w), lateral])
    fibula = shapes.make_chain(line, [head, 5.5e-3 * w, 6.0e-3 * w, 6.5e-3 * w, 9e-3 * w, end])
    bone = [
        shapes.Part(_build_column(shape, length, w)),
        shapes.Part(
            shapes.make_rod(
                shapes.place_at_mm((23, -58, 1), w), shapes.place_at_mm((17, -95, 1), w), 11e-3 * w, 8e-3 * w
            ),
            10e-3,
        ),
        *(
            shapes.Part(
                shapes.make_rod(
                    shapes.place_at_mm((2, -32, z), w), shapes.place_at_mm((1, -19, z), w), 7e-3 * w, 3e-3 * w
                ),
                5e-3,
            )
            for z in (-5.0, 6.0)
        ),
        shapes.Part(
            shapes.make_rod(ankle + shapes.place_at_mm((2, 30, -13), w), medial, 12e-3 * w, end), 5e-3
        ),
        *(
            shapes.Part(shapes.make_ball(centre, radius + JOINT_SPACE_M), 2e-3, "cut")
            for centre, radius in zip(condyles, shape.condyle_radii, strict=True)
        ),
        shapes.Part(shapes.grow_shape(fibula, _APART_M), 2e-3, "cut"),
    ]
    landmarks = {
        "MM": medial - [0.0, end, 0.0],
        "LM": lateral - [0.0, end, 0.0],
        "FH": np.add(upper, [0.0, head, 0.0]),
    }
    return shapes.join_parts(bone), fibula, landmarks


def _build_column(shape: LegShape, length: float, w: float) -> shapes.Shape:
    """From the plateau, three-sided in the shaft, to the ankle."""
    top = max(shape.condyle_radii) + JOINT_SPACE_M - 2e-3 * w  # the condyles' dishes are cut 2 mm deep
    upper = np.array([0.0, 10.0, 26.0, 45.0, 75.0]) * 1e-3 * w
    lower = np.array([0.0, 8.0, 22.0, 45.0, 90.0]) * 1e-3 * w
    low, high = _PLAFOND_M - length, -top
    middle = low + np.array([0.4, 0.62]) * (high - low)
    r, mm = 0.82 * shape.shaft_radius, 1e-3 * w
    unit = np.repeat([mm, r, mm], [3, 4, 5])  # the ends follow the knee's size, the shaft its own radius
    return shapes.make_shaft(
        heights=np.concatenate([low + lower, middle, (high - upper)[::-1]]),
        x=mm * np.array([0.0, 0.0, 0.0, 0.0, 1.0, 4.0, 6.0, 6.0, 3.0, 0.0, 0.0, 0.0]),
        z=mm * np.array([-3.0, -3.0, -2.0, -1.0, 0.0, 2.0, 2.0, 1.0, 0.0, 0.0, 0.0, 0.0]),
        half_x=np.array([19, 18, 15, 1.1, 1, 1.1, 1.3, 19, 22, 24, 26, 26]) * unit,
        half_z=np.array([21, 20, 16, 1.1, 1, 1, 1.1, 16, 23, 32, 38, 38]) * unit,
        ridge=0.08,
        rounding=6e-3,
    )
