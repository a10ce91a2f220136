"""Joint centres and segment lengths of a body model, built-in or from OpenSim.

A joint's centre is the place, on the way from the parent to the child, where its first turn driven by a
coordinate acts; both segments of the joint know it. Coordinates that turn are at zero (a straight
knee), so that a knee whose centre glides with flexion has one length.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.model import body, poses
from scaling_service.model.anatomy.markers import find_canonical

_SIDES = ("r", "l", "")
_ROLES: Mapping[str, tuple[str, ...]] = {
    "pelvis": ("pelvis",),
    "femur": ("femur", "thigh"),
    "tibia": ("tibia", "shank"),
    "foot": ("talus", "calcn", "foot"),
    "torso": ("torso", "thorax"),
    "humerus": ("humerus", "upperarm", "arm"),
    "ulna": ("ulna", "forearm"),
    "hand": ("hand",),
    "calcn": ("calcn", "foot"),
    "toes": ("toes",),
    "head": ("head",),
}
"""What a segment is, and the names that say so, with the side as ``_r`` or ``_l`` or in front as ``r_``."""

_JOINTS: Mapping[str, tuple[str, str]] = {
    "hip": ("pelvis", "femur"),
    "knee": ("femur", "tibia"),
    "ankle": ("tibia", "foot"),
    "shoulder": ("torso", "humerus"),
    "elbow": ("humerus", "ulna"),
    "wrist": ("ulna", "hand"),
}
_KEPT = 256  # chosen: ends of all joints of some twenty models
_WELDED_ON_M = 0.05
"""Chosen: a segment that is welded on further from the turn above than this is the next bone, as a hand is to
a forearm that turns at the elbow; nearer, both are one joint."""

_LENGTHS: Mapping[str, tuple[str, str, str]] = {
    "femur": ("femur", "hip", "knee"),
    "shank": ("tibia", "knee", "ankle"),
    "upper_arm": ("humerus", "shoulder", "elbow"),
    "forearm": ("ulna", "elbow", "wrist"),
}


def find_joint_centres(model: body.BodyModel) -> dict[str, tuple[str, body.Vector]]:
    """Centres of the joints that the model has, in their proximal segment.

    Returns ``hip_r``, ``knee_r``, ``ankle_r``, ``shoulder_r``, ``elbow_r``, ``wrist_r`` and the left ones to
    (segment, position in that segment's frame, m). Where the model has no foot, the ankle is the landmark
    ``RAJC`` (a marker of weight 0), else half-way between the malleolar markers. In a planar model the names
    have no side.

    Examples
    --------
    >>> from scaling_service.model.builtin import load_builtin
    >>> find_joint_centres(load_builtin("lower_limb_14dof"))["knee_r"]
    ('femur_r', (0.0, -0.43245, 0.0))
    """
    centres = {}
    for side in _SIDES:
        for joint, (proximal, _) in _JOINTS.items():
            segment = _find_part(model, proximal, side)
            ends = find_joint_ends(model, joint, side)
            if segment is not None and segment in ends:
                centres[_name_sided(joint, side)] = (segment, body.to_vector(ends[segment]))
    return centres


def measure_segment_lengths(model: body.BodyModel) -> dict[str, float]:
    """Distances between joint centres, m, as far as the model has them.

    Returns ``inter_hip``, ``femur_r`` (hip to knee), ``shank_r`` (knee to ankle), ``upper_arm_r``,
    ``forearm_r`` and the left ones; without side in a planar model.
    """
    lengths = {}
    hips = [find_joint_ends(model, "hip", side) for side in ("r", "l")]
    pelvis = find_segment(model, "pelvis", "")
    if pelvis is not None and all(pelvis in ends for ends in hips):
        lengths["inter_hip"] = float(np.linalg.norm(hips[0][pelvis] - hips[1][pelvis]))
    for side in _SIDES:
        for name, (role, proximal, distal) in _LENGTHS.items():
            segment = find_segment(model, role, side)
            first, last = find_joint_ends(model, proximal, side), find_joint_ends(model, distal, side)
            if segment is not None and segment in first and segment in last:
                lengths[_name_sided(name, side)] = float(np.linalg.norm(first[segment] - last[segment]))
    return lengths


def find_segment(model: body.BodyModel, role: str, side: str) -> str | None:
    """The segment that plays a part on a side, whatever the model calls it; None if there is none.

    What the model says of its bones counts before the names of its segments.

    ``role``: ``pelvis``, ``femur``, ``tibia``, ``foot`` (what the ankle moves), ``calcn`` (what carries the
    foot's markers), ``toes``, ``torso``, ``head``, ``humerus``, ``ulna`` or ``hand``.
    """
    names = {segment.name.casefold(): segment.name for segment in model.segments} | dict(model.bones)
    for word in _ROLES[role]:
        forms = (f"{word}_{side}", f"{side}_{word}") if side else (word,)
        for form in forms:
            if form in names:
                return names[form]
    return None


def _name_sided(name: str, side: str) -> str:
    return f"{name}_{side}" if side else name


def find_joint_ends(model: body.BodyModel, joint: str, side: str) -> dict[str, Array]:
    """A joint's centre, (3,) m, in the frames of the segments that know it (empty if there is no such joint).

    ``joint``: ``hip``, ``knee``, ``ankle``, ``shoulder``, ``elbow`` or ``wrist``.
    """
    return dict(_find_ends_cached(body.Same(model), joint, side))


@lru_cache(maxsize=_KEPT)
def _find_ends_cached(same: body.Same, joint: str, side: str) -> dict[str, Array]:
    model = same.model
    first, second = (_find_part(model, role, side) for role in _JOINTS[joint])
    if first is not None and second is not None:
        for child, parent in ((second, first), (first, second)):
            chain = list_chain(model, parent, child)
            if chain:
                return find_centre(model, chain)
    if joint != "ankle" or first is None:
        return {}
    # A shank without a foot may know the ankle by its markers.
    values, letter = poses.straighten(model), side.upper()
    places = {
        (m.name if m.weight == 0.0 else find_canonical(m.name)): poses.evaluate_marker(m, values)
        for m in model.markers
        if m.segment == first
    }
    if f"{letter}AJC" in places:
        return {first: places[f"{letter}AJC"]}
    malleoli = [places[name] for name in (f"{letter}LM", f"{letter}MM") if name in places]
    return {first: (malleoli[0] + malleoli[1]) / 2.0} if len(malleoli) == 2 else {}


def _find_part(model: body.BodyModel, role: str, side: str) -> str | None:
    """As :func:`find_segment`; pelvis and torso have no side; a planar torso may stand for the pelvis."""
    if role == "pelvis":
        return find_segment(model, "pelvis", "") or (find_segment(model, "torso", "") if not side else None)
    return find_segment(model, role, "" if role == "torso" else side)


def list_chain(model: body.BodyModel, parent: str, child: str) -> list[body.Segment]:
    """The segments from just below ``parent`` down to ``child``; empty if it does not hang there."""
    chain: list[body.Segment] = []
    name = child
    while name not in (body.GROUND, parent):
        segment = model.segment(name)
        chain.insert(0, segment)
        name = segment.parent
    return chain if name == parent else []


def find_centre(model: body.BodyModel, chain: list[body.Segment]) -> dict[str, Array]:
    """Where the joint at the end of a chain turns, in the frames of its first parent and of every segment."""
    values = poses.straighten(model)
    joints = [joint for segment in chain for joint in segment.joints]
    # The turn that makes a chain's last joint: the first driven one of the last segment, or of the whole
    # chain where the last one is welded on.
    driven = [_is_driven(joint) for segment in chain for joint in segment.joints]
    last = len(driven) - len(chain[-1].joints)
    before_turn = driven.index(True, last if True in driven[last:] else 0) if True in driven else last
    _, centre = poses.follow(joints[:before_turn], values)
    _, end = poses.follow(joints, values)
    if np.linalg.norm(end - centre) > _WELDED_ON_M and not any(map(_is_driven, chain[-1].joints)):
        centre = end
    known = {chain[0].parent: centre}
    done = 0
    for segment in chain:
        done += len(segment.joints)
        rotation, origin = poses.follow(joints[:done], values)
        known[segment.name] = rotation.T @ (centre - origin)
    return known


def _is_driven(joint: body.Joint) -> bool:
    return joint.kind == "rotation" and bool(joint.law.coordinates)
