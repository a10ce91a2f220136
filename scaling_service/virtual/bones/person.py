"""The bones of a virtual person: around true joint centres and knee axes, under the true markers.

A hip bone is described in the pelvis frame, the right half: origin half-way between the markers on the
anterior spines, x forward, y up, z to the right. Places on it are those of a hip bone whose hip centre lies
86.75 mm from the middle (Puchaud 2019, table 2), chosen after the proportions of an adult's; they grow with
the pelvis.
"""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.arrays import Array
from scaling_service.core.progress import show_nothing
from scaling_service.model.anatomy.lengths import find_joint_centres, measure_segment_lengths
from scaling_service.model.parameters import compute_axis
from scaling_service.virtual import subject
from scaling_service.virtual.bones import leg
from scaling_service.virtual.bones.shapes import (
    Part,
    Shape,
    contour_shape,
    join_parts,
    make_ball,
    make_chain,
    make_half_space,
    make_rod,
    place_at_mm,
    strip,
)

HALF_WIDTH_M = 0.08675  # of the generic model, for which places below are given
SPINE_M = 6e-3  # chosen: radius of the anterior spine's tip
POSTERIOR_SPINE_M = 8e-3  # chosen: radius of the posterior spine's tip

_CREST = ((-26, 24, 126), (-50, 43, 133), (-72, 53, 121), (-95, 56, 95), (-113, 50, 71), (-124, 32, 57))
_CREST_RADII = (6.0, 6.0, 7.0, 6.0, 5.0, 6.0, 7.0, 8.0)  # with both spines
_LOWER = ((-33, -38, 100), (-38, -44, 98), (-49, -47, 96), (-66, -46, 92), (-84, -40, 80), (-101, -28, 64))
_REAR = ((-112, -22, 55), (-119, -20, 50))  # towards the lower posterior spine
_WING_M = 3.5e-3  # chosen: half of the wing's thickness
_WALL_M = 7e-3  # chosen: bone behind the socket
_OPENING = (0.32, -0.58, 0.75)  # of the socket: 48 degrees out and 23 forward; chosen
_DEPTH = 0.2  # chosen: the rim lies this share of the radius beside the centre, inwards

STEP_M = 3e-3
"""Of the grids that bones are contoured on; chosen, meshes then have 15 to 40 thousand faces."""

MARKER_RADIUS_M = 7e-3
"""Puchaud 2019: markers of 14 mm."""

SKIN_M: abc.Mapping[str, float] = {"ASIS": 5e-3, "PSIS": 8e-3, "FH": 4e-3, "LM": 3e-3, "MM": 3e-3}
"""From bone to skin: chosen for lean persons, thinner than the 9.7 (7.0) and 19.6 (10.9) mm over anterior
and posterior spines in patients (Mantovani 2016). Over the epicondyles it is what their breadth leaves."""

_LEFT = np.array([1.0, 1.0, -1.0])

_SIDES: tuple[leg.Side, leg.Side] = ("r", "l")


def build_hip_bone(hip: Array, socket: float, asis: Array, psis: Array) -> tuple[Shape, dict[str, Array]]:
    """The solid of a right hip bone and its landmarks, in the pelvis frame, m.

    ``hip`` ((3,), m): the hip centre, in the middle of the socket. ``socket`` (m): its radius. ``asis``,
    ``psis`` ((3,), m): the foremost point of the anterior and the rearmost of the posterior spine.
    """
    w = float(hip[2]) / HALF_WIDTH_M
    forward = np.array([w, 0.0, 0.0])
    front, rear = asis - SPINE_M * forward, psis + POSTERIOR_SPINE_M * forward
    parts = [
        *_build_ilium(front, rear, w),
        *_build_ischium_and_pubis(w),
        *_build_socket(hip, socket, w),
        # What marks the spines stands on its own, so that no blend moves its tip.
        Part(make_ball(front, SPINE_M * w)),
        Part(make_ball(rear, POSTERIOR_SPINE_M * w)),
    ]
    return join_parts(parts), {"ASIS": asis, "PSIS": psis}


