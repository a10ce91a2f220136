"""Muscles in OpenSim (worker side): lengths, moment arms, attachments, and surfaces drawn as bones."""

from __future__ import annotations

from collections import abc
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.arrays import Array
from scaling_service.core.errors import ModelRefused
from scaling_service.files.osim.library import (
    import_opensim,
    list_items,
    list_numbers,
    load,
    place_frame,
    place_in_body,
)

_NO_ARM = 1e-9  # m; chosen: a moment arm below is rounding

_LENGTHS: abc.Mapping[str, tuple[str, ...]] = {
    "WrapSphere": ("radius",),
    "WrapCylinder": ("radius", "length"),
    "WrapTorus": ("inner_radius", "outer_radius"),
}
"""Kinds of wraps, and their properties that are lengths."""


def measure(request: abc.Mapping[str, Any]) -> dict[str, Any]:
    """Lengths and moment arms of all muscles in every frame; see ``muscles.measure_muscles``."""
    osim = load_model(request)
    muscles = list_items(osim.getMuscles())
    paths = [find_path(muscle) for muscle in muscles]
    frames = len(next(iter(request["q"].values())))
    lengths, forces = np.zeros((frames, len(muscles))), np.zeros((frames, len(muscles), 0))
    if muscles and frames:
        posed = Posed(osim, request["q"])
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
    path = import_opensim().GeometryPath.safeDownCast(muscle.getComponent("path"))
    if path is None:
        raise ModelRefused(
            f"the path of muscle '{muscle.getName()}' is not made of points",
            field=muscle.getName(),
            remedy="Give a model whose muscles have a GeometryPath",
        )
    return path


class Posed:
    """A model that takes one pose after the other: ``q`` holds each coordinate's values, rad or m."""

    def __init__(self, osim: Any, q: abc.Mapping[str, abc.Sequence[float]]) -> None:
        for coordinate in list_items(osim.updCoordinateSet()):  # a pose is taken as it is
            coordinate.setDefaultClamped(False)
            coordinate.setDefaultLocked(False)
            coordinate.set_prescribed(False)
        self.osim, self.state = osim, osim.initSystem()
        self._q = [(osim.getCoordinateSet().get(name), values) for name, values in q.items()]
        rows = {}
        for name in q:
            # Where a coordinate's speed stands in the state
            coordinate = osim.getCoordinateSet().get(name)
            coordinate.setSpeedValue(self.state, 1.0)
            (row,) = np.flatnonzero(self.state.getU().to_numpy())
            coordinate.setSpeedValue(self.state, 0.0)
            rows[name] = int(row)
        self.rows = rows
        self.freedoms = self.state.getNU()
        self._links = osim.getBodySet().getSize() + 1  # a model is a tree: its bodies and the ground
        self._forces = import_opensim().Vector(self.freedoms, 0.0)

    def take(self, frame: int) -> None:
        """Take the pose of a frame."""
        for coordinate, values in self._q:
            coordinate.setValue(self.state, values[frame], False)
        self.osim.realizePosition(self.state)

    def forces_of(self, path: Any) -> Array:
        """The generalised forces of a unit tension, (n_freedoms,)."""
        library = import_opensim()
        none = library.SpatialVec(library.Vec3(0.0), library.Vec3(0.0))
        loads, direct = library.VectorOfSpatialVec(self._links, none), library.Vector(self.freedoms, 0.0)
        path.addInEquivalentForces(self.state, 1.0, loads, direct)
        self.osim.getMatterSubsystem().multiplyBySystemJacobianTranspose(self.state, loads, self._forces)
        forces: Array = self._forces.to_numpy() + direct.to_numpy()
        return forces


def list_points(request: abc.Mapping[str, Any]) -> dict[str, Any]:
    """Path points that are fixed in a body, and the surfaces of all bodies; see ``attachments``."""
    osim = load_model(request)
    points = [
        [muscle.getName(), number, *place_in_body(point.getParentFrame(), point.get_location())]
        for muscle, number, point in _list_fixed_points(osim)
    ]
    # Scale factors of a surface, and its rotation and origin in its body, m
    meshes = [
        [
            mesh.getFrame().findBaseFrame().getName(),
            mesh.get_mesh_file(),
            list_numbers(mesh.get_scale_factors()),
            *place_frame(mesh.getFrame()),
        ]
        for component in osim.getComponentsList()
        if (mesh := import_opensim().Mesh.safeDownCast(component)) is not None
    ]
    wraps = [
        [body.getName(), wrap.getName(), list_numbers(wrap.get_translation())]
        for body in list_items(osim.getBodySet())
        for wrap in list_items(body.getWrapObjectSet())
    ]
    return {"points": points, "meshes": meshes, "wraps": wraps}


