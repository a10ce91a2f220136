"""A person's OpenSim model from a generic one, or from a plan of bodies and joints (worker side)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from scaling_service.core.errors import FileUnreadable, ModelRefused
from scaling_service.files.osim.library import items, load, numbers, opensim, short
from scaling_service.files.osim.worker_read import describe, is_pure
from scaling_service.numerics.multibody.rigid import rotation_about

_WRITTEN = "written.osim"  # in the worker's own scratch directory
_PURE_TURNS = frozenset({"PinJoint", "UniversalJoint", "GimbalJoint", "BallJoint"})


def amend(request: dict[str, Any]) -> dict[str, Any]:
    """Scale and edit the model in ``file``; answer with its text and its description read back."""
    model = load(Path(request["file"]), request.get("marker_set"))
    factors = request["factors"]
    if factors or request["mass_kg"] is not None:
        _scale(model, factors, request["mass_kg"], request["preserve_mass_distribution"])
    for joint, (x, y) in request["axis_tilts"].items():
        _tilt(model, joint, x, y)
    if request["bodies"] is not None:
        _set_inertia(model, request["bodies"])
    set_coordinates(model, request["coordinates"])
    set_markers(model, request["markers"])
    return written(model, request["name"])


def written(model: Any, name: str) -> dict[str, Any]:
    """The model's file content, and what a fresh reading of it gives."""
    model.setName(name)
    try:
        model.finalizeConnections()
        model.printToXML(_WRITTEN)
    except RuntimeError as error:
        raise ModelRefused(
            f"OpenSim cannot write the model ({short(error)})", remedy="Check the model in OpenSim"
        ) from error
    try:
        again = load(Path(_WRITTEN))
    except FileUnreadable as error:
        raise ModelRefused(
            f"OpenSim does not read back what it wrote: {error.problem}",
            remedy="Check names, masses and inertias of the model",
        ) from error
    return {"text": Path(_WRITTEN).read_text(encoding="utf-8"), "description": describe(again)}


def _scale(model: Any, factors: Mapping[str, Sequence[float]], mass_kg: float | None, preserve: bool) -> None:
    library = opensim()
    scales = library.ScaleSet()
    for segment, xyz in factors.items():
        if not model.getBodySet().contains(segment):
            raise ModelRefused(
                f"there is a scale factor for '{segment}', which the model does not have",
                field=segment,
                remedy="Use the names of the model's bodies",
            )
        scale = library.Scale()
        scale.setSegmentName(segment)
        scale.setScaleFactors(library.Vec3(*xyz))
        scale.setApply(True)
        scales.cloneAndAppend(scale)
    oblique = _oblique_translations(model)
    try:
        model.scale(model.initSystem(), scales, preserve, mass_kg if mass_kg is not None else -1.0)
    except RuntimeError as error:
        raise ModelRefused(
            f"OpenSim cannot scale the model ({short(error)})",
            remedy="Check the model in OpenSim's scale tool",
        ) from error
    for joint, number, gain in oblique:
        _scale_componentwise(model, factors, joint, number, gain)


def _custom_joints(model: Any) -> list[Any]:
    cast = opensim().CustomJoint.safeDownCast
    return [custom for joint in items(model.getJointSet()) if (custom := cast(joint)) is not None]


def _oblique_translations(model: Any) -> list[tuple[str, int, float]]:
    """Custom joints' translations along axes that OpenSim does not scale component by component."""
    found = []
    for joint in _custom_joints(model):
        for number in (3, 4, 5):
            axis = joint.getSpatialTransform().getTransformAxis(number)
            if is_pure(axis.getFunction()) or sorted(map(abs, numbers(axis.get_axis()))) == [0.0, 0.0, 1.0]:
                continue
            multiplier = opensim().MultiplierFunction.safeDownCast(axis.getFunction())
            gain = multiplier.getScale() if multiplier is not None else 1.0
            found.append((joint.getName(), number, gain))
    return found


def _scale_componentwise(
    model: Any, factors: Mapping[str, Sequence[float]], name: str, number: int, gain: float
) -> None:
    """Replace OpenSim's scaling of an oblique translation, which is not one for factors of one."""
    joint = opensim().CustomJoint.safeDownCast(model.updJointSet().get(name))
    parent = joint.getParentFrame().findBaseFrame().getName()
    if parent not in factors:
        return
    axis = joint.updSpatialTransform().updTransformAxis(number)
    direction = np.array(numbers(axis.get_axis()))
    direction = direction / np.linalg.norm(direction) * factors[parent]
    length = float(np.linalg.norm(direction))
    opensim().MultiplierFunction.safeDownCast(axis.upd_function()).setScale(gain * length)
    axis.setAxis(opensim().Vec3(*(float(v) for v in direction / length)))


