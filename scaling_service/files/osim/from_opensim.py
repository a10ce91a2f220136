"""From a model that OpenSim has loaded to a body model (worker side)."""

from __future__ import annotations

from collections import abc
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import numpy as np

from scaling_service.core.errors import ModelRefused
from scaling_service.files.osim import chains, functions, library
from scaling_service.files.osim import constraints as osim_constraints
from scaling_service.model import body as model_body

Kind = Literal["rotation", "translation"]
Axis = tuple[Kind, abc.Sequence[float], model_body.Law, bool]
"""What an axis of a joint does, its direction, its law, and whether it scales with the parent."""

_REMEDY = "Remove or replace it in the model"

_ROTATIONAL = 1  # of OpenSim's motion types; 2 is translational, 3 coupled

_TURNS: tuple[tuple[Kind, abc.Sequence[float]], ...] = (
    ("rotation", chains.X),
    ("rotation", chains.Y),
    ("rotation", chains.Z),
)

_SURFACE_JOINTS: abc.Mapping[str, abc.Callable[[Any, str | None, str | None], list[model_body.Joint]]] = {
    "EllipsoidJoint": chains.read_ellipsoid,
    "ScapulothoracicJoint": chains.read_scapulothoracic,
    "ConstantCurvatureJoint": chains.read_constant_curvature,
}

_FIXED_JOINTS: abc.Mapping[str, tuple[tuple[Kind, abc.Sequence[float]], ...]] = {
    "WeldJoint": (),
    "PinJoint": _TURNS[2:],
    "SliderJoint": (("translation", chains.X),),
    "UniversalJoint": _TURNS[:2],
    "GimbalJoint": _TURNS,
    "BallJoint": _TURNS,
    "PlanarJoint": (*_TURNS[2:], ("translation", chains.X), ("translation", chains.Y)),
    "FreeJoint": (*_TURNS, ("translation", chains.X), ("translation", chains.Y), ("translation", chains.Z)),
}
"""The joints of fixed kind: for each of their coordinates, in order, what it does. Ball and free joints turn
by body-fixed x, y, z angles (Simbody's Euler mode, which OpenSim always chooses); translations act in the
parent's joint frame, before the rotations."""


def read_body_model(model: Any) -> model_body.BodyModel:
    """Everything of a connected OpenSim model that a body model holds.

    Raises ModelRefused: names the joint, constraint, coordinate or frame that cannot be represented.
    """
    ranges = {
        c.getName(): (c.getRangeMin(), c.getRangeMax()) for c in library.list_items(model.getCoordinateSet())
    }
    direct: dict[str, tuple[str, model_body.Coupler]] = {}
    constraints: list[model_body.Constraint] = []
    for item in library.list_items(model.getConstraintSet()):
        if item.get_isEnforced():
            found = osim_constraints.read_constraint(item, ranges)
            if isinstance(found, model_body.Constraint):
                constraints.append(found)
            elif found.dependent in direct:
                constraints.append(osim_constraints.to_equation(item.getName(), found.dependent, found.law))
            else:
                direct[found.dependent] = (item.getName(), found)
    while True:
        links = [_link(joint, ranges, direct.keys()) for joint in library.list_items(model.getJointSet())]
        segments, welds = _order_segments(model, links)
        try:
            follows = {dependent: osim_constraints.resolve_coupler(dependent, direct) for dependent in direct}
            driven = tuple(osim_constraints.substitute_coupler(segment, follows) for segment in segments)
            bound = tuple(
                replace(c, law=osim_constraints.substitute_all(c.law, follows))
                for c in (*constraints, *welds)
            )
            break
        except osim_constraints.NotSubstituted as error:  # the coordinate stays, and an equation holds it
            name, coupler = direct.pop(error.coordinate)
            constraints.append(osim_constraints.to_equation(name, coupler.dependent, coupler.law))
    coordinates = [
        _read_coordinate(c) for c in library.list_items(model.getCoordinateSet()) if c.getName() not in direct
    ]
    couplers = []
    for c in follows.values():
        # What OpenSim counts a coordinate as, which decides its unit in motion files
        kind = int(model.getCoordinateSet().get(c.dependent).getMotionType())
        couplers.append(replace(c, kind="rotation" if kind == _ROTATIONAL else "translation"))
    markers = []
    for marker in library.list_items(model.getMarkerSet()):
        body, at = library.place_in_body(marker.getParentFrame(), marker.get_location())
        place = model_body.to_vector(at)
        markers.append(model_body.Marker.at(marker.getName(), body, place, anatomical=marker.get_fixed()))
    return model_body.BodyModel(
        name=model.getName(),
        segments=driven,
        coordinates=tuple(coordinates),
        markers=tuple(markers),
        couplers=tuple(couplers),
        constraints=bound,
        notes=tuple(_list_notes(model, bound)),
    )


