"""Muscles of an MJCF file as MuJoCo has them: lengths and moment arms, ties between joints kept."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.core.errors import DependencyMissing


@dataclass(frozen=True, slots=True, eq=False)
class EngineMuscles:
    """Muscles over sweeps of one coordinate each."""

    engine: str  # with its version
    muscles: tuple[str, ...]
    lengths: Mapping[str, Array]  # coordinate to (n_poses, n_muscles), m
    arms: Mapping[str, Array]  # coordinate to the moment arms about it, (n_poses, n_muscles), m


def measure_in_mujoco(mjcf: str, names: tuple[str, ...], sweeps: Mapping[str, Array]) -> EngineMuscles:
    """Lengths and moment arms of all tendons; an arm holds the motion of joints that follow the coordinate.

    ``mjcf``: text of the file. ``names``: the coordinates of the poses' columns; those that are no joint of
    the file stand still. ``sweeps``: coordinate to (n_poses, n_coordinates), rad or m.
    Raises DependencyMissing: MuJoCo is not installed.
    """
    try:
        mujoco: Any = importlib.import_module("mujoco")
    except ImportError as error:
        raise DependencyMissing(
            f"MuJoCo cannot be imported ({error})",
            field="mujoco",
            remedy="Install it with `pip install scaling-service[mujoco]`",
        ) from error
    model = mujoco.MjModel.from_xml_string(mjcf)
    posed = _Posed(mujoco, model, names)
    lengths, arms = {}, {}
    for coordinate, q in sweeps.items():
        found = [posed.measure(pose, coordinate) for pose in q]
        lengths[coordinate] = np.array([length for length, _ in found])
        arms[coordinate] = np.array([arm for _, arm in found])
    muscles = tuple(model.tendon(k).name for k in range(model.ntendon))
    return EngineMuscles(f"MuJoCo {mujoco.__version__}", muscles, lengths, arms)


class _Posed:
    """A model that takes one pose after the other."""

    def __init__(self, mujoco: Any, model: Any, names: tuple[str, ...]) -> None:
        self._mujoco, self._model, self._data = mujoco, model, mujoco.MjData(model)
        joints = [model.joint(k) for k in range(model.njnt)]
        self._joints = {joint.name: joint.id for joint in joints}
        self._columns = [(k, self._joints[name]) for k, name in enumerate(names) if name in self._joints]
        self._ties = [
            (model.eq_obj1id[k], model.eq_obj2id[k], np.polynomial.Polynomial(model.eq_data[k][:5]))
            for k in range(model.neq)
        ]

    def measure(self, pose: Array, coordinate: str) -> tuple[Array, Array]:
        """Lengths and moment arms about a coordinate, (n_tendons,) each, m."""
        mujoco, model, data = self._mujoco, self._model, self._data
        q, moved = np.zeros(model.njnt), np.zeros(model.njnt)
        for column, joint in self._columns:
            q[joint] = pose[column]
        moved[self._joints[coordinate]] = 1.0
        for follower, leader, law in self._ties:  # in the file, leaders come first
            q[follower] = law(q[leader])
            moved[follower] = law.deriv()(q[leader]) * moved[leader]
        data.qpos[:] = q  # every joint of the file has one degree of freedom
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_tendon(model, data)
        # The tendons' Jacobian, (n_tendons, n_joints); MuJoCo 4 keeps it by rows without zeros.
        if hasattr(model, "ten_J_rownnz"):
            jacobian = np.zeros((model.ntendon, model.nv))
            for k, (start, count) in enumerate(zip(model.ten_J_rowadr, model.ten_J_rownnz, strict=True)):
                jacobian[k, model.ten_J_colind[start : start + count]] = data.ten_J[start : start + count]
        else:
            jacobian = np.reshape(data.ten_J, (model.ntendon, model.nv))
        return data.ten_length.copy(), -jacobian @ moved