def _tilt(model: Any, name: str, x: float, y: float) -> None:
    """Turn a joint's rotation axes by Ry(y) Rx(x) in the parent's joint frame."""
    library = opensim()
    if not model.getJointSet().contains(name):
        raise ModelRefused(
            f"there is an axis tilt for '{name}', which the model does not have",
            field=name,
            remedy="Use the names of the model's joints",
        )
    turn = rotation_about([0.0, 1.0, 0.0], y) @ rotation_about([1.0, 0.0, 0.0], x)
    joint = model.updJointSet().get(name)
    custom = library.CustomJoint.safeDownCast(joint)
    if custom is not None:
        _turn_custom_axes(custom, turn)
    elif joint.getConcreteClassName() in _PURE_TURNS:
        _insert_turned_frames(joint, turn)
    else:
        raise _no_axis(name, joint.getConcreteClassName())


def _no_axis(name: str, kind: str) -> ModelRefused:
    return ModelRefused(
        f"joint '{name}', a {kind}, has no rotation axis that can be tilted",
        field=name,
        remedy="Tilt a PinJoint, UniversalJoint, GimbalJoint, BallJoint or CustomJoint",
    )


def _turn_custom_axes(joint: Any, turn: np.ndarray[Any, Any]) -> None:
    transform = joint.updSpatialTransform()
    axes = [transform.updTransformAxis(k) for k in range(3)]
    moving = [k for k, axis in enumerate(axes) if axis.getCoordinateNamesInArray().getSize()]
    if not moving:
        raise _no_axis(joint.getName(), "CustomJoint")
    for k, axis in enumerate(axes):
        # An axis that never turns may go along, so that no two become parallel; one with a constant
        # turn before or after the moving ones keeps its direction.
        constant = opensim().Constant.safeDownCast(axis.getFunction())
        idle = constant is not None and constant.getValue() == 0.0
        if idle or moving[0] <= k <= moving[-1]:
            turned = turn @ numbers(axis.get_axis())
            axis.setAxis(opensim().Vec3(*(float(v) for v in turned)))


def _insert_turned_frames(joint: Any, turn: np.ndarray[Any, Any]) -> None:
    """Both joint frames turned alike: frames within the present ones, so that others keep theirs."""
    for end, frame, connect in (
        ("parent", joint.getParentFrame(), joint.connectSocket_parent_frame),
        ("child", joint.getChildFrame(), joint.connectSocket_child_frame),
    ):
        turned = opensim().PhysicalOffsetFrame(frame, opensim().Transform())
        turned.setName(f"{joint.getName()}_tilted_{end}")
        turned.set_orientation(opensim().Vec3(*euler_xyz(turn)))
        joint.addFrame(turned)
        turned.thisown = False  # the joint deletes it
        connect(turned)


def euler_xyz(rotation: Any) -> tuple[float, float, float]:
    """Body-fixed x, y, z angles of a rotation matrix, as OpenSim's orientations are given."""
    r = np.asarray(rotation, dtype=float)
    across = math.hypot(r[0, 0], r[0, 1])
    y = math.atan2(r[0, 2], across)
    if across < 1e-12:  # chosen: z and x turn about one axis, any split serves
        return math.atan2(r[2, 1], r[1, 1]), y, 0.0
    return math.atan2(-r[1, 2], r[2, 2]), y, math.atan2(-r[0, 1], r[0, 0])


def _set_inertia(model: Any, bodies: Sequence[Mapping[str, Any]]) -> None:
    for item in bodies:
        if not model.getBodySet().contains(item["name"]):
            raise ModelRefused(
                f"the source model has no body '{item['name']}'",
                field=item["name"],
                remedy="Write the model without a source",
            )
        body = model.updBodySet().get(item["name"])
        body.set_mass(item["mass"])
        body.set_mass_center(opensim().Vec3(*item["com"]))
        body.set_inertia(opensim().Vec6(*item["inertia"]))


def set_coordinates(model: Any, coordinates: Sequence[Mapping[str, Any]]) -> None:
    """Ranges, defaults, clamping and locking by name; prescribed coordinates are left alone."""
    present = model.updCoordinateSet()
    for item in coordinates:
        if not present.contains(item["name"]):
            raise ModelRefused(
                f"the OpenSim model has no coordinate '{item['name']}'",
                field=item["name"],
                remedy="Write the model without a source, or without the added degree of freedom",
            )
        coordinate = present.get(item["name"])
        if coordinate.get_prescribed():
            continue
        coordinate.set_range(0, item["lower"])
        coordinate.set_range(1, item["upper"])
        coordinate.setDefaultValue(item["default"])
        coordinate.setDefaultClamped(item["clamped"])
        coordinate.setDefaultLocked(item["locked"])


