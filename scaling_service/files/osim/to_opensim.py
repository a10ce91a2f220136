"""From a body model to the text of an OpenSim file (worker side), checked by reading it back."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from scaling_service.core import errors
from scaling_service.core.arrays import Array
from scaling_service.files.osim import checks, from_opensim
from scaling_service.files.osim import joints as osim_joints
from scaling_service.files.osim.constraints import list_ends
from scaling_service.files.osim.digits import restore_digits
from scaling_service.files.osim.functions import make_function
from scaling_service.files.osim.library import (
    import_opensim,
    list_items,
    list_numbers,
    load,
    place_frame,
    put_back,
    shorten_message,
)
from scaling_service.model import body as bodies
from scaling_service.model.parameters import tilt_rotation
from scaling_service.numerics.multibody.rigid import convert_vector_to_rotation

_WRITTEN = "written.osim"  # in the worker's own scratch directory
_PURE_TURNS = frozenset({"PinJoint", "UniversalJoint", "GimbalJoint", "BallJoint"})


def write(model: bodies.BodyModel, request: Mapping[str, Any]) -> str:
    """The text of an ``.osim`` file; see ``models.write_osim`` for what is asked and refused."""
    checks.check_writable(model)
    osim = _amend_model(model, request) if request["file"] is not None else _build_model(model)
    # Ranges, defaults, clamping and locking of coordinates that drive something; prescribed ones stay.
    laws = [*(joint.law for _, joint in model.joints()), *(c.law for c in model.constraints)]
    used = {name for law in laws for name in law.coordinates}
    present = osim.updCoordinateSet()
    for item in model.coordinates:
        if item.name not in used:
            continue
        if not present.contains(item.name):
            raise errors.ModelRefused(
                f"the OpenSim model has no coordinate '{item.name}'",
                field=item.name,
                remedy="Write the model without a source, or without the added degree of freedom",
            )
        coordinate = present.get(item.name)
        if coordinate.get_prescribed():
            continue
        coordinate.set_range(0, item.lower if np.isfinite(item.lower) else -_open_end(item))
        coordinate.set_range(1, item.upper if np.isfinite(item.upper) else _open_end(item))
        coordinate.setDefaultValue(item.default)
        coordinate.setDefaultClamped(item.clamped)
        coordinate.setDefaultLocked(item.locked)
    # Exactly these markers, in this order
    library = import_opensim()
    osim.updMarkerSet().clearAndDestroy()
    for own in model.markers:
        if own.segment != bodies.GROUND and not osim.getBodySet().contains(own.segment):
            raise errors.ModelRefused(
                f"marker '{own.name}' sits on '{own.segment}', which the OpenSim model lacks",
                field=own.name,
                remedy="Use the names of the model's bodies",
            )
        marker = library.Marker(own.name, _make_body(osim, own.segment), library.Vec3(*own.nominal))
        marker.set_fixed(own.anatomical)
        _give(osim.addMarker, marker)
    osim.setName(re.sub(f"[{re.escape(checks.FORBIDDEN)}]", "_", model.name) or "model")
    checks.check_same(model, _write_and_check(osim, model))
    text = Path(_WRITTEN).read_text(encoding="utf-8")
    return text if request["file"] is None else put_back(text, Path(request["file"]))


def _write_and_check(osim: Any, model: bodies.BodyModel) -> bodies.BodyModel:
    """Write the file, and say what a fresh reading of it gives."""
    written = Path(_WRITTEN)
    try:
        osim.finalizeConnections()
        osim.printToXML(_WRITTEN)
        written.write_text(restore_digits(written.read_text(encoding="utf-8"), model), encoding="utf-8")
    except RuntimeError as error:
        raise errors.ModelRefused(
            f"OpenSim cannot write the model ({shorten_message(error)})", remedy="Check the model in OpenSim"
        ) from error
    try:
        return from_opensim.read_body_model(load(written))
    except errors.FileUnreadable as error:
        raise errors.ModelRefused(
            f"OpenSim does not read back what it wrote: {error.problem}",
            remedy="Check names, masses and inertias of the model",
        ) from error


def _amend_model(model: bodies.BodyModel, request: Mapping[str, Any]) -> Any:
    """The model of a file, scaled and turned; its inertias ours where asked."""
    osim = load(Path(request["file"]), request["marker_set"])
    factors = request["factors"]
    if factors or request["mass_kg"] is not None:
        _scale(osim, factors, request["mass_kg"], request["preserve_mass_distribution"])
    tilts, moves = request["axis_tilts"], request["joint_moves"]
    parents = {segment.joint_name: segment.parent for segment in model.segments}
    for joint, move in moves.items():
        _reseat(osim, joint, parents[joint], move)
    for joint in tilts | moves:
        turn = convert_vector_to_rotation(moves[joint]["turn"]) if joint in moves else np.eye(3)
        if joint in tilts or any(moves[joint]["turn"]):
            _tilt(osim, joint, turn @ tilt_rotation(tilts.get(joint, (0.0, 0.0))))
    if request["inertia_from_model"]:
        copies = _list_copies(osim)
        for segment in (s for s in model.segments if s.name not in copies):
            if not osim.getBodySet().contains(segment.name):
                raise errors.ModelRefused(
                    f"the source model has no body '{segment.name}'",
                    field=segment.name,
                    remedy="Write the model without a source",
                )
            _set_inertia(osim.updBodySet().get(segment.name), segment)
    return osim


def _scale(model: Any, factors: Mapping[str, Sequence[float]], mass_kg: float | None, preserve: bool) -> None:
    library = import_opensim()
    scales = library.ScaleSet()
    copies = _list_copies(model)
    for segment, xyz in factors.items():
        if segment in copies:
            continue
        if not model.getBodySet().contains(segment):
            raise errors.ModelRefused(
                f"there is a scale factor for '{segment}', which the model does not have",
                field=segment,
                remedy="Use the names of the model's bodies",
            )
        scale = library.Scale()
        scale.setSegmentName(segment)
        scale.setScaleFactors(library.Vec3(*xyz))
        scale.setApply(True)
        scales.cloneAndAppend(scale)
    # Custom joints' translations along axes that OpenSim does not scale component by component
    oblique = []
    cast = import_opensim().CustomJoint.safeDownCast
    customs = (cast(joint) for joint in list_items(model.getJointSet()))
    for joint in (custom for custom in customs if custom is not None):
        for number in (3, 4, 5):
            axis = joint.getSpatialTransform().getTransformAxis(number)
            along = sorted(map(abs, list_numbers(axis.get_axis())))
            if from_opensim.is_pure(axis.getFunction()) or along == [0.0, 0.0, 1.0]:
                continue
            multiplier = import_opensim().MultiplierFunction.safeDownCast(axis.getFunction())
            gain = multiplier.getScale() if multiplier is not None else 1.0
            oblique.append((joint.getName(), number, gain))
    ends = list_ends(model)
    try:
        model.scale(model.initSystem(), scales, preserve, mass_kg if mass_kg is not None else -1.0)
    except RuntimeError as error:
        raise errors.ModelRefused(
            f"OpenSim cannot scale the model ({shorten_message(error)})",
            remedy="Check the model in OpenSim's scale tool",
        ) from error
    for joint, number, gain in oblique:
        _scale_componentwise(model, factors, joint, number, gain)
    for frame, place, write in ends:
        body = frame.findBaseFrame().getName()
        moved = _to_vec3(place * np.array(factors.get(body, (1.0, 1.0, 1.0))))
        write(frame.findTransformInBaseFrame().shiftBaseStationToFrame(moved))


def _list_copies(model: Any) -> set[str]:
    """What copies of bodies would be called that joints carry in loops."""
    joints = list_items(model.getJointSet())
    ends = ((j.getName(), f.findBaseFrame()) for j in joints for f in (j.getParentFrame(), j.getChildFrame()))
    return {from_opensim.name_copy(body.getName(), joint) for joint, body in ends}


def _scale_componentwise(
    model: Any, factors: Mapping[str, Sequence[float]], name: str, number: int, gain: float
) -> None:
    """Replace OpenSim's scaling of an oblique translation, which is not one for factors of one."""
    joint = import_opensim().CustomJoint.safeDownCast(model.updJointSet().get(name))
    parent = joint.getParentFrame().findBaseFrame().getName()
    if parent not in factors:
        return
    axis = joint.updSpatialTransform().updTransformAxis(number)
    direction = np.array(list_numbers(axis.get_axis()))
    direction = direction / np.linalg.norm(direction) * factors[parent]
    length = float(np.linalg.norm(direction))
    import_opensim().MultiplierFunction.safeDownCast(axis.upd_function()).setScale(gain * length)
    axis.setAxis(_to_vec3(direction / length))


