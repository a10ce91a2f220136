"""Where a model carries the joint centres and landmarks that conventional joint angles are made from."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from scaling_service.model.anatomy.conventional import heel_level
from scaling_service.model.anatomy.lengths import joint_centres, segment_of
from scaling_service.model.anatomy.markers import canonical, strip_prefix
from scaling_service.model.body import BodyModel, Marker
from scaling_service.model.poses import marker_position, model_values, neutral_frames, placed_markers
from scaling_service.model.results import Array, Motion

_PELVIS = ("RASIS", "LASIS", "RPSIS", "LPSIS", "SACR")
_LEG = ("LFE", "MFE", "LM", "MM", "HEE", "TOE", "MT1", "MT5")
_BEHIND_M = 0.05
"""Chosen: a third of the way from front to back of an adult's pelvis, far beyond what markers are off."""

_CENTRES = {"hip": "HJC", "knee": "KJC", "ankle": "AJC"}
_TOES = re.compile(r"[RL]TOE(TIP)?")
"""The second metatarsal's head or the tip before it: on one line with the heel, seen from above."""

_Place = tuple[str, Array]
"""Segment, and a position in ground where all turns of the model are zero, (3,), m."""


def clinical_landmarks(model: BodyModel) -> dict[str, Marker]:
    """The landmarks of ``Points`` that a model has.

    Joint centres are the model's, the others its markers of that name or alias. Where a model knows both
    epicondyles or malleoli, the lateral one counts as lying beside the joint's centre in their direction.

    All turns of the model at zero are its neutral pose: the shank's frontal plane is the thigh's there, so
    that knee rotation counts from it and tibial torsion does not enter; and soles are level, heel and toe
    marker equally high.

    Returns
    -------
    dict
        Landmark to a marker at its place on a segment; without those that the model does not have.
    """
    straight = {c.name: 0.0 for c in model.coordinates if c.kind == "rotation"}
    frames, values = neutral_frames(model, straight), model_values(model)

    def place(segment: str, local: Array) -> _Place:
        rotation, origin = frames[segment]
        return segment, origin + rotation @ local

    places = {
        f"{name[-1].upper()}{_CENTRES[name[:-2]]}": place(segment, np.array(at))
        for name, (segment, at) in joint_centres(model).items()
        if name[:-2] in _CENTRES
    }
    for name in (*_PELVIS, *(f"{letter}{name}" for letter in "RL" for name in _LEG)):
        found = next((m for m in model.markers if _means(m.name, name)), None)
        if found is not None:
            places[name] = place(found.segment, marker_position(found, values))
    for letter in "RL":
        places |= _beside(places, f"{letter}KJC", f"{letter}LFE", f"{letter}MFE")
        places |= _beside(places, f"{letter}AJC", f"{letter}LM", f"{letter}MM")
        places |= _knee_axis(places, letter, segment_of(model, "tibia", letter.lower()))
        places |= _foot_line(places, letter)
    return {
        name: Marker.at(name, segment, _local(frames[segment], point))
        for name, (segment, point) in places.items()
    }


def moved_landmarks(model: BodyModel, motion: Motion, placed: Mapping[str, Marker]) -> dict[str, Array]:
    """Landmark to its trajectory in a motion of the model, (n_frames, 3), m.

    NaN where it hangs on a coordinate that the recording, or this frame of it, does not determine.
    """
    q = np.full((len(motion.times), len(model.coordinates)), np.nan)
    for k, name in enumerate(model.coordinate_names):
        if name in motion.estimated:
            q[:, k] = motion.q[:, motion.coordinates.index(name)]
    names = tuple(placed)
    where = placed_markers(model.with_markers(tuple(placed.values())), names, q)
    return {name: where[:, k] for k, name in enumerate(names)}


def tilt_is_seen(model: BodyModel, motion: Motion) -> bool:
    """Whether a marker that a motion follows shows how far the pelvis is tilted.

    One that lies off the line through both front spines does. A motion that follows no marker of the pelvis
    at all (as of a virtual person) is taken as known.
    """
    front = {name: m for m in model.markers for name in ("RASIS", "LASIS") if _means(m.name, name)}
    if len(front) < 2:
        return True
    values, pelvis = model_values(model), front["RASIS"].segment
    right, left = (marker_position(front[name], values) for name in ("RASIS", "LASIS"))
    across = (right - left) / np.linalg.norm(right - left)
    seen = {name for k, name in enumerate(motion.markers) if np.isfinite(motion.residuals[:, k]).any()}
    off = [
        float(np.linalg.norm(np.cross(marker_position(m, values) - left, across)))
        for m in model.markers
        if m.segment == pelvis and m.name in seen
    ]
    return not off or max(off) > _BEHIND_M


def _means(label: str, landmark: str) -> bool:
    if canonical(label) == landmark:
        return True
    plain = re.sub(r"[\s._-]+", "", strip_prefix(label).upper())
    return plain == landmark or (
        landmark[1:] == "TOE" and landmark[0] == plain[:1] and bool(_TOES.fullmatch(plain))
    )


def _local(frame: tuple[Array, Array], point: Array) -> tuple[float, float, float]:
    rotation, origin = frame
    x, y, z = (float(v) for v in rotation.T @ (point - origin))
    return x, y, z


def _beside(places: Mapping[str, _Place], centre: str, lateral: str, medial: str) -> dict[str, _Place]:
    """The lateral landmark beside the joint's centre, in the direction from the medial one."""
    if not {centre, lateral, medial} <= places.keys() or places[lateral][0] != places[medial][0]:
        return {}
    segment, outside = places[lateral]
    return {lateral: (segment, places[centre][1] + (outside - places[medial][1]) / 2.0)}


def _knee_axis(places: Mapping[str, _Place], letter: str, shank: str | None) -> dict[str, _Place]:
    """Beside the ankle as the lateral epicondyle is beside the knee, on the shank."""
    knee, lateral, ankle = (f"{letter}{name}" for name in ("KJC", "LFE", "AJC"))
    if shank is None or not {knee, lateral, ankle} <= places.keys():
        return {}
    return {f"{letter}KAX": (shank, places[ankle][1] + places[lateral][1] - places[knee][1])}


def _foot_line(places: Mapping[str, _Place], letter: str) -> dict[str, _Place]:
    """The heel at the toe's height; the toe between the metatarsal heads where it has no own marker."""
    heel, toe, inner, outer = (f"{letter}{name}" for name in ("HEE", "TOE", "MT1", "MT5"))
    found = dict(places)
    if toe not in found and {inner, outer} <= found.keys():
        found[toe] = (found[inner][0], (found[inner][1] + found[outer][1]) / 2.0)
    if not {heel, toe} <= found.keys():
        return {}
    ends = {name: found[name][1][None] for name in (heel, toe)}
    return {toe: found[toe], heel: (found[heel][0], heel_level(ends, "r" if letter == "R" else "l")[0])}