def set_markers(model: Any, markers: Sequence[Mapping[str, Any]]) -> None:
    """Exactly these markers, in this order."""
    library = opensim()
    model.updMarkerSet().clearAndDestroy()
    for item in markers:
        body = model.getGround()
        if item["body"] != "ground":
            if not model.getBodySet().contains(item["body"]):
                raise ModelRefused(
                    f"marker '{item['name']}' sits on '{item['body']}', which the OpenSim model lacks",
                    field=item["name"],
                    remedy="Use the names of the model's bodies",
                )
            body = model.getBodySet().get(item["body"])
        marker = library.Marker(item["name"], body, library.Vec3(*item["position"]))
        marker.set_fixed(item["fixed"])
        model.addMarker(marker)
        marker.thisown = False  # the model deletes it


def build(request: dict[str, Any]) -> dict[str, Any]:
    """Build the model; answer with its text and its description read back."""
    library = opensim()
    model = library.Model()
    for item in request["bodies"]:
        body = library.Body()
        body.setName(item["name"])
        body.set_mass(item["mass"])
        body.set_mass_center(library.Vec3(*item["com"]))
        body.set_inertia(library.Vec6(*item["inertia"]))
        model.addBody(body)
        body.thisown = False  # the model deletes it
    for item in request["joints"]:
        joint = _joint(model, item)
        model.addJoint(joint)
        joint.thisown = False
    for item in request["couplers"]:
        coupler = _coupler(item)
        model.addConstraint(coupler)
        coupler.thisown = False
    try:
        model.finalizeConnections()
    except RuntimeError as error:
        raise ModelRefused(
            f"OpenSim does not accept the model ({short(error)})",
            remedy="Check masses, inertias and joint axes",
        ) from error
    set_coordinates(model, request["coordinates"])
    set_markers(model, request["markers"])
    return written(model, request["name"])


def _coupler(item: Mapping[str, Any]) -> Any:
    """Keeps one coordinate equal to another."""
    library = opensim()
    coupler = library.CoordinateCouplerConstraint()
    coupler.setName(item["name"])
    independent = library.ArrayStr()
    independent.append(item["independent"])
    coupler.setIndependentCoordinateNames(independent)
    coupler.setDependentCoordinateName(item["dependent"])
    coupler.setFunction(library.LinearFunction(1.0, 0.0))
    return coupler


def _joint(model: Any, item: Mapping[str, Any]) -> Any:
    library = opensim()
    bodies = model.getBodySet()
    parent = model.getGround() if item["parent"] == "ground" else bodies.get(item["parent"])
    frames: list[Any] = []
    for body, offset in ((parent, item["parent_offset"]), (bodies.get(item["child"]), item["child_offset"])):
        frames += [body, library.Vec3(*offset["translation"]), library.Vec3(*euler_xyz(offset["rotation"]))]
    if not item["axes"]:
        return library.WeldJoint(item["name"], *frames)
    return library.CustomJoint(item["name"], *frames, _transform(item["axes"]))


def _transform(axes: Sequence[Mapping[str, Any]]) -> Any:
    library = opensim()
    transform = library.SpatialTransform()
    for k, item in enumerate(axes):
        axis = transform.updTransformAxis(k)
        axis.setAxis(library.Vec3(*item["axis"]))
        if item["coordinate"] is not None:
            names = library.ArrayStr()
            names.append(item["coordinate"])
            axis.setCoordinateNames(names)
        axis.set_function(_function(item["function"]))
    return transform


def _function(item: Mapping[str, Any]) -> Any:
    library = opensim()
    kind = item["kind"]
    if kind == "Constant":
        return library.Constant(item["value"])
    if kind == "LinearFunction":
        return library.LinearFunction(item["slope"], item["intercept"])
    if kind == "PolynomialFunction":
        coefficients = library.Vector(len(item["coefficients"]), 0.0)
        for k, value in enumerate(item["coefficients"]):
            coefficients.set(k, value)
        return library.PolynomialFunction(coefficients)
    spline = getattr(library, kind)()
    for x, y in zip(item["x"], item["y"], strict=True):
        spline.addPoint(x, y)
    return spline
