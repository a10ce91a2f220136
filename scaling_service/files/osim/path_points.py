"""Where muscles are attached, which surfaces are drawn as bones, and attachments elsewhere (worker side)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scaling_service.files.osim.library import items, load, numbers, opensim
from scaling_service.files.osim.muscle_paths import find_path

_LENGTHS: Mapping[str, tuple[str, ...]] = {
    "WrapSphere": ("radius",),
    "WrapCylinder": ("radius", "length"),
    "WrapTorus": ("inner_radius", "outer_radius"),
}
"""Kinds of wraps, and their properties that are lengths."""


def list_points(request: Mapping[str, Any]) -> dict[str, Any]:
    """Path points that are fixed in a body, and the surfaces of all bodies; see ``attachments``."""
    osim = _loaded(request)
    points = [
        [muscle.getName(), number, *_in_body(point.getParentFrame(), point.get_location())]
        for muscle, number, point in _fixed_points(osim)
    ]
    meshes = [
        [mesh.getFrame().findBaseFrame().getName(), mesh.get_mesh_file(), *_placed(mesh)]
        for component in osim.getComponentsList()
        if (mesh := opensim().Mesh.safeDownCast(component)) is not None
    ]
    wraps = [
        [body.getName(), wrap.getName(), numbers(wrap.get_translation())]
        for body in items(osim.getBodySet())
        for wrap in items(body.getWrapObjectSet())
    ]
    return {"points": points, "meshes": meshes, "wraps": wraps}


def move_points(request: Mapping[str, Any]) -> dict[str, Any]:
    """The text of a model with path points and wraps elsewhere; fibres and tendons grow as the paths do.

    As OpenSim's scaling has it: by the ratio of the whole path's lengths in the default pose. A muscle whose
    length changes by more than ``most`` runs along another side of a wrap: its points go back.
    """
    osim = _loaded(request)
    muscles = items(osim.getMuscles())
    kept = [[muscle, number, at] for muscle, number, _, at in list_points(request)["points"]]
    before = _lengths(osim)
    for segment, name, at, size in request["wraps"]:
        _move_wrap(osim.getBodySet().get(segment).getWrapObjectSet().get(name), at, size)
    _set_points(osim, request["moved"])
    change = np.abs(np.log(_lengths(osim) / before))
    astray = {muscle.getName() for muscle, by in zip(muscles, change, strict=True) if by > request["most"]}
    _set_points(osim, [point for point in kept if point[0] in astray])
    for muscle, ratio in zip(muscles, _lengths(osim) / before, strict=True):
        muscle.set_optimal_fiber_length(float(ratio) * muscle.get_optimal_fiber_length())
        muscle.set_tendon_slack_length(float(ratio) * muscle.get_tendon_slack_length())
    osim.finalizeConnections()
    osim.printToXML("moved.osim")
    return {"text": Path("moved.osim").read_text(encoding="utf-8"), "astray": sorted(astray)}


def _set_points(osim: Any, points: Iterable[Sequence[Any]]) -> None:
    """Put points of paths at their places in their bodies, m."""
    moved = {(muscle, number): np.array(at) for muscle, number, at in points}
    for muscle, number, point in _fixed_points(osim):
        at = moved.get((muscle.getName(), number))
        if at is not None:
            rotation, origin = map(np.array, _place(point.getParentFrame()))
            point.set_location(opensim().Vec3(*(rotation.T @ (at - origin))))


def _move_wrap(wrap: Any, at: Sequence[float], size: float) -> None:
    """Put a wrap elsewhere in its body, as large as told; its directions stay."""
    wrap.set_translation(opensim().Vec3(*at))
    for kind, lengths in _LENGTHS.items():
        own = getattr(opensim(), kind).safeDownCast(wrap)
        for name in lengths if own is not None else ():
            getattr(own, f"set_{name}")(size * getattr(own, f"get_{name}")())
    ellipsoid = opensim().WrapEllipsoid.safeDownCast(wrap)
    if ellipsoid is not None:
        ellipsoid.set_dimensions(opensim().Vec3(*(size * n for n in numbers(ellipsoid.get_dimensions()))))


def _loaded(request: Mapping[str, Any]) -> Any:
    file = Path("points.osim")  # in the worker's own scratch directory
    file.write_text(request["text"], encoding="utf-8")
    return load(file)


def _fixed_points(osim: Any) -> Iterator[tuple[Any, int, Any]]:
    for muscle in items(osim.getMuscles()):
        for number, point in enumerate(items(find_path(muscle).updPathPointSet())):
            fixed = opensim().PathPoint.safeDownCast(point)
            if fixed is not None:
                yield muscle, number, fixed


def _in_body(frame: Any, at: Any) -> tuple[str, list[float]]:
    place = frame.findTransformInBaseFrame()
    return frame.findBaseFrame().getName(), numbers(place.shiftFrameStationToBase(at))


def _placed(mesh: Any) -> tuple[list[float], list[list[float]], list[float]]:
    """Scale factors of a surface, and its rotation and origin in its body, m."""
    return numbers(mesh.get_scale_factors()), *_place(mesh.getFrame())


def _place(frame: Any) -> tuple[list[list[float]], list[float]]:
    """A frame's rotation and origin in its body, m."""
    place = frame.findTransformInBaseFrame()
    return [[place.R().get(i, j) for j in range(3)] for i in range(3)], numbers(place.p())


def _lengths(osim: Any) -> NDArray[np.float64]:
    state = osim.initSystem()
    return np.array([muscle.getLength(state) for muscle in items(osim.getMuscles())])