def _reseat(model: Any, name: str, parent: str, move: Mapping[str, Sequence[float]]) -> None:
    """Put a joint elsewhere in the bodies that it joins: on frames of its own, so that others keep theirs."""
    joint = model.updJointSet().get(name)
    back = convert_vector_to_rotation(move["child_turn"]).T  # the body turns, so the joint turns back in it
    for end, frame, connect in _list_joint_ends(joint):
        near = frame.findBaseFrame().getName() == parent
        turn, shift = (np.eye(3), np.array(move["shift"])) if near else (back, -back @ move["child_shift"])
        if not (shift.any() or (turn != np.eye(3)).any()):
            continue
        now, place = place_frame(frame)
        body = _make_body(model, frame.findBaseFrame().getName())
        moved = _make_offset(f"{name}_imaged_{end}", body, turn @ now)
        moved.set_translation(_to_vec3(turn @ place + shift))
        _give(joint.addFrame, moved)
        connect(moved)


def _list_joint_ends(joint: Any) -> list[tuple[str, Any, Callable[[Any], None]]]:
    """The frames that a joint joins, and how to join others."""
    return [
        ("parent", joint.getParentFrame(), joint.connectSocket_parent_frame),
        ("child", joint.getChildFrame(), joint.connectSocket_child_frame),
    ]