def move_points(request: abc.Mapping[str, Any]) -> dict[str, Any]:
    """The text of a model with path points and wraps elsewhere; fibres and tendons grow as the paths do.

    As OpenSim's scaling has it: by the ratio of the whole path's lengths in the default pose. A muscle whose
    length changes by more than ``most`` runs along another side of a wrap: its points go back.
    """
    library, osim = import_opensim(), load_model(request)
    muscles = list_items(osim.getMuscles())
    kept = [[muscle, number, at] for muscle, number, _, at in list_points(request)["points"]]
    before = _measure_lengths(osim)
    for segment, name, at, size in request["wraps"]:
        # Elsewhere in its body, of a given size; its directions stay.
        wrap = osim.getBodySet().get(segment).getWrapObjectSet().get(name)
        wrap.set_translation(library.Vec3(*at))
        for kind, lengths in _LENGTHS.items():
            own = getattr(library, kind).safeDownCast(wrap)
            for length in lengths if own is not None else ():
                getattr(own, f"set_{length}")(size * getattr(own, f"get_{length}")())
        ellipsoid = library.WrapEllipsoid.safeDownCast(wrap)
        if ellipsoid is not None:
            dimensions = [size * number for number in list_numbers(ellipsoid.get_dimensions())]
            ellipsoid.set_dimensions(library.Vec3(*dimensions))
    _set_points(osim, request["moved"])
    change = np.abs(np.log(_measure_lengths(osim) / before))
    astray = {muscle.getName() for muscle, by in zip(muscles, change, strict=True) if by > request["most"]}
    _set_points(osim, [point for point in kept if point[0] in astray])
    for muscle, ratio in zip(muscles, _measure_lengths(osim) / before, strict=True):
        muscle.set_optimal_fiber_length(float(ratio) * muscle.get_optimal_fiber_length())
        muscle.set_tendon_slack_length(float(ratio) * muscle.get_tendon_slack_length())
    return {"text": _write(osim), "astray": sorted(astray)}


def set_lengths(request: abc.Mapping[str, Any]) -> dict[str, Any]:
    """The text of a model with other fibres and tendons; see ``muscles.set_parameters``."""
    osim = load_model(request)
    for name, (fibre, slack) in request["lengths"].items():
        muscle = osim.updMuscles().get(name)
        muscle.set_optimal_fiber_length(fibre)
        muscle.set_tendon_slack_length(slack)
    return {"text": _write(osim)}


def _write(osim: Any) -> str:
    osim.finalizeConnections()
    osim.printToXML("changed.osim")
    return Path("changed.osim").read_text(encoding="utf-8")


def _set_points(osim: Any, points: abc.Iterable[abc.Sequence[Any]]) -> None:
    """Put points of paths at their places in their bodies, m."""
    moved = {(muscle, number): np.array(at) for muscle, number, at in points}
    for muscle, number, point in _list_fixed_points(osim):
        at = moved.get((muscle.getName(), number))
        if at is not None:
            rotation, origin = map(np.array, place_frame(point.getParentFrame()))
            point.set_location(import_opensim().Vec3(*(rotation.T @ (at - origin))))


def load_model(request: abc.Mapping[str, Any]) -> Any:
    """The model whose text a request holds."""
    file = Path("asked.osim")  # in the worker's own scratch directory
    file.write_text(request["text"], encoding="utf-8")
    return load(file)


def _list_fixed_points(osim: Any) -> abc.Iterator[tuple[Any, int, Any]]:
    for muscle in list_items(osim.getMuscles()):
        for number, point in enumerate(list_items(find_path(muscle).updPathPointSet())):
            fixed = import_opensim().PathPoint.safeDownCast(point)
            if fixed is not None:
                yield muscle, number, fixed


def _measure_lengths(osim: Any) -> NDArray[np.float64]:
    state = osim.initSystem()
    return np.array([muscle.getLength(state) for muscle in list_items(osim.getMuscles())])