def _list_notes(model: Any, followed: abc.Sequence[model_body.Constraint]) -> abc.Iterator[str]:
    """What of a model is taken otherwise than it stands in the file."""
    moved = [
        c.getName()
        for c in library.list_items(model.getCoordinateSet())
        if c.get_prescribed() and _find_prescribed(c) is None
    ]
    if moved:
        names = ", ".join(f"'{name}'" for name in moved)
        yield f"prescribed as functions of time, here estimated from markers: {names}"
    idle = [
        item.getName() for item in library.list_items(model.getConstraintSet()) if not item.get_isEnforced()
    ]
    if idle:
        yield f"constraints that the model does not enforce are left out: {', '.join(idle)}"
    if followed:
        names = ", ".join(item.name for item in followed)
        yield f"motions obey the model's constraints ({names}); joint moments leave out their forces"


def _read_coordinate(coordinate: Any) -> model_body.Coordinate:
    prescribed = _find_prescribed(coordinate)
    return model_body.Coordinate(
        name=coordinate.getName(),
        kind="rotation" if int(coordinate.getMotionType()) == _ROTATIONAL else "translation",
        default=coordinate.getDefaultValue() if prescribed is None else prescribed,
        lower=coordinate.getRangeMin(),
        upper=coordinate.getRangeMax(),
        clamped=coordinate.getDefaultClamped(),
        locked=prescribed is not None or coordinate.getDefaultLocked(),
    )


def _find_prescribed(coordinate: Any) -> float | None:
    """The value at which a coordinate is held; None where it is free, or prescribed by a function of time."""
    if not coordinate.get_prescribed():
        return None
    constant = library.import_opensim().Constant.safeDownCast(coordinate.get_prescribed_function())
    return None if constant is None else float(constant.getValue())


class _Link(NamedTuple):
    """An OpenSim joint: the bodies that it joins, and the moves that lead from the parent to the child."""

    name: str
    parent: str
    child: str
    chain: tuple[model_body.Joint, ...]


