"""A joint between two frames as a chain of one-degree-of-freedom joints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from scaling_service.model.body import GROUND, Joint, Law, Vector
from scaling_service.numerics.multibody.rigid import vector_from_rotation

Json = Mapping[str, Any]

_NO_TURN = 1e-15
"""rad; a smaller constant rotation is rounding (chosen: below the spacing of numbers near one)."""


def joint_chain(joint: Json, laws: Sequence[Law], *, reversed_: bool = False) -> tuple[Joint, ...]:
    """The chain from the parent body's frame to the child body's.

    ``joint``: ``parent`` and ``child`` frames (body and offsets, outwards) and the ``axes``: for each its
    kind, direction in the parent's joint frame and whether it scales with the parent. ``laws``: one per
    axis. ``reversed_``: whether the chain is to lead from the child body to the parent body.

    OpenSim's joints move by translations along axes fixed in the parent's joint frame, followed by
    body-fixed successive rotations (Simbody's function-based mobilizer).
    """
    parent = joint["parent"]["body"]
    moving = [_moving(axis, law, parent) for axis, law in zip(joint["axes"], laws, strict=True) if law.terms]
    chain = (
        *_offset_chain(joint["parent"]),
        *(j for j in moving if j.kind == "translation"),
        *(j for j in moving if j.kind == "rotation"),
        *inverse_chain(_offset_chain(joint["child"])),
    )
    return inverse_chain(chain) if reversed_ else chain


def inverse_chain(chain: Sequence[Joint]) -> tuple[Joint, ...]:
    """The chain that leads back."""
    return tuple(replace(joint, law=joint.law.scaled(-1.0)) for joint in reversed(chain))


def _moving(axis: Json, law: Law, parent: str) -> Joint:
    direction = np.array(axis["axis"], dtype=float)
    direction /= np.linalg.norm(direction)
    scales = parent if axis["scales"] and parent != GROUND else None
    if axis["kind"] == "rotation":
        return Joint("rotation", _vector(direction), law)
    return Joint("translation", _vector(direction), law, scales)


def _offset_chain(frame: Json) -> tuple[Joint, ...]:
    """From a body to a frame fixed in it, through all offsets between."""
    body = frame["body"]
    scales = None if body == GROUND else body
    chain: list[Joint] = []
    for offset in frame["offsets"]:
        for axis, value in zip(np.eye(3), offset["translation"], strict=True):
            if value:
                chain.append(Joint("translation", _vector(axis), Law.constant(value), scales))
        turn = vector_from_rotation(np.array(offset["rotation"]))
        angle = float(np.linalg.norm(turn))
        if angle > _NO_TURN:
            chain.append(Joint("rotation", _vector(turn / angle), Law.constant(angle)))
    return tuple(chain)


def _vector(values: np.ndarray[Any, np.dtype[np.float64]]) -> Vector:
    x, y, z = (float(v) for v in values)
    return (x, y, z)
