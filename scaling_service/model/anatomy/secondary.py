"""What is published of the smaller rotations of joints, as laws of their flexion."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from scaling_service.model.body import BodyModel, Law, Segment, Shape, Term
from scaling_service.model.compile import evaluate_law
from scaling_service.model.reference import find_reference_folder, read_reference
from scaling_service.numerics.multibody.laws import Array

_ALONG = np.cos(np.radians(30.0))  # chosen: an axis further off is that of another rotation
_LEFT = ("_l", "_left", "left_")


@dataclass(frozen=True, slots=True, kw_only=True)
class SecondaryRotation:
    """A rotation of a joint that its flexion leads, up to a constant."""

    joint: str
    parent: str
    child: str
    coordinate: str
    flexion: str  # the coordinate of flexion
    law: Law  # rad; its mean change with flexion
    sd: float  # rad; by which one person in one movement strays from it
    source: str


def list_secondary_rotations(model: BodyModel) -> Iterator[SecondaryRotation]:
    """Those rotations of which something is published (``reference_models/joint_motion.yaml``).

    Joints are known by the names of their segments, rotations by their axes in the neutral posture: flexion
    about Z, adduction about X, axial rotation about Y. A leg whose name tells no side counts as right.
    """
    for segment in model.segments:
        for joint in _read_published()["joints"]:
            parent = segment.parent.lower()
            if parent.startswith(tuple(joint["parents"])) and segment.name.lower().startswith(
                tuple(joint["children"])
            ):
                yield from _of_joint(model, segment, joint)


def _of_joint(model: BodyModel, segment: Segment, joint: Mapping[str, Any]) -> Iterator[SecondaryRotation]:
    turns = _list_turns(model, segment)
    if "z" not in turns:
        return
    flexion, extends = turns["z"]
    name = segment.name.lower()
    left = name.endswith(_LEFT[:2]) or name.startswith(_LEFT[2])
    for axis, sd in (("x", joint["adduction_sd_deg"]), ("y", joint["internal_rotation_sd_deg"])):
        if axis not in turns:
            continue
        coordinate, sign = turns[axis]
        law = Law()
        if axis == "y":
            shape = _of_flexion(joint["internal_rotation"], joint["largest_flexion_deg"], extends)
            law = Law((Term(-sign if left else sign, coordinate=flexion, shape=shape),))
        yield SecondaryRotation(
            joint=segment.joint_name,
            parent=segment.parent,
            child=segment.name,
            coordinate=coordinate,
            flexion=flexion,
            law=law,
            sd=float(np.radians(sd)),
            source=str(joint["source"]),
        )


def _of_flexion(coefficients: list[float], largest_deg: float, extends: float) -> Shape:
    """A polynomial of flexion in degrees as a shape of the coordinate, which may count extension."""
    polynomial = np.polynomial.Polynomial([float(c) for c in coefficients])
    largest = float(np.radians(largest_deg))
    if extends > 0:  # the coordinate runs from -largest to 0
        breaks, flexion = (-largest, 0.0), np.polynomial.Polynomial([largest_deg, -np.degrees(1.0)])
    else:
        breaks, flexion = (0.0, largest), np.polynomial.Polynomial([0.0, np.degrees(1.0)])
    local = np.radians(polynomial(flexion).coef[::-1])
    return Shape(breaks, (tuple(local.tolist()),))


def _list_turns(model: BodyModel, segment: Segment) -> dict[str, tuple[str, float]]:
    """Axis of the parent to the free coordinate that turns about it, and its sign."""
    defaults = {c.name: c.default for c in model.coordinates} | {p.name: p.value for p in model.parameters}
    reached, found = np.eye(3), {}
    for joint in segment.joints:
        if joint.kind != "rotation":
            continue
        direction: Array = reached @ np.array(joint.axis)
        moving = [t for t in joint.law.terms if not t.is_constant]
        if len(moving) == 1 and moving[0].coordinate and moving[0].shape is None and not moving[0].parameter:
            axis = int(np.argmax(np.abs(direction)))
            free = not model.coordinate(moving[0].coordinate).locked
            if abs(direction[axis]) >= _ALONG and free and abs(moving[0].gain) == 1.0:
                sign = float(np.sign(direction[axis]) * moving[0].gain)
                found["xyz"[axis]] = (moving[0].coordinate, sign)
        value = float(evaluate_law(joint.law, defaults))
        reached = reached @ Rotation.from_rotvec(value * np.array(joint.axis)).as_matrix()
    return found


@cache
def _read_published() -> Mapping[str, Any]:
    table: Mapping[str, Any] = read_reference(find_reference_folder() / "joint_motion.yaml")
    return table
