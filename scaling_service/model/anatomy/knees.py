"""A model's knees: their flexion, their side, and what is published of their smaller rotations."""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import scipy
from scipy.spatial.transform import Rotation

from scaling_service.core.arrays import Array
from scaling_service.model import body, reference
from scaling_service.model.anatomy.lengths import find_centre
from scaling_service.model.compile import evaluate_law

_ALONG = np.cos(np.radians(30.0))  # chosen: an axis further off is that of another rotation
_LEFT, _RIGHT = ("_l", "_left", "left_"), ("_r", "_right", "right_")
_ORDINARY_DEG, _LOOKS = 60.0, 13  # of flexion in walking (Winter 2009), and where in it a law is looked at


_LANDMARKS = np.array([[-0.048, -0.123, 0.116], [-0.026, -1.012, 0.099], [0.026, -0.988, -0.099]])
"""Head of the fibula, lateral and medial malleolus: forward, up and outward from the knee's centre, in
lengths of the shank, of the built-in body (``lower_limb_14dof.yaml`` has the sources)."""

_SPREAD = 0.04  # of each along an axis, in lengths of the shank (low: 16 mm, over people and palpation)
_FITS = 20.1  # squares over variances of nine numbers less one: 99 % are smaller (chi-squared)
_SURE = 3.0  # nats of a Bayes factor: 20 to 1 (Kass and Raftery 1995: strong)


@dataclass(frozen=True, slots=True, kw_only=True)
class Knee:
    """A knee that flexes by a coordinate of its own."""

    joint: str
    thigh: str
    shank: str
    flexion: str  # the coordinate
    extends: float  # 1 where the coordinate grows with extension, -1 where it grows with flexion
    side: int  # 1: right, -1: left, 0: neither the names nor the landmarks of the shank tell it
    turns: abc.Mapping[str, tuple[str, float]]  # axis of the thigh to the coordinate about it, and its sign


@dataclass(frozen=True, slots=True, kw_only=True)
class SecondaryRotation:
    """A rotation of a joint that its flexion leads, up to a constant."""

    joint: str
    parent: str
    child: str
    coordinate: str
    flexion: str  # the coordinate of flexion
    law: body.Law  # rad; its mean change with flexion
    sd: float  # rad; by which one person in one movement strays from it
    source: str


def list_stiff_knees(model: body.BodyModel) -> abc.Iterator[str]:
    """Joints between what is called a thigh and a shank of which no coordinate is free."""
    table = _read_published()
    free = {c.name for c in model.coordinates if not c.locked}
    for segment in model.segments:
        parent, name = segment.parent.lower(), segment.name.lower()
        moving = {term.coordinate for joint in segment.joints for term in joint.law.terms}
        is_knee = parent.startswith(tuple(table["parents"])) and name.startswith(tuple(table["children"]))
        if is_knee and free.isdisjoint(moving):
            yield segment.joint_name


def list_knees(model: body.BodyModel) -> abc.Iterator[Knee]:
    """Joints between what is called a thigh and a shank.

    Rotations are known by their axes in the neutral posture: flexion about Z, adduction about X, axial
    rotation about Y.
    """
    table = _read_published()
    for segment in model.segments:
        parent, name = segment.parent.lower(), segment.name.lower()
        if parent.startswith(tuple(table["parents"])) and name.startswith(tuple(table["children"])):
            # Axis of the parent to the free coordinate that turns about it, and its sign
            defaults = {c.name: c.default for c in model.coordinates} | {
                p.name: p.value for p in model.parameters
            }
            reached, turns = np.eye(3), {}
            for joint in segment.joints:
                if joint.kind != "rotation":
                    continue
                direction: Array = reached @ np.array(joint.axis)
                moving = [t for t in joint.law.terms if not t.is_constant]
                if (
                    len(moving) == 1
                    and moving[0].coordinate
                    and moving[0].shape is None
                    and not moving[0].parameter
                ):
                    axis = int(np.argmax(np.abs(direction)))
                    free = not model.coordinate(moving[0].coordinate).locked
                    if abs(direction[axis]) >= _ALONG and free and abs(moving[0].gain) == 1.0:
                        sign = float(np.sign(direction[axis]) * moving[0].gain)
                        turns["xyz"[axis]] = (moving[0].coordinate, sign)
                value = float(evaluate_law(joint.law, defaults))
                reached = reached @ Rotation.from_rotvec(value * np.array(joint.axis)).as_matrix()
            if "z" in turns:
                flexion, extends = turns["z"]
                yield Knee(
                    joint=segment.joint_name,
                    thigh=segment.parent,
                    shank=segment.name,
                    flexion=flexion,
                    extends=extends,
                    side=_tell_side(model, segment),
                    turns=turns,
                )