def _build_ilium(front: Array, rear: Array, w: float) -> list[Part]:
    """The wing between its crest and the bone above the socket, thick where it meets the sacrum."""
    crest = np.vstack([front, place_at_mm(_CREST, w), rear])
    lower = np.vstack([place_at_mm(_LOWER, w), place_at_mm(_REAR, w)])
    over_socket = place_at_mm(
        ((-32, -31, 104), (-35, -42, 101), (-41, -52, 96), (-57, -54, 90), (-76, -58, 82)), w
    )
    return [
        Part(make_chain(crest, [1e-3 * w * r for r in _CREST_RADII])),
        Part(strip(crest, lower, _WING_M * w), 4e-3),
        Part(make_chain(over_socket, [1e-3 * w * r for r in (5.0, 8.0, 12.0, 15.0, 13.0)]), 8e-3),
        Part(
            make_chain(place_at_mm((_LOWER[4], _LOWER[5], _REAR[1]), w), [11e-3 * w, 9e-3 * w, 7e-3 * w]),
            8e-3,
        ),
        Part(make_rod(place_at_mm((-114, -8, 48), w), place_at_mm((-106, 16, 53), w), 9e-3 * w), 8e-3),
    ]


def _build_ischium_and_pubis(w: float) -> list[Part]:
    """The ring around the obturator foramen, the spine above the lesser notch, the tubercle."""
    ischium = place_at_mm(((-72, -62, 84), (-72, -108, 76), (-68, -138, 58), (-54, -146, 46)), w)
    lower_ramus = place_at_mm(((-54, -146, 46), (-32, -136, 28), (-16, -122, 13)), w)
    upper_ramus = place_at_mm(((-34, -80, 74), (-22, -88, 50), (-14, -95, 24)), w)
    symphysis = place_at_mm(((-13, -98, 10.5), (-20, -124, 10.5)), w)
    spine = place_at_mm(((-78, -84, 74), (-96, -96, 58)), w)
    mm = 1e-3 * w
    return [
        Part(make_chain(ischium, [14 * mm, 12 * mm, 14 * mm, 11 * mm]), 8e-3),
        Part(make_chain(lower_ramus, [9 * mm, 5.5 * mm, 7 * mm]), 5e-3),
        Part(make_chain(upper_ramus, [10 * mm, 7.5 * mm, 8 * mm]), 6e-3),
        Part(make_rod(symphysis[0], symphysis[1], 8 * mm), 4e-3),
        Part(make_rod(spine[0], spine[1], 8 * mm, 3.5 * mm), 6e-3),
        Part(make_ball(place_at_mm((-11, -94, 22), w), 5.5 * mm), 3e-3),
    ]


def _build_socket(hip: Array, radius: float, w: float) -> list[Part]:
    """Bone around the head, opened to its side; only then the sphere itself, sharp-edged."""
    out = np.array(_OPENING) / np.linalg.norm(_OPENING)
    cup = join_parts(
        (
            Part(make_ball(hip, radius + _WALL_M * w)),
            Part(make_half_space(hip - _DEPTH * radius * out, out), 3e-3, "trim"),
        )
    )
    aside = radius * out
    inward = _normalise(np.array([0.1, -0.45, -0.85]))  # of the fossa, from the hip centre
    below = _normalise(np.array([0.35, -0.9, 0.0]))
    fossa = hip + 0.6 * radius * inward
    return [
        Part(cup, 7e-3),
        # Room for the neck, which passes over nothing but the rim.
        Part(make_rod(hip + 0.2 * aside, hip + 2.5 * aside, 0.97 * radius, 1.1 * radius), 2e-3, "cut"),
        Part(make_ball(fossa, 0.55 * radius), 2e-3, "cut"),
        Part(make_rod(fossa, fossa + 1.2 * radius * below, 0.38 * radius), 2e-3, "cut"),
        Part(make_ball(hip, radius), 2e-3, "cut"),
    ]


def _normalise(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector))


Faces = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class PersonBones:
    """Meshes and what is true of them, each in its segment's frame, m."""

    meshes: abc.Mapping[str, tuple[Array, Faces]]
    """``pelvis``, ``femur_r``, ``tibia_r`` (with the fibula as a second shell), ``femur_l``, ``tibia_l``
    to vertices (n, 3) and faces (m, 3), closed and facing outwards."""
    landmarks: abc.Mapping[str, tuple[str, Array]]
    """Points on bone by the name of the marker that is put on them, to (segment, position)."""