def _link(joint: Any, ranges: abc.Mapping[str, functions.Range], dependent: abc.Set[str]) -> _Link:
    """The moves between a joint's two frames, and between these and the bodies."""
    name = joint.getName()
    parent, outwards = chains.read_frame(joint.getParentFrame(), name)
    child, onwards = chains.read_frame(joint.getChildFrame(), name)
    kind = joint.getConcreteClassName()
    if kind in _SURFACE_JOINTS:
        moves = _SURFACE_JOINTS[kind](
            joint, *(None if body == model_body.GROUND else body for body in (parent, child))
        )
        return _Link(name, parent, child, (*outwards, *moves, *chains.invert_chain(onwards)))
    if kind == "CustomJoint":
        transform = library.import_opensim().CustomJoint.safeDownCast(joint).getSpatialTransform()
        axes: list[Axis] = []
        for k in range(6):
            axis = transform.getTransformAxis(k)
            law = functions.read_law(
                axis.getFunction(), functions.list_strings(axis.getCoordinateNamesInArray()), ranges, name
            )
            moves_by: Kind = "translation" if k >= 3 else "rotation"
            axes.append(
                (moves_by, library.list_numbers(axis.get_axis()), law, not is_pure(axis.getFunction()))
            )
    elif kind in _FIXED_JOINTS:
        axes = [
            (what, axis, model_body.Law.of(joint.get_coordinates(k).getName()), False)
            for k, (what, axis) in enumerate(_FIXED_JOINTS[kind])
        ]
    else:
        raise ModelRefused(f"joint '{name}' is a {kind}, which is not supported", field=name, remedy=_REMEDY)
    # Translations along axes fixed in the parent's joint frame, then body-fixed successive rotations: so
    # Simbody's function-based mobilizer moves.
    moves = []
    for what, along, law, scales in axes:
        if law.terms:
            direction = np.array(along, dtype=float)
            # OpenSim scales the coupling of a dependent translation, and so the translation itself.
            scaled = scales or any(term.coordinate in dependent for term in law.terms)
            follows = parent if what == "translation" and scaled and parent != model_body.GROUND else None
            moves.append(
                model_body.Joint(
                    what, model_body.to_vector(direction / np.linalg.norm(direction)), law, follows
                )
            )
    moves.sort(key=lambda move: move.kind == "rotation")
    return _Link(name, parent, child, (*outwards, *moves, *chains.invert_chain(onwards)))


def is_pure(function: Any) -> bool:
    """Whether a translation is its coordinate itself, which OpenSim's scaling leaves alone."""
    line = library.import_opensim().LinearFunction.safeDownCast(function)
    return line is not None and line.getSlope() == 1.0 and line.getIntercept() == 0.0


def name_copy(body: str, joint: str) -> str:
    """What the massless copy of a body is called that a joint carries in a loop."""
    return f"{body}_of_{joint}"


def _order_segments(
    model: Any, links: abc.Sequence[_Link]
) -> tuple[list[model_body.Segment], list[model_body.Constraint]]:
    """Segments in topological order: each joint is taken once the body on one side is reached.

    A joint that closes a loop carries a massless copy of its body, welded to it, as OpenSim does it.
    """
    bodies = {body.getName(): body for body in library.list_items(model.getBodySet())}
    waiting, reached = list(links), {model_body.GROUND}
    segments: list[model_body.Segment] = []
    welds: list[model_body.Constraint] = []
    while waiting:
        link = next((each for each in waiting if {each.parent, each.child} & reached), None)
        if link is None:
            raise _report_loose(waiting[0].child, waiting[0].name)
        waiting.remove(link)
        parent, child, chain = link.parent, link.child, link.chain
        if parent not in reached:
            parent, child, chain = child, parent, chains.invert_chain(chain)
        if child in reached:
            copy = name_copy(child, link.name)
            ends = tuple(model_body.Marker.at(link.name, name, (0.0, 0.0, 0.0)) for name in (copy, child))
            welds.append(model_body.Constraint(name=link.name, kind="weld", ends=ends))
            segments.append(model_body.Segment(name=copy, parent=parent, joint_name=link.name, joints=chain))
            continue
        reached.add(child)
        body = bodies[child]
        segments.append(
            model_body.Segment(
                name=child,
                parent=parent,
                joint_name=link.name,
                joints=chain,
                mass=body.get_mass(),
                com=model_body.to_vector(library.list_numbers(body.get_mass_center())),
                inertia=model_body.to_tensor(library.list_numbers(body.get_inertia())),
            )
        )
    for name in bodies:
        if name not in reached:
            raise _report_loose(name, name)
    return segments, welds


def _report_loose(body: str, component: str) -> ModelRefused:
    return ModelRefused(
        f"body '{body}' is not connected to ground by joints",
        field=component,
        remedy="Give it a joint (a FreeJoint to ground where it moves freely)",
    )