def _make_offset(name: str, base: Any, turn: Array) -> Any:
    """A frame turned in another."""
    frame = import_opensim().PhysicalOffsetFrame(base, import_opensim().Transform())
    frame.setName(name)
    frame.set_orientation(import_opensim().Vec3(*_to_euler_xyz(turn)))
    return frame


def _tilt(model: Any, name: str, turn: Array) -> None:
    """Turn a joint's rotation axes in the parent's joint frame."""
    library = import_opensim()
    if not model.getJointSet().contains(name):
        raise errors.ModelRefused(
            f"there is an axis tilt for '{name}', which the model does not have",
            field=name,
            remedy="Use the names of the model's joints",
        )
    joint = model.updJointSet().get(name)
    custom = library.CustomJoint.safeDownCast(joint)
    if custom is not None:
        transform = custom.updSpatialTransform()
        axes = [transform.updTransformAxis(k) for k in range(3)]
        moving = [k for k, axis in enumerate(axes) if axis.getCoordinateNamesInArray().getSize()]
        if not moving:
            raise _refuse_without_axis(custom.getName(), "CustomJoint")
        for k, axis in enumerate(axes):
            # An axis that never turns may go along, so that no two become parallel; one with a constant
            # turn before or after the moving ones keeps its direction.
            constant = import_opensim().Constant.safeDownCast(axis.getFunction())
            idle = constant is not None and constant.getValue() == 0.0
            if idle or moving[0] <= k <= moving[-1]:
                axis.setAxis(_to_vec3(turn @ list_numbers(axis.get_axis())))
    elif joint.getConcreteClassName() in _PURE_TURNS:
        # Both joint frames turned alike: frames within the present ones, so that others keep theirs.
        for end, frame, connect in _list_joint_ends(joint):
            turned = _make_offset(f"{joint.getName()}_tilted_{end}", frame, turn)
            _give(joint.addFrame, turned)
            connect(turned)
    else:
        raise _refuse_without_axis(name, joint.getConcreteClassName())


