"""What a model's markers are, by where they sit at its joints: names are each laboratory's own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from scipy.optimize import linear_sum_assignment

from scaling_service.model.anatomy.bones import find_rightward
from scaling_service.model.anatomy.lengths import find_joint_centres, find_segment
from scaling_service.model.anatomy.markers import SACRUM, find_canonical
from scaling_service.model.body import BodyModel
from scaling_service.model.poses import pose_neutral_frames, pose_neutral_markers
from scaling_service.numerics.multibody.laws import Array

_AT: Mapping[str, tuple[str, str, tuple[float, float, float]]] = {
    "ASIS": ("pelvis", "hip", (0.177, 0.222, 0.098)),
    "PSIS": ("pelvis", "hip", (-0.266, 0.233, -0.075)),
    "LFE": ("femur", "knee", (0.014, 0.003, 0.139)),
    "MFE": ("femur", "knee", (-0.001, 0.010, -0.141)),
    "LM": ("tibia", "ankle", (-0.019, 0.020, 0.118)),
    "MM": ("tibia", "ankle", (0.020, 0.047, -0.096)),
}
"""Landmark without side to its segment, the joint that it lies at, and where from it: forward, up the bone
and to its own side, in lengths of the thigh. Means of the built-in body, gait2354, Rajagopal 2016, OpenCap's
generic model and a manually scaled one of an MRI study."""

_SACRUM = (-0.240, 0.250, 0.0)
"""The same of one marker in place of both PSIS, from half-way between the hips: gait2354's, and the others'
mean of both PSIS."""

_SD: Mapping[str, Array] = {
    "hip": np.array([0.048, 0.031, 0.031]),
    "knee": np.array([0.033, 0.023, 0.034]),
    "ankle": np.array([0.026, 0.034, 0.023]),
}
"""Standard deviations between these five models, pooled over the landmarks of a joint, widened by a tenth (a
sixth model about the mean of five), at least 0.023: 10 mm, within palpation's 6 to 21 (Della Croce 2005)."""

_MOST = 3.6
"""Deviations beyond which a marker is as likely to be one that was put anywhere on the segment: a normal
density of 10 mm to an axis against an even one over the 9 dm3 of a thigh, its skin and what stands off it."""


def find_landmarks_by_place(model: BodyModel) -> dict[str, str]:
    """Markers whose names say nothing to the landmarks that they sit at, such as ``RLEP`` to ``RLFE``.

    Only landmarks that no name tells. Directions are those of the model's own joints, whatever its axes: up
    along each bone, right from hip to hip. Empty for models without legs.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from scaling_service.model.builtin import load_builtin
    >>> body = load_builtin("lower_limb_14dof")
    >>> other = [replace(m, name="Q1") if m.name == "RLFE" else m for m in body.markers]
    >>> find_landmarks_by_place(body.with_markers(tuple(other)))
    {'Q1': 'RLFE'}
    """
    named = {find_canonical(m.name) for m in model.markers}
    wanted = {name: where for name, where in _list_places(model) if name not in named}
    at, found = pose_neutral_markers(model), {}
    for segment in dict.fromkeys(segment for segment, _, _ in wanted.values()):
        places = {name: (place, axes) for name, (own, place, axes) in wanted.items() if own == segment}
        free = [
            m.name
            for m in model.markers
            if m.segment == segment and m.weight > 0.0 and find_canonical(m.name) is None
        ]
        if not free:
            continue
        off = np.array(
            [[np.linalg.norm((at[name] - place) @ axes) for place, axes in places.values()] for name in free]
        )
        for row, column in zip(*linear_sum_assignment(np.minimum(off, _MOST)), strict=True):
            if off[row, column] < _MOST:
                found[free[row]] = list(places)[column]
    both = {"RPSIS", "LPSIS"} <= named | set(found.values())
    return {name: landmark for name, landmark in found.items() if not both or landmark != SACRUM}


def _list_places(model: BodyModel) -> Iterator[tuple[str, tuple[str, Array, Array]]]:
    """Landmark to its segment, its place in the neutral pose, (3,) m, and axes in deviations, (3, 3), 1/m."""
    joints = _find_joints(model)
    pelvis = find_segment(model, "pelvis", "")
    if pelvis is None or not any({"hip", "knee"} <= joints[side].keys() for side in "rl"):
        return
    if all("hip" in joints[side] for side in "rl"):
        right = joints["r"]["hip"] - joints["l"]["hip"]
    elif (by_foot := find_rightward(model)) is not None:
        right = by_foot
    else:
        return
    whole = [own["hip"] - own["knee"] for own in joints.values() if {"hip", "knee"} <= own.keys()]
    if len(whole) == 2:
        thigh, axes = float(np.linalg.norm(whole[0])), _make_axes(np.mean(whole, axis=0), right, level=True)
        middle = (joints["r"]["hip"] + joints["l"]["hip"]) / 2.0
        yield SACRUM, (pelvis, middle + thigh * axes @ np.array(_SACRUM), axes / (thigh * _SD["hip"]))
    for side, outwards in (("r", 1.0), ("l", -1.0)):
        own = joints[side]
        if not {"hip", "knee"} <= own.keys():
            continue
        thigh = float(np.linalg.norm(own["hip"] - own["knee"]))
        up = {"hip": np.mean(whole, axis=0), "knee": own["hip"] - own["knee"]}
        if "ankle" in own:
            up["ankle"] = own["knee"] - own["ankle"]
        for landmark, (role, joint, place) in _AT.items():
            segment = find_segment(model, role, "" if role == "pelvis" else side)
            if joint in up and segment is not None:
                axes = _make_axes(up[joint], right, level=joint == "hip")
                where = own[joint] + thigh * axes @ (np.array(place) * (1.0, 1.0, outwards))
                yield f"{side.upper()}{landmark}", (segment, where, axes / (thigh * _SD[joint]))


def _make_axes(up: Array, right: Array, *, level: bool) -> Array:
    """Forward, up and right as columns; what is ``level`` keeps right and turns up, else up is kept."""
    forward = np.cross(up, right)
    if level:
        up = np.cross(right, forward)
    else:
        right = np.cross(forward, up)
    axes = np.column_stack([forward, up, right])
    return np.asarray(axes / np.linalg.norm(axes, axis=0))


def _find_joints(model: BodyModel) -> dict[str, dict[str, Array]]:
    """Side to ``hip``, ``knee`` and ``ankle``, as far as the model has them, in the neutral pose, (3,) m."""
    frames = pose_neutral_frames(model)
    found: dict[str, dict[str, Array]] = {"r": {}, "l": {}}
    for name, (segment, at) in find_joint_centres(model).items():
        joint, _, side = name.partition("_")
        if joint in ("hip", "knee", "ankle") and side in found:
            rotation, origin = frames[segment]
            found[side][joint] = origin + rotation @ np.array(at)
    return found
