"""A tibia and a fibula between the knee centre and the ankle centre of a person.

Everything is in the shank's frame of a right leg: origin at the knee centre, x forward, y up from the
ankle to the knee centre, z to the right. The malleoli stand under the places of the skin markers, so that the
midpoint of their tips is the ankle centre.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from scaling_service.virtual.bones.femur import BREADTH_M
from scaling_service.virtual.bones.proportions import LegShape
from scaling_service.virtual.bones.shapes import Array, Grown, Part, Shaft, Shape, Solid, ball, chain, rod

JOINT_SPACE_M = 4.5e-3  # chosen: both cartilages, about 2 mm each (J Orthop Surg 2016;24, posterior condyles)
MALLEOLUS_M = 8e-3  # chosen: radius of a malleolus' end
FIBULA_HEAD_M = 9.5e-3  # chosen: radius of the fibula's head
_APART_M = 2.5e-3  # chosen: least gap between tibia and fibula
_PLAFOND_M = 0.018  # chosen: the tibia's end over the ankle centre, about the radius of the talus


@dataclass(frozen=True, slots=True, eq=False)
class Places:
    """Where the malleoli stand out furthest and the fibula's head lies under the skin, shank's frame, m."""

    malleolus_lateral: Array
    malleolus_medial: Array
    fibula_head: Array


@dataclass(frozen=True, slots=True, eq=False)
class Tibia:
    """Solids of tibia and fibula, and their landmarks, in the shank's frame of a right leg, m."""

    tibia: Shape
    fibula: Shape
    landmarks: dict[str, Array]


def tibia(shape: LegShape, length: float, condyles: tuple[Array, Array], places: Places) -> Tibia:
    """Build a right tibia with its fibula.

    Parameters
    ----------
    length : float, m
        From knee to ankle centre.
    condyles : two (3,), m
        Centres of the femur's medial and lateral condyle with the knee straight.
    places : Places
        The tips of the malleoli lie straight below their ends' middle.
    """
    w = shape.epicondylar_breadth / BREADTH_M
    ankle = np.array([0.0, -length, 0.0])
    end, head = MALLEOLUS_M * w, FIBULA_HEAD_M * w
    medial = np.add(places.malleolus_medial, [0.0, end, end])
    lateral = np.add(places.malleolus_lateral, [0.0, end, -end])
    upper = places.fibula_head - [0.0, 0.0, head]
    fibula = _fibula(upper, lateral, head, end, w)
    bone = [
        Part(_column(shape, length, w)),
        Part(rod(_mm((23, -58, 1), w), _mm((17, -95, 1), w), 11e-3 * w, 8e-3 * w), 10e-3),
        *(Part(rod(_mm((2, -32, z), w), _mm((1, -19, z), w), 7e-3 * w, 3e-3 * w), 5e-3) for z in (-5.0, 6.0)),
        Part(rod(ankle + _mm((2, 30, -13), w), medial, 12e-3 * w, end), 5e-3),
        *(
            Part(ball(centre, radius + JOINT_SPACE_M), 2e-3, "cut")
            for centre, radius in zip(condyles, shape.condyle_radii, strict=True)
        ),
        Part(Grown(fibula, _APART_M), 2e-3, "cut"),
    ]
    landmarks = {
        "MM": medial - [0.0, end, 0.0],
        "LM": lateral - [0.0, end, 0.0],
        "FH": np.add(upper, [0.0, head, 0.0]),
    }
    return Tibia(Solid(tuple(bone)), fibula, landmarks)


def _column(shape: LegShape, length: float, w: float) -> Shaft:
    """From the plateau, three-sided in the shaft, to the ankle."""
    top = max(shape.condyle_radii) + JOINT_SPACE_M - 2e-3 * w  # the condyles' dishes are cut 2 mm deep
    upper = np.array([0.0, 10.0, 26.0, 45.0, 75.0]) * 1e-3 * w
    lower = np.array([0.0, 8.0, 22.0, 45.0, 90.0]) * 1e-3 * w
    low, high = _PLAFOND_M - length, -top
    middle = low + np.array([0.4, 0.62]) * (high - low)
    r, mm = 0.82 * shape.shaft_radius, 1e-3 * w
    return Shaft(
        heights=np.concatenate([low + lower, middle, (high - upper)[::-1]]),
        x=mm * np.array([0.0, 0.0, 0.0, 0.0, 1.0, 4.0, 6.0, 6.0, 3.0, 0.0, 0.0, 0.0]),
        z=mm * np.array([-3.0, -3.0, -2.0, -1.0, 0.0, 2.0, 2.0, 1.0, 0.0, 0.0, 0.0, 0.0]),
        half_x=np.array(
            [
                19 * mm,
                18 * mm,
                15 * mm,
                1.1 * r,
                r,
                1.1 * r,
                1.3 * r,
                19 * mm,
                22 * mm,
                24 * mm,
                26 * mm,
                26 * mm,
            ]
        ),
        half_z=np.array(
            [21 * mm, 20 * mm, 16 * mm, 1.1 * r, r, r, 1.1 * r, 16 * mm, 23 * mm, 32 * mm, 38 * mm, 38 * mm]
        ),
        ridge=0.08,
        rounding=6e-3,
    )


def _fibula(upper: Array, lateral: Array, head: float, end: float, w: float) -> Solid:
    """Head, a thin shaft, and the lateral malleolus."""
    under, above = upper + _mm((2, -32, -1), w), lateral + _mm((1, 45, -3), w)
    middle = 0.5 * (under + above) + _mm((-4, 0, 2), w)
    line = np.array([upper, under, middle, above, lateral + _mm((0, 14, 0), w), lateral])
    return chain(line, [head, 5.5e-3 * w, 6.0e-3 * w, 6.5e-3 * w, 9e-3 * w, end])


def _mm(at: ArrayLike, w: float) -> Array:
    return 1e-3 * w * np.asarray(at, dtype=float)
