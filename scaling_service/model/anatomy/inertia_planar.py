"""Inertial tables on the planar squat: both sides lumped, trunk and head in one.

The parts are taken from the whole-body model with the same table, put together as in the neutral posture,
and brought to the squat's own lengths.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.core.errors import InputError
from scaling_service.model.anatomy import inertia
from scaling_service.model.body import BodyModel, Segment
from scaling_service.model.builtin import load_builtin
from scaling_service.model.inertia import Sex, gather_inertias, sum_mass, take_six, with_inertias
from scaling_service.numerics.multibody.motion import Inertias

WHOLE, SQUAT = "full_body_35dof", "squat_4dof"

LUMPED = "winter2009"
"""The table that gives trunk, head and neck together and the whole arm: the built-in squat is made of it."""


Part = tuple[tuple[str, ...], tuple[str, str], tuple[str, str]]
"""A planar segment: what it is made of, and one line that both models show: where it begins and ends on the
right of the whole body, and on the squat, by segments (their origins) or markers."""

PARTS: Mapping[str, Part] = {
    "foot": (("calcn_r", "calcn_l"), ("calcn_r", "RTOE"), ("shank", "TOE")),
    "shank": (("tibia_r", "tibia_l"), ("calcn_r", "tibia_r"), ("shank", "thigh")),
    "thigh": (("femur_r", "femur_l"), ("tibia_r", "femur_r"), ("thigh", "torso")),
    "torso": (("pelvis", "abdomen", "torso", "head"), ("femur_r", "humerus_r"), ("torso", "arm")),
    "arm": (
        ("humerus_r", "humerus_l", "ulna_r", "ulna_l", "hand_r", "hand_l"),
        ("humerus_r", "RELB"),
        ("arm", "ELB"),
    ),
}
"""The squat's segments; the arm hangs straight."""


def apply_to_squat(
    model: BodyModel, table: str, *, sex: Sex | None, height_m: float, mass_kg: float
) -> inertia.InertiaResult:
    """Give the planar squat the inertia that a table says.

    ``model``: ``squat_4dof`` of any size. ``table``, ``sex``, ``height_m``, ``mass_kg``: see
    ``apply_inertia_table``. Masses sum to ``mass_kg``; centres of mass lie in the plane and products
    with z are zero. InputError: the model is no squat, or as ``apply_inertia_table``.
    """
    if set(model.segment_names) != set(PARTS):
        raise InputError(
            f"model '{model.name}' is not the planar squat",
            field="model",
            remedy=f"Its segments are {', '.join(PARTS)}",
        )
    whole = inertia.apply_inertia_table(
        load_builtin(WHOLE), table, sex=sex, height_m=height_m, mass_kg=mass_kg
    )
    own = table == LUMPED
    body, parts = inertia.Neutral.of(whole.model), PARTS
    if own:  # the built-in squat holds the rows that Winter gives for trunk and head and the whole arm
        squat = load_builtin(SQUAT)
        factor, inertias = mass_kg / sum_mass(squat), gather_inertias(squat)
        heavier = Inertias(factor * inertias.mass, inertias.com, factor * inertias.tensor)
        body = inertia.Neutral.of(with_inertias(squat, heavier))
        parts = {name: ((name,), line, line) for name, (_, _, line) in PARTS.items()}
    notes = whole.notes[:1] if own else whole.notes
    planar = inertia.Neutral.of(model)
    segments = tuple(_lump_segments(s, parts[s.name], body, planar) for s in model.segments)
    said = "both sides are lumped; trunk and head are one, the arm hangs straight"
    return inertia.InertiaResult(replace(model, segments=segments), table, (*notes, said))


def _lump_segments(segment: Segment, part: Part, body: inertia.Neutral, planar: inertia.Neutral) -> Segment:
    pieces, whole, line = part
    start, end = (_place(body, name) for name in whole)
    new_start, new_end = (_place(planar, name) for name in line)
    size = _measure_flat_length(new_end - new_start) / _measure_flat_length(end - start)
    # Rotation about z that brings one direction onto another
    old = end - start
    new = new_end - new_start
    angle = np.arctan2(new[1], new[0]) - np.arctan2(old[1], old[0])
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    mass, com, tensor = _sum_inertias(body, pieces)
    at = new_start + size * turn @ (com - start)
    local = planar.local(segment.name, at)
    spread = size**2 * turn @ tensor @ turn.T
    spread[2, :2] = spread[:2, 2] = 0.0  # left and right cancel; what asymmetry a table has is dropped
    return replace(segment, mass=mass, com=(float(local[0]), float(local[1]), 0.0), inertia=take_six(spread))


def _place(neutral: inertia.Neutral, name: str) -> Array:
    found = neutral.origin(name)
    found = neutral.marker(name) if found is None else found
    if found is None:
        raise InputError(
            f"model '{neutral.model.name}' has neither segment nor marker '{name}'",
            field="model",
            remedy="Keep the built-in model's names",
        )
    return found


def _measure_flat_length(vector: Array) -> float:
    return float(np.hypot(vector[0], vector[1]))


def _sum_inertias(neutral: inertia.Neutral, pieces: tuple[str, ...]) -> tuple[float, Array, Array]:
    """Mass, centre of mass and tensor about it of rigidly joined segments, ground axes."""
    rows = [neutral.model.segment_names.index(name) for name in pieces]
    axes, origins = map(np.array, zip(*(neutral.frames[name] for name in pieces), strict=True))
    inertias = gather_inertias(neutral.model)
    mass = inertias.mass[rows]
    at = np.einsum("kai,ki->ka", axes, inertias.com[rows]) + origins
    own = np.einsum("kai,kij,kbj->ab", axes, inertias.tensor[rows], axes)
    com = mass @ at / mass.sum()
    arm = at - com
    scatter = np.einsum("k,ka,kb->ab", mass, arm, arm)
    return float(mass.sum()), com, own + np.trace(scatter) * np.eye(3) - scatter
