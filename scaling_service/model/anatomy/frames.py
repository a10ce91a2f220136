"""Anatomical frames from landmarks, joint angles between them, and the angles of gait laboratories.

x points forward, y up and z to the subject's right on both sides of the body (Wu et al. 2002,
J Biomech 35:543). A frame is NaN where one of its landmarks is missing or three of them lie on a line.

The conventional gait model (Kadaba et al. 1990, J Orthop Res 8:383; Davis et al. 1991, Hum Mov Sci 10:575),
with the pelvis' angles in Baker's order (2001, Gait Posture 13:1) and the foot as Vicon's Plug-in Gait has
it. The frontal plane of a thigh or shank is that of its two joint centres and the lateral marker of its
distal joint. The foot is a line, from the heel to the second metatarsal's head.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from scaling_service.core.arrays import Array

Side = Literal["r", "l"]
SIDES: tuple[Side, ...] = ("r", "l")

_MIN_LENGTH = 1e-6  # m; chosen: landmarks closer than a thousandth of a millimetre give no direction

PELVIS: Final = ("pelvis_anterior_tilt", "pelvis_obliquity_up", "pelvis_internal_rotation")
HIP: Final = ("hip_flexion", "hip_adduction", "hip_internal_rotation")
KNEE: Final = ("knee_flexion", "knee_adduction", "knee_internal_rotation")
ANKLE: Final = ("ankle_dorsiflexion", "ankle_internal_rotation")
FOOT: Final = ("foot_internal_progression",)
ANGLES: Final = PELVIS + HIP + KNEE + ANKLE + FOOT
"""All angles of one side. Anterior tilt, own side up, own side forward, flexion, adduction (of the knee:
varus), inward rotation, dorsiflexion, toes inward are positive."""

WAYS: Final[Mapping[str, tuple[str, str, str]]] = {
    "pelvis_anterior_tilt": ("pelvic tilt", "back", "front"),
    "pelvis_obliquity_up": ("pelvic obliquity", "down", "up"),
    "pelvis_internal_rotation": ("pelvic rotation", "back", "forward"),
    "hip_flexion": ("hip flexion", "extension", "flexion"),
    "hip_adduction": ("hip adduction", "abduction", "adduction"),
    "hip_internal_rotation": ("hip rotation", "out", "in"),
    "knee_flexion": ("knee flexion", "extension", "flexion"),
    "knee_adduction": ("knee adduction", "valgus", "varus"),
    "knee_internal_rotation": ("knee rotation", "out", "in"),
    "ankle_dorsiflexion": ("ankle dorsiflexion", "plantar", "dorsal"),
    "foot_internal_progression": ("foot progression", "out", "in"),
}
"""Angle to its name, and what its negative and positive values mean."""


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """One anatomical frame over time."""

    rotation: Array  # (n_frames, 3, 3): maps the anatomical frame to ground; columns are its x, y, z axes
    origin: Array  # (n_frames, 3), m

    def to_ground(self, points: ArrayLike) -> Array:
        """Points of this frame, (n_frames, 3) or (3,), in ground, (n_frames, 3), m."""
        local = np.broadcast_to(np.asarray(points, dtype=float), self.origin.shape)
        return np.asarray(self.origin + np.einsum("nij,nj->ni", self.rotation, local))

    def to_local(self, points: ArrayLike) -> Array:
        """Points of ground, (n_frames, 3) or (3,), in this frame, (n_frames, 3), m."""
        from_origin = np.asarray(points, dtype=float) - self.origin
        return np.asarray(np.einsum("nji,nj->ni", self.rotation, from_origin))


def build_pelvis_frame(rasis: ArrayLike, lasis: ArrayLike, rpsis: ArrayLike, lpsis: ArrayLike) -> Frames:
    """The pelvis frame with its origin half-way between the ASIS.

    z runs from the left to the right ASIS, y is normal to the plane of both ASIS and the midpoint of the
    PSIS, upward (Wu 2002, with another origin: hip regressions start from here).

    ``rasis``, ``lasis``, ``rpsis``, ``lpsis``: (n_frames, 3), m.
    """
    right, left = _gather_points(rasis), _gather_points(lasis)
    back = (_gather_points(rpsis) + _gather_points(lpsis)) / 2.0
    z = _normalise(right - left)
    y = _normalise(np.cross(right - back, left - back))
    return _assemble_frames(np.cross(y, z), y, z, (right + left) / 2.0)


def build_femur_frame(hip: ArrayLike, lateral: ArrayLike, medial: ArrayLike, side: Side) -> Frames:
    """The thigh's frame, origin at the hip centre (Wu 2002).

    y points from the midpoint of the epicondyles to the hip centre, z lies in the plane of the three.

    ``hip``, ``lateral``, ``medial`` ((n_frames, 3), m): hip centre and the epicondyles.
    """
    centre = _gather_points(hip)
    y = _normalise(centre - (_gather_points(lateral) + _gather_points(medial)) / 2.0)
    return _build_long_axis_frame(y, _find_rightward(lateral, medial, side), centre)


def build_tibia_frame(
    knee: ArrayLike, ankle: ArrayLike, lateral: ArrayLike, medial: ArrayLike, side: Side
) -> Frames:
    """The shank's frame about its mechanical axis, origin at the knee centre.

    y points from ankle to knee centre, x is normal to the plane of the knee centre and the malleoli,
    forward (Dumas 2007, J Biomech 40:543). With tibial torsion it is turned outward against the thigh's.

    ``knee``, ``ankle``, ``lateral``, ``medial`` ((n_frames, 3), m): knee and ankle centres and the malleoli.
    """
    centre = _gather_points(knee)
    return _build_long_axis_frame(
        _normalise(centre - _gather_points(ankle)), _find_rightward(lateral, medial, side), centre
    )


def decompose_cardan(proximal: Frames, distal: Frames) -> Array:
    """Turns about z, x and y, in this order, that lead from the proximal to the distal frame.

    The joint coordinate system of Grood and Suntay (1983) in its Cardan form (Wu 2002).

    Returns (n_frames, 3), rad: of ``R = Rz(a) Rx(b) Ry(c)``: a, b, c with b within a right angle.
    """
    r = np.einsum("nji,njk->nik", proximal.rotation, distal.rotation)
    first = np.arctan2(-r[:, 0, 1], r[:, 1, 1])
    second = np.arcsin(np.clip(r[:, 2, 1], -1.0, 1.0))
    third = np.arctan2(-r[:, 2, 0], r[:, 2, 2])
    return np.column_stack([first, second, third])


def compute_hip_angles(pelvis: Frames, femur: Frames, side: Side) -> Array:
    """Flexion, adduction and internal rotation of a hip, (n_frames, 3), rad."""
    return np.asarray(decompose_cardan(pelvis, femur) * _sign_clinically(1.0, side))


def compute_knee_angles(femur: Frames, tibia: Frames, side: Side) -> Array:
    """Flexion, adduction and internal rotation of a knee, (n_frames, 3), rad."""
    return np.asarray(decompose_cardan(femur, tibia) * _sign_clinically(-1.0, side))


def compute_pelvis_angles(pelvis: Frames) -> Array:
    """Rotation (to the left +), list (right side down +) and tilt (backward +), (n_frames, 3), rad.

    Of ``R = Ry Rx Rz``, the order of the built-in models' root (Baker 2001, Gait Posture 13:1).
    """
    r = pelvis.rotation
    rotation = np.arctan2(r[:, 0, 2], r[:, 2, 2])
    obliquity = np.arcsin(np.clip(-r[:, 1, 2], -1.0, 1.0))
    tilt = np.arctan2(r[:, 1, 0], r[:, 1, 1])
    return np.column_stack([rotation, obliquity, tilt])


def _sign_clinically(flexion: float, side: Side) -> Array:
    outward = 1.0 if side == "r" else -1.0
    return np.array([flexion, outward, outward])


def _gather_points(points: ArrayLike) -> Array:
    return np.atleast_2d(np.asarray(points, dtype=float))


def _find_rightward(lateral: ArrayLike, medial: ArrayLike, side: Side) -> Array:
    outward = _gather_points(lateral) - _gather_points(medial)
    return outward if side == "r" else -outward


def _build_long_axis_frame(y: Array, rightward: Array, origin: Array) -> Frames:
    x = _normalise(np.cross(y, rightward))
    return _assemble_frames(x, y, np.cross(x, y), origin)


def _assemble_frames(x: Array, y: Array, z: Array, origin: Array) -> Frames:
    """Assemble the axes; where any of them is unknown, so is the origin."""
    rotation = np.stack(np.broadcast_arrays(x, y, z), axis=2)
    usable = np.isfinite(rotation).all(axis=(1, 2)) & np.isfinite(origin).all(axis=1)
    return Frames(
        np.where(usable[:, None, None], rotation, np.nan), np.where(usable[:, None], origin, np.nan)
    )


def _normalise(vectors: Array) -> Array:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.where(length > _MIN_LENGTH, length, np.nan))


Points = Mapping[str, Array]
"""Landmark to its trajectory, (n_frames, 3), m, x and z level, y up; NaN where it is not known.