def make_virtual_bones(
    person: subject.VirtualSubject, *, progress: abc.Callable[[str], None] | None = None
) -> PersonBones:
    """Make the bones of a person.

    ``progress``: called with the name of each bone before its turn.

    The centres of the femoral heads and sockets are the model's hip centres; the midpoints of the spheres
    on the condyles its knee centres, the lines through them its knee axes; the midpoints of the malleoli's
    tips its ankle centres. The posterior condylar angle is therefore not drawn: it follows from axis and
    radii.
    """
    report = progress or show_nothing
    shapes = make_leg_shapes(person)
    meshes: dict[str, tuple[Array, Faces]] = {}
    landmarks: dict[str, tuple[str, Array]] = {}
    report("pelvis")
    # Both hip bones, mirror images of each other as the model's pelvis is
    hip = np.array(find_joint_centres(person.model)["hip_r"][1])
    socket = max(shape.head_radius for shape in shapes.values()) + leg.SOCKET_GAP_M
    asis = _find_skin_place(person, "RASIS") - [_measure_depth("ASIS"), 0.0, 0.0]
    psis = np.add(_find_skin_place(person, "RPSIS"), [_measure_depth("PSIS"), 0.0, 0.0])
    pelvis, spines = build_hip_bone(hip, socket, asis, psis)
    for name, at in spines.items():
        landmarks |= {f"R{name}": ("pelvis", at), f"L{name}": ("pelvis", at * _LEFT)}
    right = contour_shape(pelvis, STEP_M)
    meshes["pelvis"] = _join_surfaces(right, _of_side(right, "l"))
    for side in _SIDES:
        for bone, mesh in _build_leg(person, shapes[side], side, landmarks, report):
            meshes[f"{bone}_{side}"] = mesh
    return PersonBones(meshes, landmarks)


def make_leg_shapes(person: subject.VirtualSubject) -> dict[leg.Side, leg.LegShape]:
    """Sizes and angles of a person's bones, those of long bones larger; drawn, nothing is made."""
    mean, sd = subject.read_stature_spread(person.sex)
    lengths = measure_segment_lengths(person.model)
    own = 0.5 * (lengths["femur_r"] + lengths["femur_l"])
    usual = float(np.hypot(subject.FEMUR[0] * sd, subject.FEMUR[1]))
    length = (own - subject.FEMUR[0] * mean) / usual
    return {side: leg.make_leg_shape(person.seed, side, person.sex, length) for side in _SIDES}


def _build_leg(
    person: subject.VirtualSubject,
    shape: leg.LegShape,
    side: leg.Side,
    landmarks: dict[str, tuple[str, Array]],
    report: abc.Callable[[str], None],
) -> abc.Iterator[tuple[str, tuple[Array, Faces]]]:
    """Femur and tibia, built as a right leg's."""
    lengths, letter = measure_segment_lengths(person.model), side.upper()
    sign = 1.0 if side == "r" else -1.0
    x, y = person.tilts[f"knee_{side}"]
    axis = compute_axis((sign * x, sign * y))
    thigh, condyles, on_thigh = leg.build_femur(shape, lengths[f"femur_{side}"], axis)
    knee = np.array([0.0, lengths[f"femur_{side}"], 0.0])
    medial, lateral = (centre + knee for centre in condyles)
    # Under the skin of malleoli and fibula's head, as of a right leg
    outward = np.array([0.0, 0.0, 1.0])
    worn = [_find_skin_place(person, f"{letter}{name}") for name in ("LM", "MM", "FH")]
    outer, inner, head = worn if side == "r" else (at * _LEFT for at in worn)
    places = leg.Places(
        outer - _measure_depth("LM") * outward,
        inner + _measure_depth("MM") * outward,
        head - _measure_depth("FH") * outward,
    )
    tibia, fibula, on_shank = leg.build_tibia(shape, lengths[f"shank_{side}"], (medial, lateral), places)
    for segment, found in ((f"femur_{side}", on_thigh), (f"tibia_{side}", on_shank)):
        landmarks |= {
            f"{letter}{name}": (segment, at if side == "r" else at * _LEFT) for name, at in found.items()
        }
    report(f"femur_{side}")
    yield "femur", _of_side(contour_shape(thigh, STEP_M), side)
    report(f"tibia_{side}")
    both = _join_surfaces(contour_shape(tibia, STEP_M), contour_shape(fibula, STEP_M))
    yield "tibia", _of_side(both, side)


def _find_skin_place(person: subject.VirtualSubject, marker: str) -> Array:
    """Where a marker belongs in its segment's frame: the person's without its misplacement."""
    place = person.generic.marker(marker)
    return person.factors[place.segment] * np.array(place.nominal)


def _measure_depth(name: str) -> float:
    """From a marker's centre to bone, m."""
    return SKIN_M[name] + MARKER_RADIUS_M


def _of_side(mesh: tuple[Array, Faces], side: leg.Side) -> tuple[Array, Faces]:
    """A right bone's surface, mirrored for the left side."""
    return mesh if side == "r" else (mesh[0] * _LEFT, mesh[1][:, ::-1])


def _join_surfaces(first: tuple[Array, Faces], second: tuple[Array, Faces]) -> tuple[Array, Faces]:
    return np.vstack([first[0], second[0]]), np.vstack([first[1], second[1] + len(first[0])])
