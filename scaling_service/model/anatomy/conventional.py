"""Joint angles as gait laboratories define them, from joint centres and landmarks.

The conventional gait model (Kadaba et al. 1990, J Orthop Res 8:383; Davis et al. 1991, Hum Mov Sci 10:575),
with the pelvis' angles in Baker's order (2001, Gait Posture 13:1) and the foot as Vicon's Plug-in Gait has
it. The frontal plane of a thigh or shank is that of its two joint centres and the lateral marker of its
distal joint. The foot is a line, from the heel to the second metatarsal's head.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scaling_service.model.anatomy.frames import (
    Frames,
    Side,
    femur_frame,
    hip_angles,
    knee_angles,
    pelvis_angles,
    pelvis_frame,
    tibia_frame,
)

Array = NDArray[np.float64]
Points = Mapping[str, Array]
"""Landmark to its trajectory, (n_frames, 3), m, x and z level, y up; NaN where it is not known.

``RASIS LASIS RPSIS LPSIS`` or ``SACR``; with R or L before them ``HJC KJC AJC`` (centres of hip, knee,
ankle), ``LFE`` (lateral epicondyle, the knee marker), ``LM`` (lateral malleolus, the ankle marker), ``HEE``
and ``TOE`` (heel and second metatarsal's head, at equal heights over a flat sole), and ``KAX``: a point
beside the ankle centre that spans with ankle and knee centre the plane of the knee's axis, where the shank is
twisted against its ankle. Without it the malleolus does, as in a laboratory that leaves tibial torsion out.
"""

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


def conventional_angles(points: Points, side: Side, heading: ArrayLike = 0.0) -> dict[str, Array]:
    """The conventional angles of one side, as far as the landmarks tell them.

    ``points``: see :data:`Points`. ``heading`` (float or (n_frames,), rad): where the person walks: turn
    about y that leads from x to this direction. Returns those of :data:`ANGLES` that can be computed to
    (n_frames,), rad; NaN where a landmark is hidden. Pelvis rotation and foot progression lie within half a
    turn of the heading.
    """
    letter, found = side.upper(), dict[str, Array]()
    pelvis = _pelvis(points)
    thigh = _thigh(points, letter, side)
    shank_at_ankle = _shank(points, letter, side, "LM")
    shank = _shank(points, letter, side, "KAX") or shank_at_ankle
    foot = _foot(points, letter)
    if pelvis is not None:
        found |= zip(PELVIS, _pelvis_of_side(pelvis, side, heading).T, strict=True)
    if pelvis is not None and thigh is not None:
        found |= zip(HIP, hip_angles(pelvis, thigh, side).T, strict=True)
    if thigh is not None and shank is not None:
        found |= zip(KNEE, knee_angles(thigh, shank, side).T, strict=True)
    if foot is not None and shank_at_ankle is not None:
        found |= zip(ANKLE, _ankle(shank_at_ankle, foot, side).T, strict=True)
    if foot is not None:
        inward = 1.0 if side == "r" else -1.0
        found[FOOT[0]] = inward * _half_turn(np.arctan2(-foot[:, 2], foot[:, 0]) - np.asarray(heading))
    return found


def heel_level(points: Points, side: Side) -> Array:
    """The heel raised or lowered to the toe's height, as a person stands with flat feet, (n_frames, 3), m."""
    heel, toe = (np.atleast_2d(points[f"{side.upper()}{name}"]) for name in ("HEE", "TOE"))
    return np.column_stack([heel[:, 0], toe[:, 1], heel[:, 2]])


def _pelvis(points: Points) -> Frames | None:
    back = ("RPSIS", "LPSIS") if "RPSIS" in points and "LPSIS" in points else ("SACR", "SACR")
    names = ("RASIS", "LASIS", *back)
    return pelvis_frame(*(points[name] for name in names)) if all(name in points for name in names) else None


def _thigh(points: Points, letter: str, side: Side) -> Frames | None:
    names = [f"{letter}{name}" for name in ("HJC", "KJC", "LFE")]
    if not all(name in points for name in names):
        return None
    hip, knee, lateral = (np.atleast_2d(points[name]) for name in names)
    return femur_frame(hip, lateral, 2.0 * knee - lateral, side)


def _shank(points: Points, letter: str, side: Side, lateral: str) -> Frames | None:
    names = [f"{letter}{name}" for name in ("KJC", "AJC", lateral)]
    if not all(name in points for name in names):
        return None
    knee, ankle, beside = (np.atleast_2d(points[name]) for name in names)
    return tibia_frame(knee, ankle, beside, ankle, side)


def _foot(points: Points, letter: str) -> Array | None:
    """From heel to toe, (n_frames, 3)."""
    heel, toe = f"{letter}HEE", f"{letter}TOE"
    if heel not in points or toe not in points:
        return None
    return np.asarray(np.atleast_2d(points[toe]) - np.atleast_2d(points[heel]))


def _pelvis_of_side(pelvis: Frames, side: Side, heading: ArrayLike) -> Array:
    rotation, right_down, backward = pelvis_angles(pelvis).T
    own = 1.0 if side == "r" else -1.0
    return np.column_stack([-backward, -own * right_down, own * _half_turn(rotation - np.asarray(heading))])


def _ankle(shank: Frames, foot: Array, side: Side) -> Array:
    """Dorsiflexion, and inward rotation after it, of a foot that is a line."""
    forward, up, right = np.einsum("nji,nj->in", shank.rotation, foot)
    inward = -1.0 if side == "r" else 1.0
    return np.column_stack([np.arctan2(up, forward), inward * np.arctan2(right, np.hypot(forward, up))])


def _half_turn(angle: ArrayLike) -> Array:
    """The same direction within half a turn of zero, rad."""
    return np.asarray(np.arctan2(np.sin(angle), np.cos(angle)))
