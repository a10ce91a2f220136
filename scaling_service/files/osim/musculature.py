"""All of a model's muscles (worker side): path points, surfaces, parameters, and what they touch in poses."""

from __future__ import annotations

from collections import abc
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from scaling_service.core.errors import ModelRefused
from scaling_service.files.osim import chains, functions, muscle_paths
from scaling_service.files.osim.constraints import substitute_all
from scaling_service.files.osim.from_opensim import read_body_model
from scaling_service.files.osim.library import (
    import_opensim,
    list_items,
    list_numbers,
    list_rows,
    place_in_body,
)
from scaling_service.model import body as bodies
from scaling_service.model import muscles as model_muscles
from scaling_service.model.document import to_document

_SURFACES: abc.Mapping[str, tuple[model_muscles.SurfaceKind, tuple[str, ...]]] = {
    "WrapCylinder": ("cylinder", ("radius", "length")),
    "WrapSphere": ("sphere", ("radius",)),
    "WrapTorus": ("torus", ("inner_radius", "outer_radius")),
    "WrapEllipsoid": ("ellipsoid", ("dimensions",)),
}
"""Kinds of surfaces, and the properties that are their sizes."""

_SIDES = {"x": chains.X, "y": chains.Y, "z": chains.Z, "+x": chains.X, "+y": chains.Y, "+z": chains.Z} | {
    f"-{name}": tuple(-n for n in axis) for name, axis in (("x", chains.X), ("y", chains.Y), ("z", chains.Z))
}
"""Quadrants; ``all`` is no side."""

_RISE_S, _FALL_S = 0.010, 0.040
"""OpenSim 4.6's defaults of activation and deactivation, for muscles of kinds without them."""
_SPEED = 10.0  # optimal fibre lengths per second, OpenSim 4.6's default
_STEPS = 25  # of the passive fibre's curve; chosen: it is smooth


def describe(request: abc.Mapping[str, Any]) -> dict[str, Any]:
    """Muscles of a model and the surfaces they touch; see ``muscles.read_musculature``."""
    osim = muscle_paths.load_model(request)
    own, model = list_items(osim.getMuscles()), read_body_model(osim)
    paths = [muscle_paths.find_path(muscle) for muscle in own]
    movers = tuple(_list_movers(osim, own, model))
    surfaces = [
        asdict(_read_surface(wrap, body.getName()))
        for body in (osim.getGround(), *list_items(osim.getBodySet()))
        for wrap in list_items(body.getWrapObjectSet())
    ]
    muscles = [asdict(_read_muscle(muscle, path)) for muscle, path in zip(own, paths, strict=True)]
    moving = replace(model, segments=(*model.segments, *movers), markers=(), constraints=())
    contacts: list[list[list[dict[str, Any]]]] = []
    if any(muscle["surfaces"] for muscle in muscles):
        posed = muscle_paths.Posed(osim, request["q"])
        for frame in range(len(next(iter(request["q"].values())))):
            posed.take(frame)
            contacts.append([list(_list_contacts(path, posed.state)) for path in paths])
    return {
        "muscles": muscles,
        "surfaces": surfaces,
        "movers": [segment.name for segment in movers],
        "model": to_document(moving),
        "contacts": contacts,
    }


def _list_movers(osim: Any, muscles: list[Any], model: bodies.BodyModel) -> abc.Iterator[bodies.Segment]:
    """A segment without mass for each path point that moves in its segment."""
    ranges = {c.getName(): (c.getRangeMin(), c.getRangeMax()) for c in list_items(osim.getCoordinateSet())}
    follows = {c.dependent: c for c in model.couplers}
    for muscle in muscles:
        for k, point in enumerate(list_items(muscle_paths.find_path(muscle).getPathPointSet())):
            moving = import_opensim().MovingPathPoint.safeDownCast(point)
            if moving is None:
                continue
            if moving.getParentFrame().getName() != moving.getParentFrame().findBaseFrame().getName():
                raise ModelRefused(
                    f"'{point.getName()}' moves in a frame that is offset from its body",
                    field=point.getName(),
                    remedy="Put it into the body",
                )
            joints = []
            for word, axis in zip("xyz", (chains.X, chains.Y, chains.Z), strict=True):
                function = getattr(moving, f"get_{word}_location")()
                coordinates = [getattr(moving, f"get{word.upper()}Coordinate")().getName()]
                law = substitute_all(
                    functions.read_law(function, coordinates, ranges, moving.getName()), follows
                )
                if law.terms:
                    joints.append(bodies.Joint("translation", bodies.to_vector(axis), law))
            parent, name = moving.getParentFrame().getName(), model_muscles.name_point(muscle.getName(), k)
            yield bodies.Segment(name=name, parent=parent, joint_name=name, joints=tuple(joints))