``RASIS LASIS RPSIS LPSIS`` or ``SACR``; with R or L before them ``HJC KJC AJC`` (centres of hip, knee,
ankle), ``LFE`` (lateral epicondyle, the knee marker), ``LM`` (lateral malleolus, the ankle marker), ``HEE``
and ``TOE`` (heel and second metatarsal's head, at equal heights over a flat sole), and ``KAX``: a point
beside the ankle centre that spans with ankle and knee centre the plane of the knee's axis, where the shank is
twisted against its ankle. Without it the malleolus does, as in a laboratory that leaves tibial torsion out.
"""


def compute_conventional_angles(points: Points, side: Side, heading: ArrayLike = 0.0) -> dict[str, Array]:
    """The conventional angles of one side, as far as the landmarks tell them.

    ``points``: see :data:`Points`. ``heading`` (float or (n_frames,), rad): where the person walks: turn
    about y that leads from x to this direction. Returns those of :data:`ANGLES` that can be computed to
    (n_frames,), rad; NaN where a landmark is hidden. Pelvis rotation and foot progression lie within half a
    turn of the heading.
    """
    letter, found = side.upper(), dict[str, Array]()
    back = ("RPSIS", "LPSIS") if "RPSIS" in points and "LPSIS" in points else ("SACR", "SACR")
    names = ("RASIS", "LASIS", *back)
    pelvis = (
        build_pelvis_frame(*(points[name] for name in names))
        if all(name in points for name in names)
        else None
    )
    thigh = None
    if all(f"{letter}{name}" in points for name in ("HJC", "KJC", "LFE")):
        hip, knee, lateral = (np.atleast_2d(points[f"{letter}{name}"]) for name in ("HJC", "KJC", "LFE"))
        thigh = build_femur_frame(hip, lateral, 2.0 * knee - lateral, side)
    shank_at_ankle = _build_shank(points, letter, side, "LM")
    shank = _build_shank(points, letter, side, "KAX") or shank_at_ankle
    # From heel to toe, (n_frames, 3)
    heel, toe = f"{letter}HEE", f"{letter}TOE"
    if heel not in points or toe not in points:
        foot = None
    else:
        foot = np.asarray(np.atleast_2d(points[toe]) - np.atleast_2d(points[heel]))
    if pelvis is not None:
        rotation, right_down, backward = compute_pelvis_angles(pelvis).T
        own = 1.0 if side == "r" else -1.0
        found |= zip(
            PELVIS,
            np.column_stack(
                [-backward, -own * right_down, own * _wrap_half_turn(rotation - np.asarray(heading))]
            ).T,
            strict=True,
        )
    if pelvis is not None and thigh is not None:
        found |= zip(HIP, compute_hip_angles(pelvis, thigh, side).T, strict=True)
    if thigh is not None and shank is not None:
        found |= zip(KNEE, compute_knee_angles(thigh, shank, side).T, strict=True)
    if foot is not None and shank_at_ankle is not None:
        # Dorsiflexion, and inward rotation after it, of a foot that is a line
        forward, up, right = np.einsum("nji,nj->in", shank_at_ankle.rotation, foot)
        turned = np.arctan2(right, np.hypot(forward, up))
        found |= zip(ANKLE, (np.arctan2(up, forward), -turned if side == "r" else turned), strict=True)
    if foot is not None:
        inward = 1.0 if side == "r" else -1.0
        found[FOOT[0]] = inward * _wrap_half_turn(np.arctan2(-foot[:, 2], foot[:, 0]) - np.asarray(heading))
    return found


def level_heel(points: Points, side: Side) -> Array:
    """The heel raised or lowered to the toe's height, as a person stands with flat feet, (n_frames, 3), m."""
    heel, toe = (np.atleast_2d(points[f"{side.upper()}{name}"]) for name in ("HEE", "TOE"))
    return np.column_stack([heel[:, 0], toe[:, 1], heel[:, 2]])


def _build_shank(points: Points, letter: str, side: Side, lateral: str) -> Frames | None:
    names = [f"{letter}{name}" for name in ("KJC", "AJC", lateral)]
    if not all(name in points for name in names):
        return None
    knee, ankle, beside = (np.atleast_2d(points[name]) for name in names)
    return build_tibia_frame(knee, ankle, beside, ankle, side)


def _wrap_half_turn(angle: ArrayLike) -> Array:
    """The same direction within half a turn of zero, rad."""
    return np.asarray(np.arctan2(np.sin(angle), np.cos(angle)))
