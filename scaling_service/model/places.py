"""What a model's markers are, by where they sit at its joints: names are each laboratory's own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy

from scaling_service.core.arrays import Array
from scaling_service.model import poses
from scaling_service.model.anatomy import lengths, markers
from scaling_service.model.anatomy.bones import find_rightward
from scaling_service.model.body import BodyModel

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


_FARTHEST = 0.25
"""Chosen, in lengths of the thigh: how far off its landmark's place a marker may lie that is called so. The
farthest of nine models' is 0.11 off."""


def find_landmarks_by_place(model: BodyModel) -> dict[str, str | None]:
    """Markers that sit at landmarks which their names do not say, such as ``RLEP`` to ``RLFE``.

    Only landmarks that no name tells. None for a marker that is called like a landmark and lies elsewhere: it
    is no landmark. Directions are those of the model's own joints, whatever its axes: up along each bone,
    right from hip to hip, else across the foot. Empty for models without legs.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from scaling_service.model.builtin import load_builtin
    >>> body = load_builtin("lower_limb_14dof")
    >>> other = [replace(m, name="Q1") if m.name == "RLFE" else m for m in body.markers]
    >>> find_landmarks_by_place(body.with_markers(tuple(other)))
    {'Q1': 'RLFE'}
    """
    places, at = _list_places(model), poses.pose_neutral_markers(model)
    named = {
        m.name: landmark for m in model.markers if (landmark := markers.find_canonical(m.name)) is not None
    }
    wrong = {
        name
        for name, landmark in named.items()
        if landmark in places and np.linalg.norm(places[landmark].measure(at[name])) > _FARTHEST
    }
    known = {landmark for name, landmark in named.items() if name not in wrong}
    found: dict[str, str | None] = dict.fromkeys(sorted(wrong))
    for segment in dict.fromkeys(place.segment for place in places.values()):
        wanted = [n for n, place in places.items() if place.segment == segment and n not in known]
        own = [m.name for m in model.markers if m.segment == segment and m.weight > 0.0]
        free = [name for name in own if name not in named or name in wrong]
        if not free or not wanted:
            continue
        apart = np.array([[places[n].measure(at[name]) / places[n].sd for n in wanted] for name in free])
        off = np.linalg.norm(apart, axis=2)
        for row, column in zip(*scipy.optimize.linear_sum_assignment(np.minimum(off, _MOST)), strict=True):
            if off[row, column] < _MOST:
                found[free[row]] = wanted[column]
    if {"RPSIS", "LPSIS"} <= known | set(found.values()):
        return {name: landmark for name, landmark in found.items() if landmark != markers.SACRUM}
    return found


def tell_landmarks(model: BodyModel) -> dict[str, str]:
    """Markers that mark a landmark, by name or by place, to the landmark with its side."""
    by_place = find_landmarks_by_place(model)
    told = {m.name: by_place.get(m.name, markers.find_canonical(m.name)) for m in model.markers}
    return {name: landmark for name, landmark in told.items() if landmark is not None}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Place:
    """Where a model has a landmark in the neutral pose."""

    segment: str
    at: Array  # (3,), m, in ground
    axes: Array  # (3, 3), forward, up and right as columns
    thigh: float  # m
    sd: Array  # (3,), along the axes, in lengths of the thigh

    def measure(self, at: Array) -> Array:
        """How far a point lies from it along its axes, (3,), in lengths of the thigh."""
        return np.asarray((at - self.at) @ self.axes / self.thigh)


def _list_places(model: BodyModel) -> dict[str, _Place]:
    joints, found = _find_joints(model), {}
    pelvis = lengths.find_segment(model, "pelvis", "")
    thighs = {s: own["hip"] - own["knee"] for s, own in joints.items() if {"hip", "knee"} <= own.keys()}
    if pelvis is None or not thighs:
        return {}
    if len(thighs) == 2:
        right = joints["r"]["hip"] - joints["l"]["hip"]
    elif (by_foot := find_rightward(model)) is not None:
        right = by_foot
    else:
        return {}
    level = _make_axes(np.mean([*thighs.values()], axis=0), right, level=True)
    for side, along in thighs.items():
        own, thigh = joints[side], float(np.linalg.norm(along))
        axes = {"hip": level, "knee": _make_axes(along, right)}
        if "ankle" in own:
            axes["ankle"] = _make_axes(own["knee"] - own["ankle"], right)
        outwards = np.array([1.0, 1.0, 1.0 if side == "r" else -1.0])
        for landmark, (role, joint, place) in _AT.items():
            segment = lengths.find_segment(model, role, "" if role == "pelvis" else side)
            if joint in axes and segment is not None:
                found[f"{side.upper()}{landmark}"] = _Place(
                    segment=segment,
                    at=own[joint] + thigh * axes[joint] @ (np.array(place) * outwards),
                    axes=axes[joint],
                    thigh=thigh,
                    sd=_SD[joint],
                )
        if len(thighs) == 2:
            middle = (joints["r"]["hip"] + joints["l"]["hip"]) / 2.0
            found[markers.SACRUM] = _Place(
                segment=pelvis,
                at=middle + thigh * level @ np.array(_SACRUM),
                axes=level,
                thigh=thigh,
                sd=_SD["hip"],
            )
    return found


def _make_axes(up: Array, right: Array, *, level: bool = False) -> Array:
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
    frames = poses.pose_neutral_frames(model)
    found: dict[str, dict[str, Array]] = {"r": {}, "l": {}}
    for name, (segment, at) in lengths.find_joint_centres(model).items():
        joint, _, side = name.partition("_")
        if joint in ("hip", "knee", "ankle") and side in found:
            rotation, origin = frames[segment]
            found[side][joint] = origin + rotation @ np.array(at)
    return found