def _read_surface(wrap: Any, segment: str) -> model_muscles.WrapSurface:
    name, kind = wrap.getName(), wrap.getConcreteClassName()
    if kind not in _SURFACES:
        raise ModelRefused(
            f"'{name}' is a {kind}", field=name, remedy="Replace it by a cylinder, sphere, ellipsoid or torus"
        )
    shape, names = _SURFACES[kind]
    own = getattr(import_opensim(), kind).safeDownCast(wrap)
    found = [getattr(own, f"get_{each}")() for each in names]
    sizes = list_numbers(found[0]) if shape == "ellipsoid" else found
    axes = [bodies.to_vector(row) for row in list_rows(wrap.getTransform().R())]
    side = _SIDES.get(wrap.get_quadrant().lower())
    return model_muscles.WrapSurface(
        name=name,
        kind=shape,
        segment=segment,
        origin=bodies.to_vector(list_numbers(wrap.get_translation())),
        axes=(axes[0], axes[1], axes[2]),
        sizes=tuple(float(size) for size in sizes),
        side=None if side is None else bodies.to_vector(side),
    )


def _read_muscle(muscle: Any, path: Any) -> model_muscles.Muscle:
    wraps = list_items(path.getWrapSet())

    def read(name: str, default: float) -> float:
        return functions.read_number(muscle, name) if muscle.hasProperty(name) else default

    strain, passive = _read_passive(muscle)
    return model_muscles.Muscle(
        name=muscle.getName(),
        points=tuple(
            _read_point(point, model_muscles.name_point(muscle.getName(), k))
            for k, point in enumerate(list_items(path.getPathPointSet()))
        ),
        surfaces=tuple(wrap.getWrapObjectName() for wrap in wraps),
        isometric_force=muscle.getMaxIsometricForce(),
        fibre=muscle.getOptimalFiberLength(),
        slack=muscle.getTendonSlackLength(),
        pennation=muscle.getPennationAngleAtOptimalFiberLength(),
        speed=read("max_contraction_velocity", _SPEED),
        rise=read("activation_time_constant", _RISE_S),
        fall=read("deactivation_time_constant", _FALL_S),
        damping=read("fiber_damping", 0.0),
        strain=strain,
        passive=passive,
    )


def _read_passive(muscle: Any) -> tuple[float, tuple[float, ...]]:
    """Strain of the fibre at one isometric force, and its force at equal steps up to there."""
    library = import_opensim()
    thelen = library.Thelen2003Muscle.safeDownCast(muscle)
    if thelen is not None:
        shape = thelen.get_KshapePassive()
        steps = np.expm1(shape * np.linspace(0.0, 1.0, _STEPS)) / np.expm1(shape)  # Thelen 2003, equation 3
        return float(thelen.get_FmaxMuscleStrain()), tuple(steps.tolist())
    millard = library.Millard2012EquilibriumMuscle.safeDownCast(muscle)
    curve = library.FiberForceLengthCurve() if millard is None else millard.get_FiberForceLengthCurve()
    strain = float(curve.get_strain_at_one_norm_force())
    return strain, tuple(curve.calcValue(1.0 + x) for x in np.linspace(0.0, strain, _STEPS).tolist())


def _read_point(point: Any, name: str) -> model_muscles.PathPoint:
    library = import_opensim()
    if library.MovingPathPoint.safeDownCast(point) is not None:
        return model_muscles.PathPoint(name=name, segment=name, at=(0.0, 0.0, 0.0))
    place = library.PathPoint.safeDownCast(point).get_location()
    segment, at = place_in_body(point.getParentFrame(), place)
    found = model_muscles.PathPoint(name=name, segment=segment, at=bodies.to_vector(at))
    conditional = library.ConditionalPathPoint.safeDownCast(point)
    if conditional is None:
        return found
    coordinate, lower, upper = conditional.getCoordinate(), conditional.get_range(0), conditional.get_range(1)
    return replace(found, coordinate=coordinate.getName(), lower=lower, upper=upper)


def _list_contacts(path: Any, state: Any) -> abc.Iterator[dict[str, Any]]:
    """The fields of each contact, in the order of the path."""
    library = import_opensim()
    names = {point.getName(): k for k, point in enumerate(list_items(path.getPathPointSet()))}
    current, number = path.getCurrentPath(state), 0
    entered: bodies.Vector | None = None
    for k in range(current.getSize()):
        point = current.get(k)
        touch = library.PathWrapPoint.safeDownCast(point)
        if touch is None:
            number = names[point.getName()]
            continue
        at = bodies.to_vector(list_numbers(point.getLocation(state)))
        if entered is None:
            entered = at
            continue
        along = touch.getWrapPath(state)
        half = along.size() // 2
        middle = bodies.to_vector(list_numbers(along.get(half))) if along.size() else at
        touched = {"surface": touch.getWrapObject().getName(), "after": number}
        yield touched | {"first": entered, "middle": middle, "last": at}
        entered = None
