"""An effect of a model's left side as one of its right side.

Model and body are taken as mirror images about the plane of x and y. A direction then turns into its image,
and an axis of turning into its image reversed; coordinates of both sides mean the same movement where their
axes do so.
"""

from __future__ import annotations

import numpy as np

from scaling_service.capabilities.discovery.laws.candidates import Candidate, Column
from scaling_service.capabilities.discovery.laws.loads import Inertial
from scaling_service.capabilities.discovery.laws.spots import JointSpot, find_index
from scaling_service.core.arrays import Array
from scaling_service.model.body import GROUND, BodyModel
from scaling_service.model.poses import follow, list_model_values, pose_neutral_frames

_MIRROR = np.array([1.0, 1.0, -1.0])
_SAME = 0.02  # of a direction: what left and right may differ by (chosen: a degree)


def flip_name(name: str) -> str:
    """The name on the other side, as OpenSim gives names; itself where it has none.

    Examples
    --------
    >>> flip_name("walker_knee_r"), flip_name("torso")
    ('walker_knee_l', 'torso')
    """
    return name[:-1] + {"r": "l", "l": "r"}[name[-1]] if name[-2:] in ("_r", "_l") else name


def mirror_numbers(one: Candidate, other: Candidate, model: BodyModel) -> Array | None:
    """What an effect's numbers (k,) are on the other side, (k, k); None where the two are no images."""
    if len(one.columns) != len(other.columns):
        return None
    sign = 1.0
    for driver, twin in zip(one.driver, other.driver, strict=True):
        (axis, turns), (image, _) = (_find_axis(name, model) for name in (driver, twin))
        sign *= float(np.sign(_reflect(axis, turns=turns) @ image))
    ways = [
        (_find_direction(a, model), _find_direction(b, model))
        for a, b in zip(one.columns, other.columns, strict=True)
    ]
    pairs = [(a, b) for a, b in ways if a is not None and b is not None]
    if len(pairs) < len(ways):
        return sign * np.eye(len(ways))  # of what has no direction, as a mass
    images = np.stack([_reflect(*a) for a, _ in pairs], axis=1)
    own = np.stack([b for _, (b, _) in pairs], axis=1)
    matrix = np.linalg.pinv(own) @ images
    return sign * matrix if np.abs(own @ matrix - images).max() < _SAME else None


def _reflect(direction: Array, turns: bool) -> Array:
    return -_MIRROR * direction if turns else _MIRROR * direction


def _find_direction(column: Column, model: BodyModel) -> tuple[Array, bool] | None:
    """Along which axis of the ground, in the neutral pose, a column moves or turns something, and which."""
    frames = pose_neutral_frames(model)
    if isinstance(column.load, Inertial):
        mass, *moved = column.load.change[:4]
        if mass:
            return None
        return frames[column.load.segment][0] @ np.array(moved) / np.linalg.norm(moved), False
    spot = column.parts[0].spot if column.parts else None
    if not isinstance(spot, JointSpot):
        return None
    segment = model.segment(spot.segment)
    before = segment.joints[: find_index(segment, spot.at)]
    R = follow(before, list_model_values(model), frames[segment.parent])[0]
    return np.sign(column.parts[0].gain) * R[:, spot.axis], spot.kind == "rotation"


def _find_axis(coordinate: str, model: BodyModel) -> tuple[Array, bool]:
    """The axis in the ground, in the neutral pose, of the first joint that a coordinate moves."""
    known, frames = list_model_values(model), pose_neutral_frames(model)
    for segment in model.segments:
        for k, joint in enumerate(segment.joints):
            for term in joint.law.terms:
                if term.coordinate == coordinate and (joint.turns or segment.parent == GROUND):
                    R = follow(segment.joints[:k], known, frames[segment.parent])[0]
                    return np.sign(term.gain) * (R @ np.array(joint.axis)), joint.turns
    raise KeyError(coordinate)
