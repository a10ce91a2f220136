"""What a model's markers are, by where they sit at its joints: names are each laboratory's own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from scipy.optimize import linear_sum_assignment

from scaling_service.model.anatomy.lengths import find_joint_centres, find_segment
from scaling_service.model.anatomy.markers import find_canonical
from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import load_builtin
from scaling_service.model.poses import pose_neutral_frames
from scaling_service.numerics.multibody.laws import Array

_BODY = "full_body_35dof"

_AT: Mapping[str, tuple[str, str]] = {
    "ASIS": ("pelvis", "hips"),
    "PSIS": ("pelvis", "hips"),
    "LFE": ("femur", "knee"),
    "MFE": ("femur", "knee"),
    "LM": ("tibia", "ankle"),
    "MM": ("tibia", "ankle"),
}
"""Landmark without side to its segment and the joint that it lies at."""

_SD_M = np.array([0.012, 0.015, 0.012])
"""Of a landmark about where the built-in body has it, along x, y (up the leg) and z. Chosen: markers are put
on models by eye; malleoli lie 11 to 31 mm above the ankle of three published models."""

_MOST = 3.0  # deviations beyond which a marker is another one: 97 % of three normal axes lie within


def find_landmarks_by_place(model: BodyModel) -> dict[str, str]:
    """Markers whose names say nothing to the landmarks that they sit at, such as ``RLEP`` to ``RLFE``.

    Only landmarks that no name tells. ``model``: its neutral pose stands upright, x forward, y up. Empty for
    models without legs.

    Examples
    --------
    >>> from dataclasses import replace
    >>> body = load_builtin("lower_limb_14dof")
    >>> other = [replace(m, name="Q1") if m.name == "RLFE" else m for m in body.markers]
    >>> find_landmarks_by_place(body.with_markers(tuple(other)))
    {'Q1': 'RLFE'}
    """
    named = {find_canonical(m.name) for m in model.markers}
    wanted = {name: place for name, place in _list_places(model) if name not in named}
    frames, found = pose_neutral_frames(model), {}
    for segment in dict.fromkeys(segment for segment, _ in wanted.values()):
        landmarks = {name: at for name, (own, at) in wanted.items() if own == segment}
        rotation, origin = frames[segment]
        free = {
            m.name: origin + rotation @ np.array(m.nominal)
            for m in model.markers
            if m.segment == segment and m.weight > 0.0 and find_canonical(m.name) is None
        }
        if not free:
            continue
        apart = np.array([[at - place for place in landmarks.values()] for at in free.values()]) / _SD_M
        off = np.linalg.norm(apart, axis=2)
        for row, column in zip(*linear_sum_assignment(np.minimum(off, _MOST)), strict=True):
            if off[row, column] < _MOST:
                found[list(free)[row]] = list(landmarks)[column]
    return found


def _list_places(model: BodyModel) -> Iterator[tuple[str, tuple[str, Array]]]:
    """Landmark to the model's segment and where the built-in body, as large, has it, m in the room."""
    body = load_builtin(_BODY)
    frames, theirs, ours = pose_neutral_frames(body), _find_joints(body), _find_joints(model)
    for side in "rl":
        shared = theirs[side].keys() & ours[side].keys()
        if not {"knee", "hip"} <= shared:
            continue
        sizes = [np.linalg.norm(j[side]["hip"] - j[side]["knee"]) for j in (ours, theirs)]
        for landmark, (role, joint) in _AT.items():
            if joint in shared and (segment := find_segment(model, role, "" if role == "pelvis" else side)):
                name = f"{side.upper()}{landmark}"
                marker = body.marker(name)
                rotation, origin = frames[marker.segment]
                arm = origin + rotation @ np.array(marker.nominal) - theirs[side][joint]
                yield name, (segment, ours[side][joint] + sizes[0] / sizes[1] * arm)


def _find_joints(model: BodyModel) -> dict[str, dict[str, Array]]:
    """Side to joint to its centre in the neutral pose, m; ``hips``: half-way between both."""
    frames, centres = pose_neutral_frames(model), find_joint_centres(model)
    found: dict[str, dict[str, Array]] = {"r": {}, "l": {}}
    for side, joints in found.items():
        femur = find_segment(model, "femur", side)
        if femur is not None:
            joints["hip"] = frames[femur][1]
        for joint in ("knee", "ankle"):
            if f"{joint}_{side}" in centres:
                segment, at = centres[f"{joint}_{side}"]
                rotation, origin = frames[segment]
                joints[joint] = origin + rotation @ np.array(at)
    if all("hip" in joints for joints in found.values()):
        middle = (found["r"]["hip"] + found["l"]["hip"]) / 2.0
        for joints in found.values():
            joints["hips"] = middle
    return found
