"""Lengths and moment arms of muscles at given poses (worker side)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.errors import ModelRefused
from scaling_service.files.osim.library import items, load, opensim

Array = NDArray[np.float64]

_NO_ARM = 1e-9  # m; chosen: a moment arm below is rounding


def measure(request: Mapping[str, Any]) -> dict[str, Any]:
    """Lengths and moment arms of all muscles in every frame; see ``muscles.measure_muscles``."""
    file = Path("posed.osim")  # in the worker's own scratch directory
    file.write_text(request["text"], encoding="utf-8")
    osim = load(file)
    muscles = items(osim.getMuscles())
    paths = [find_path(muscle) for muscle in muscles]
    frames = len(next(iter(request["q"].values())))
    lengths, forces = np.zeros((frames, len(muscles))), np.zeros((frames, len(muscles), 0))
    if muscles and frames:
        posed = _Posed(osim, request["q"])
        forces = np.zeros((frames, len(muscles), posed.freedoms))
        for frame in range(frames):
            posed.take(frame)
            lengths[frame] = [muscle.getLength(posed.state) for muscle in muscles]
            forces[frame] = [posed.forces_of(path) for path in paths]
        for dependent, independent, slopes in request["couplings"]:
            follower, leader = posed.rows[dependent], posed.rows[independent]
            forces[:, :, leader] += forces[:, :, follower] * np.asarray(slopes)[:, None]
    arms = [
        (muscle.getName(), name, forces[:, k, posed.rows[name]].tolist())
        for k, muscle in enumerate(muscles)
        for name in request["coordinates"]
        if frames and np.abs(forces[:, k, posed.rows[name]]).max() > _NO_ARM
    ]
    return {"muscles": [m.getName() for m in muscles], "lengths": lengths.tolist(), "arms": arms}


def find_path(muscle: Any) -> Any:
    """A muscle's path (ModelRefused: it is not made of points)."""
    path = opensim().GeometryPath.safeDownCast(muscle.getComponent("path"))
    if path is None:
        raise ModelRefused(
            f"the path of muscle '{muscle.getName()}' is not made of points",
            field=muscle.getName(),
            remedy="Give a model whose muscles have a GeometryPath",
        )
    return path


class _Posed:
    """A model that takes one pose after the other."""

    def __init__(self, osim: Any, q: Mapping[str, Sequence[float]]) -> None:
        for coordinate in items(osim.updCoordinateSet()):  # a pose is taken as it is
            coordinate.setDefaultClamped(False)
            coordinate.setDefaultLocked(False)
            coordinate.set_prescribed(False)
        self.osim, self.state = osim, osim.initSystem()
        self._q = [(osim.getCoordinateSet().get(name), values) for name, values in q.items()]
        self.rows = {name: _row(osim.getCoordinateSet().get(name), self.state) for name in q}
        self.freedoms = self.state.getNU()
        self._links = osim.getBodySet().getSize() + 1  # a model is a tree: its bodies and the ground
        self._forces = opensim().Vector(self.freedoms, 0.0)

    def take(self, frame: int) -> None:
        """Take the pose of a frame."""
        for coordinate, values in self._q:
            coordinate.setValue(self.state, values[frame], False)
        self.osim.realizePosition(self.state)

    def forces_of(self, path: Any) -> Array:
        """The generalised forces of a unit tension, (n_freedoms,)."""
        library = opensim()
        none = library.SpatialVec(library.Vec3(0.0), library.Vec3(0.0))
        loads, direct = library.VectorOfSpatialVec(self._links, none), library.Vector(self.freedoms, 0.0)
        path.addInEquivalentForces(self.state, 1.0, loads, direct)
        self.osim.getMatterSubsystem().multiplyBySystemJacobianTranspose(self.state, loads, self._forces)
        forces: Array = self._forces.to_numpy() + direct.to_numpy()
        return forces


def _row(coordinate: Any, state: Any) -> int:
    """Where a coordinate's speed stands in the state."""
    coordinate.setSpeedValue(state, 1.0)
    (row,) = np.flatnonzero(state.getU().to_numpy())
    coordinate.setSpeedValue(state, 0.0)
    return int(row)
