"""The bones of a virtual person: around true joint centres and knee axes, under the true markers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.progress import silent
from scaling_service.model.anatomy.lengths import joint_centres, segment_lengths
from scaling_service.model.parameters import axis_of
from scaling_service.virtual.bones.leg import SOCKET_GAP_M, LegShape, Places, Side, femur, leg_shape, tibia
from scaling_service.virtual.bones.pelvis import hip_bone
from scaling_service.virtual.bones.shapes import Array, surface_of
from scaling_service.virtual.subject import FEMUR, VirtualSubject, stature_spread

Faces = NDArray[np.intp]

STEP_M = 3e-3
"""Of the grids that bones are contoured on; chosen, meshes then have 15 to 40 thousand faces."""

MARKER_RADIUS_M = 7e-3
"""Puchaud 2019: markers of 14 mm."""

SKIN_M: Mapping[str, float] = {"ASIS": 5e-3, "PSIS": 8e-3, "FH": 4e-3, "LM": 3e-3, "MM": 3e-3}
"""From bone to skin: chosen for lean persons, thinner than the 9.7 (7.0) and 19.6 (10.9) mm over anterior
and posterior spines in patients (Mantovani 2016). Over the epicondyles it is what their breadth leaves."""

_LEFT = np.array([1.0, 1.0, -1.0])


@dataclass(frozen=True, slots=True, eq=False)
class PersonBones:
    """Meshes and what is true of them, each in its segment's frame, m."""

    meshes: Mapping[str, tuple[Array, Faces]]
    """``pelvis``, ``femur_r``, ``tibia_r`` (with the fibula as a second shell), ``femur_l``, ``tibia_l``
    to vertices (n, 3) and faces (m, 3), closed and facing outwards."""
    landmarks: Mapping[str, tuple[str, Array]]
    """Points on bone by the name of the marker that is put on them, to (segment, position)."""


def virtual_bones(person: VirtualSubject, *, progress: Callable[[str], None] | None = None) -> PersonBones:
    """Make the bones of a person.

    ``progress``: called with the name of each bone before its turn.

    The centres of the femoral heads and sockets are the model's hip centres; the midpoints of the spheres
    on the condyles its knee centres, the lines through them its knee axes; the midpoints of the malleoli's
    tips its ankle centres. The posterior condylar angle is therefore not drawn: it follows from axis and
    radii.
    """
    report = progress or silent
    shapes = leg_shapes(person)
    meshes: dict[str, tuple[Array, Faces]] = {}
    landmarks: dict[str, tuple[str, Array]] = {}
    report("pelvis")
    meshes["pelvis"] = _pelvis(person, shapes, landmarks)
    for side in _SIDES:
        for bone, mesh in _leg(person, shapes[side], side, landmarks, report):
            meshes[f"{bone}_{side}"] = mesh
    return PersonBones(meshes, landmarks)


_SIDES: tuple[Side, Side] = ("r", "l")


def leg_shapes(person: VirtualSubject) -> dict[Side, LegShape]:
    """Sizes and angles of a person's bones, those of long bones larger; drawn, nothing is made."""
    mean, sd = stature_spread(person.sex)
    lengths = segment_lengths(person.model)
    own = 0.5 * (lengths["femur_r"] + lengths["femur_l"])
    usual = float(np.hypot(FEMUR[0] * sd, FEMUR[1]))
    length = (own - FEMUR[0] * mean) / usual
    return {side: leg_shape(person.seed, side, person.sex, length) for side in _SIDES}


def _pelvis(
    person: VirtualSubject, shapes: Mapping[Side, LegShape], landmarks: dict[str, tuple[str, Array]]
) -> tuple[Array, Faces]:
    """Both hip bones, mirror images of each other as the model's pelvis is."""
    hip = np.array(joint_centres(person.model)["hip_r"][1])
    socket = max(shape.head_radius for shape in shapes.values()) + SOCKET_GAP_M
    asis = _skin(person, "RASIS") - [_depth("ASIS"), 0.0, 0.0]
    psis = np.add(_skin(person, "RPSIS"), [_depth("PSIS"), 0.0, 0.0])
    bone = hip_bone(hip, socket, asis, psis)
    for name, at in bone.landmarks.items():
        landmarks |= {f"R{name}": ("pelvis", at), f"L{name}": ("pelvis", at * _LEFT)}
    right = surface_of(bone.solid, STEP_M)
    return _joined(right, _of_side(right, "l"))


def _leg(
    person: VirtualSubject,
    shape: LegShape,
    side: Side,
    landmarks: dict[str, tuple[str, Array]],
    report: Callable[[str], None],
) -> Iterator[tuple[str, tuple[Array, Faces]]]:
    """Femur and tibia, built as a right leg's."""
    lengths, letter = segment_lengths(person.model), side.upper()
    sign = 1.0 if side == "r" else -1.0
    x, y = person.tilts[f"knee_{side}"]
    axis = axis_of((sign * x, sign * y))
    thigh = femur(shape, lengths[f"femur_{side}"], axis)
    knee = np.array([0.0, lengths[f"femur_{side}"], 0.0])
    medial, lateral = (centre + knee for centre in thigh.condyles)
    shank = tibia(shape, lengths[f"shank_{side}"], (medial, lateral), _places(person, side))
    for segment, found in ((f"femur_{side}", thigh.landmarks), (f"tibia_{side}", shank.landmarks)):
        landmarks |= {
            f"{letter}{name}": (segment, at if side == "r" else at * _LEFT) for name, at in found.items()
        }
    report(f"femur_{side}")
    yield "femur", _of_side(surface_of(thigh.solid, STEP_M), side)
    report(f"tibia_{side}")
    both = _joined(surface_of(shank.tibia, STEP_M), surface_of(shank.fibula, STEP_M))
    yield "tibia", _of_side(both, side)


def _places(person: VirtualSubject, side: Side) -> Places:
    """Under the skin of malleoli and fibula's head, as of a right leg."""
    outward = np.array([0.0, 0.0, 1.0])
    lateral, medial, head = (_right(person, side, name) for name in ("LM", "MM", "FH"))
    return Places(
        lateral - _depth("LM") * outward, medial + _depth("MM") * outward, head - _depth("FH") * outward
    )


def _right(person: VirtualSubject, side: Side, name: str) -> Array:
    at = _skin(person, f"{side.upper()}{name}")
    return at if side == "r" else at * _LEFT


def _skin(person: VirtualSubject, marker: str) -> Array:
    """Where a marker belongs in its segment's frame: the person's without its misplacement."""
    place = person.generic.marker(marker)
    return person.factors[place.segment] * np.array(place.nominal)


def _depth(name: str) -> float:
    """From a marker's centre to bone, m."""
    return SKIN_M[name] + MARKER_RADIUS_M


def _of_side(mesh: tuple[Array, Faces], side: Side) -> tuple[Array, Faces]:
    """A right bone's surface, mirrored for the left side."""
    return mesh if side == "r" else (mesh[0] * _LEFT, mesh[1][:, ::-1])


def _joined(first: tuple[Array, Faces], second: tuple[Array, Faces]) -> tuple[Array, Faces]:
    return np.vstack([first[0], second[0]]), np.vstack([first[1], second[1] + len(first[0])])