def list_secondary_rotations(model: body.BodyModel) -> abc.Iterator[SecondaryRotation]:
    """Those rotations of which something is published (``reference_models/joint_motion.yaml``).

    Of a leg whose side is not known, neither is the sense in which its shank turns: the law is nought then,
    and the deviation as large as both.
    """
    table = _read_published()
    for knee in list_knees(model):
        for axis, sd_deg in (("x", table["adduction_sd_deg"]), ("y", table["internal_rotation_sd_deg"])):
            if axis not in knee.turns:
                continue
            coordinate, sign = knee.turns[axis]
            law, sd = body.Law(), float(np.radians(sd_deg))
            if axis == "y":
                shape = _of_flexion(table["internal_rotation"], table["largest_flexion_deg"], knee.extends)
                law = body.Law((body.Term(sign * (knee.side or 1), coordinate=knee.flexion, shape=shape),))
                if not knee.side:
                    bent = -knee.extends * np.linspace(0.0, np.radians(_ORDINARY_DEG), _LOOKS)
                    turned = evaluate_law(law, {knee.flexion: bent})
                    law, sd = body.Law(), float(np.hypot(sd, np.sqrt(np.mean(np.square(turned)))))
            yield SecondaryRotation(
                joint=knee.joint,
                parent=knee.thigh,
                child=knee.shank,
                coordinate=coordinate,
                flexion=knee.flexion,
                law=law,
                sd=sd,
                source=str(table["source"]),
            )


def _tell_side(model: body.BodyModel, shank: body.Segment) -> int:
    """By the name, else by the shank's markers: a fibula's head and a malleolus lie outward and behind."""
    name = shank.name.lower()
    for side, (after, whole, before) in ((-1, _LEFT), (1, _RIGHT)):
        if name.endswith((after, whole)) or name.startswith(before):
            return side
    centre = find_centre(model, [shank])[shank.name]
    places = np.array([m.nominal for m in model.markers if m.segment == shank.name]).reshape(-1, 3) - centre
    if len(places) < len(_LANDMARKS) or places[:, 1].min() >= 0.0:
        return 0
    places = places / -places[:, 1].min()  # malleoli lie a shank's length below the knee
    squares = []
    for outward in (1.0, -1.0):
        wanted, least = _LANDMARKS * [1.0, 1.0, outward], np.inf
        for head in places:  # a knee's centre is anywhere along its axis: each may be the fibula's head
            shift = np.array([0.0, 0.0, head[2] - wanted[0, 2]])
            apart = np.square(places - wanted[:, None] - shift).sum(axis=2)
            off = places[scipy.optimize.linear_sum_assignment(apart)[1]] - wanted
            off[:, 2] -= off[:, 2].mean()
            least = min(least, float(np.square(off / _SPREAD).sum()))
        squares.append(least)
    right, left = squares
    if min(squares) > _FITS or abs(left - right) < 2.0 * _SURE:
        return 0
    return 1 if right < left else -1


def _of_flexion(coefficients: list[float], largest_deg: float, extends: float) -> body.Shape:
    """A polynomial of flexion in degrees as a shape of the coordinate, which may count extension."""
    polynomial = np.polynomial.Polynomial([float(c) for c in coefficients])
    largest = float(np.radians(largest_deg))
    if extends > 0:  # the coordinate runs from -largest to 0
        breaks, flexion = (-largest, 0.0), np.polynomial.Polynomial([largest_deg, -np.degrees(1.0)])
    else:
        breaks, flexion = (0.0, largest), np.polynomial.Polynomial([0.0, np.degrees(1.0)])
    local = np.radians(polynomial(flexion).coef[::-1])
    return body.Shape(breaks, (tuple(local.tolist()),))


@cache
def _read_published() -> abc.Mapping[str, Any]:
    """What is known of a knee."""
    table: abc.Mapping[str, Any] = reference.read_reference(
        reference.find_reference_folder() / "joint_motion.yaml"
    )["joints"][0]
    return table