def _refuse_without_axis(name: str, kind: str) -> errors.ModelRefused:
    return errors.ModelRefused(
        f"joint '{name}', a {kind}, has no rotation axis that can be tilted",
        field=name,
        remedy="Tilt a PinJoint, UniversalJoint, GimbalJoint, BallJoint or CustomJoint",
    )


def _to_euler_xyz(r: Array) -> tuple[float, float, float]:
    """Body-fixed x, y, z angles of a rotation matrix, as OpenSim's orientations are given."""
    across = math.hypot(r[0, 0], r[0, 1])
    y = math.atan2(r[0, 2], across)
    if across < 1e-12:  # chosen: z and x turn about one axis, any split serves
        return math.atan2(r[2, 1], r[1, 1]), y, 0.0
    return math.atan2(-r[1, 2], r[2, 2]), y, math.atan2(-r[0, 1], r[0, 0])


def _set_inertia(body: Any, segment: bodies.Segment) -> None:
    body.set_mass(segment.mass)
    body.set_mass_center(import_opensim().Vec3(*segment.com))
    body.set_inertia(import_opensim().Vec6(*segment.inertia))


def _open_end(coordinate: bodies.Coordinate) -> float:
    """What stands for infinity (rad or m): OpenSim's own default where the range does not bind."""
    return 1000.0 if coordinate.clamped else 10.0  # chosen: 1000 is beyond any laboratory


def _make_body(osim: Any, name: str) -> Any:
    return osim.getGround() if name == bodies.GROUND else osim.getBodySet().get(name)


def _give(add: Callable[[Any], None], item: Any) -> None:
    """Add something to a model or a joint, which then deletes it."""
    add(item)
    item.thisown = False


def _build_model(model: bodies.BodyModel) -> Any:
    """Bodies, joints and couplers made anew."""
    joints, couplers = osim_joints.plan_joints(model)
    library = import_opensim()
    osim = library.Model()
    for segment in model.segments:
        body = library.Body()
        body.setName(segment.name)
        _set_inertia(body, segment)
        _give(osim.addBody, body)
    for joint in joints:
        _give(osim.addJoint, _make_joint(osim, joint))
    for item in couplers:
        coupler = library.CoordinateCouplerConstraint()
        coupler.setName(f"{item.dependent}_coupler")
        coupler.setIndependentCoordinateNames(_list_names(item.independent))
        coupler.setDependentCoordinateName(item.dependent)
        coupler.setFunction(library.LinearFunction(1.0, 0.0))
        _give(osim.addConstraint, coupler)
    try:
        osim.finalizeConnections()
    except RuntimeError as error:
        raise errors.ModelRefused(
            f"OpenSim does not accept the model ({shorten_message(error)})",
            remedy="Check masses, inertias and joint axes",
        ) from error
    return osim


def _list_names(name: str) -> Any:
    names = import_opensim().ArrayStr()
    names.append(name)
    return names


def _make_joint(osim: Any, joint: osim_joints.CustomJoint) -> Any:
    library = import_opensim()
    frames = (
        *_make_frame(_make_body(osim, joint.parent), joint.parent_offset),
        *_make_frame(_make_body(osim, joint.child), joint.child_offset),
    )
    if not joint.axes:
        return library.WeldJoint(joint.name, *frames)
    transform = library.SpatialTransform()
    for k, axis in enumerate(joint.axes):
        transform_axis = transform.updTransformAxis(k)
        transform_axis.setAxis(_to_vec3(axis.direction))
        if axis.coordinate is not None:
            transform_axis.setCoordinateNames(_list_names(axis.coordinate))
        transform_axis.set_function(make_function(axis.law))
    return library.CustomJoint(joint.name, *frames, transform)


def _make_frame(body: Any, offset: osim_joints.Offset) -> tuple[Any, Any, Any]:
    library = import_opensim()
    return body, _to_vec3(offset.shift), library.Vec3(*_to_euler_xyz(offset.rotation))


def _to_vec3(values: Array) -> Any:
    return import_opensim().Vec3(*(float(v) for v in values))
