"""From a model that OpenSim has loaded to a body model (worker side)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import replace
from itertools import pairwise
from typing import Any, Literal, NamedTuple

import numpy as np

from scaling_service.core.errors import ModelRefused
from scaling_service.files.osim.joints import NotPolynomial, fit_piecewise, substitute
from scaling_service.files.osim.library import import_opensim, list_items, list_numbers
from scaling_service.model.body import (
    GROUND,
    BodyModel,
    Coordinate,
    Coupler,
    Joint,
    Law,
    Marker,
    Segment,
    Term,
    to_tensor,
    to_vector,
)
from scaling_service.numerics.multibody.rigid import convert_rotation_to_vector

Range = tuple[float, float]
Kind = Literal["rotation", "translation"]
Axis = tuple[Kind, Sequence[float], Law, bool]
"""What an axis of a joint does, its direction, its law, and whether it scales with the parent."""

_REMEDY = "Remove or replace it in the model"


def read_body_model(model: Any) -> BodyModel:
    """Everything of a connected OpenSim model that a body model holds.

    Raises ModelRefused: names the joint, constraint, coordinate or frame that cannot be represented.
    """
    ranges = {c.getName(): (c.getRangeMin(), c.getRangeMax()) for c in list_items(model.getCoordinateSet())}
    direct = {coupler.dependent: (name, coupler) for name, coupler in _list_couplers(model, ranges)}
    links = [_link(joint, ranges, direct.keys()) for joint in list_items(model.getJointSet())]
    coordinates = [
        _read_coordinate(c) for c in list_items(model.getCoordinateSet()) if c.getName() not in direct
    ]
    follows = {dependent: _resolve_coupler(dependent, direct) for dependent in direct}
    return BodyModel(
        name=model.getName(),
        segments=tuple(_substitute_coupler(segment, follows) for segment in _order_segments(model, links)),
        coordinates=tuple(coordinates),
        markers=tuple(_read_marker(marker) for marker in list_items(model.getMarkerSet())),
        couplers=tuple(follows.values()),
    )


_SPLINE_DEGREE: Mapping[str, Callable[[Any], int]] = {
    "SimmSpline": lambda _: 3,
    "PiecewiseLinearFunction": lambda _: 1,
    "GCVSpline": lambda function: int(function.getDegree()),
}

POLYNOMIAL_SPAN = (-math.pi, math.pi)
"""Where a polynomial of a coordinate without a finite range is centred (chosen: one turn); the fit reaches
one further turn to each side."""


def _read_law(function: Any, coordinate: str | None, ranges: Mapping[str, Range], component: str) -> Law:
    """A function of a coordinate (None where the component names none) as a law.

    Raises ModelRefused if the function is of another kind, or has no argument and is not constant.
    """
    kind = function.getConcreteClassName()
    library = import_opensim()
    if kind == "Constant":
        return Law.constant(library.Constant.safeDownCast(function).getValue())
    if kind == "MultiplierFunction":
        scaled = library.MultiplierFunction.safeDownCast(function)
        return _read_law(scaled.getFunction(), coordinate, ranges, component).scale(scaled.getScale())
    if coordinate is None:
        raise ModelRefused(
            f"the {kind} of '{component}' has no coordinate",
            field=component,
            remedy="Name the coordinate in <coordinates>, or use a Constant",
        )
    if kind == "LinearFunction":
        line = library.LinearFunction.safeDownCast(function)
        return Law.of(coordinate, line.getSlope(), line.getIntercept())
    if kind == "PolynomialFunction":
        polynomial = library.PolynomialFunction.safeDownCast(function)
        return _read_polynomial(polynomial, coordinate, ranges.get(coordinate, (0.0, 0.0)), component)
    if kind in _SPLINE_DEGREE:
        spline = getattr(library, kind).safeDownCast(function)
        return _read_spline(spline, _SPLINE_DEGREE[kind](spline), coordinate, component)
    raise ModelRefused(
        f"'{component}' uses a {kind}, which is no piecewise polynomial of one coordinate",
        field=component,
        remedy="Replace it by a SimmSpline, GCVSpline or PolynomialFunction",
    )


def _read_polynomial(function: Any, coordinate: str, span: Range, component: str) -> Law:
    coefficients = list_numbers(function.getCoefficients())
    while len(coefficients) > 1 and not coefficients[0]:
        coefficients.pop(0)
    if len(coefficients) <= 2:
        slope, offset = [0.0, *coefficients][-2:]
        return Law.of(coordinate, slope, offset) if slope else Law.constant(offset)
    lower, upper = span
    if not (math.isfinite(lower) and math.isfinite(upper) and 0.0 < upper - lower < 4.0 * math.pi):
        lower, upper = POLYNOMIAL_SPAN
    return _fit_law(function, [lower, upper], len(coefficients) - 1, coordinate, component)


def _read_spline(function: Any, degree: int, coordinate: str, component: str) -> Law:
    knots = [function.getX(k) for k in range(function.getSize())]
    if len(knots) < 2 or any(b <= a for a, b in pairwise(knots)):
        raise ModelRefused(
            f"the {function.getConcreteClassName()} of '{component}' needs at least two increasing knots",
            field=component,
            remedy="Sort the points and remove doubled ones",
        )
    return _fit_law(function, knots, degree, coordinate, component)


def _fit_law(function: Any, breaks: list[float], degree: int, coordinate: str, component: str) -> Law:
    library = import_opensim()
    try:
        shape = fit_piecewise(lambda x: float(function.calcValue(library.Vector(1, x))), breaks, degree)
    except NotPolynomial as error:
        raise ModelRefused(
            f"the {function.getConcreteClassName()} of '{component}' is {error}",
            field=component,
            remedy="Replace it by a SimmSpline through its values",
        ) from error
    return Law((Term(1.0, coordinate=coordinate, shape=shape),))


def _read_coordinate(coordinate: Any) -> Coordinate:
    default, locked = coordinate.getDefaultValue(), coordinate.getDefaultLocked()
    if coordinate.get_prescribed():
        function = coordinate.get_prescribed_function()
        constant = import_opensim().Constant.safeDownCast(function)
        if constant is None:
            raise ModelRefused(
                f"coordinate '{coordinate.getName()}' is prescribed by a {function.getConcreteClassName()}",
                field=coordinate.getName(),
                remedy="Set <prescribed> to false, or prescribe a Constant",
            )
        default, locked = constant.getValue(), True
    return Coordinate(
        name=coordinate.getName(),
        kind="rotation" if int(coordinate.getMotionType()) == _ROTATIONAL else "translation",
        default=default,
        lower=coordinate.getRangeMin(),
        upper=coordinate.getRangeMax(),
        clamped=coordinate.getDefaultClamped(),
        locked=locked,
    )


_ROTATIONAL = 1  # of OpenSim's motion types; 2 is translational, 3 coupled


def _read_marker(marker: Any) -> Marker:
    frame = marker.getParentFrame()
    in_body = frame.findTransformInBaseFrame().shiftFrameStationToBase(marker.get_location())
    body = frame.findBaseFrame().getName()
    return Marker.at(marker.getName(), body, to_vector(list_numbers(in_body)), anatomical=marker.get_fixed())


class _Link(NamedTuple):
    """An OpenSim joint: the bodies that it joins, and the moves that lead from the parent to the child."""

    name: str
    parent: str
    child: str
    chain: tuple[Joint, ...]


def _link(joint: Any, ranges: Mapping[str, Range], dependent: Set[str]) -> _Link:
    """Translations along axes fixed in the parent's joint frame, then body-fixed successive rotations.

    So Simbody's function-based mobilizer moves.
    """
    name = joint.getName()
    axes = _read_axes(joint, ranges)
    parent, outwards = _read_frame(joint.getParentFrame(), name)
    child, onwards = _read_frame(joint.getChildFrame(), name)
    moves = [_move(axis, parent, dependent) for axis in axes if axis[2].terms]
    moves.sort(key=lambda move: move.kind == "rotation")
    return _Link(name, parent, child, (*outwards, *moves, *_invert_chain(onwards)))


_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
_TURNS: tuple[tuple[Kind, Sequence[float]], ...] = (("rotation", _X), ("rotation", _Y), ("rotation", _Z))

_FIXED_JOINTS: Mapping[str, tuple[tuple[Kind, Sequence[float]], ...]] = {
    "WeldJoint": (),
    "PinJoint": _TURNS[2:],
    "SliderJoint": (("translation", _X),),
    "UniversalJoint": _TURNS[:2],
    "GimbalJoint": _TURNS,
    "BallJoint": _TURNS,
    "PlanarJoint": (*_TURNS[2:], ("translation", _X), ("translation", _Y)),
    "FreeJoint": (*_TURNS, ("translation", _X), ("translation", _Y), ("translation", _Z)),
}
"""The joints of fixed kind: for each of their coordinates, in order, what it does. Ball and free joints turn
by body-fixed x, y, z angles (Simbody's Euler mode, which OpenSim always chooses); translations act in the
parent's joint frame, before the rotations."""


def _read_axes(joint: Any, ranges: Mapping[str, Range]) -> list[Axis]:
    kind, name = joint.getConcreteClassName(), joint.getName()
    if kind == "CustomJoint":
        transform = import_opensim().CustomJoint.safeDownCast(joint).getSpatialTransform()
        return [_read_custom_axis(transform.getTransformAxis(k), k >= 3, ranges, name) for k in range(6)]
    if kind not in _FIXED_JOINTS:
        raise ModelRefused(f"joint '{name}' is a {kind}, which is not supported", field=name, remedy=_REMEDY)
    return [
        (what, axis, Law.of(joint.get_coordinates(k).getName()), False)
        for k, (what, axis) in enumerate(_FIXED_JOINTS[kind])
    ]


def _read_custom_axis(axis: Any, translates: bool, ranges: Mapping[str, Range], joint: str) -> Axis:
    names = axis.getCoordinateNamesInArray()
    if names.getSize() > 1:
        raise ModelRefused(
            f"joint '{joint}' uses a function of several coordinates", field=joint, remedy=_REMEDY
        )
    law = _read_law(axis.getFunction(), names.get(0) if names.getSize() else None, ranges, joint)
    kind: Kind = "translation" if translates else "rotation"
    return kind, list_numbers(axis.get_axis()), law, not is_pure(axis.getFunction())


def is_pure(function: Any) -> bool:
    """Whether a translation is its coordinate itself, which OpenSim's scaling leaves alone."""
    line = import_opensim().LinearFunction.safeDownCast(function)
    return line is not None and line.getSlope() == 1.0 and line.getIntercept() == 0.0


def _move(axis: Axis, parent: str, dependent: Set[str]) -> Joint:
    kind, along, law, scales = axis
    direction = np.array(along, dtype=float)
    # OpenSim scales the coupling of a dependent translation, and so the translation itself.
    scales = scales or any(term.coordinate in dependent for term in law.terms)
    follows_size = kind == "translation" and scales and parent != GROUND
    return Joint(
        kind, to_vector(direction / np.linalg.norm(direction)), law, parent if follows_size else None
    )


_NO_TURN = 1e-15
"""rad; a smaller constant rotation is rounding (chosen: below the spacing of numbers near one)."""


def _read_frame(frame: Any, component: str) -> tuple[str, tuple[Joint, ...]]:
    """The body under a frame, and the chain from it to the frame, through all offsets between."""
    offsets: list[Any] = []
    while (offset := import_opensim().PhysicalOffsetFrame.safeDownCast(frame)) is not None:
        offsets.insert(0, offset.getOffsetTransform())
        frame = offset.getParentFrame()
    body, kind = frame.getName(), frame.getConcreteClassName()
    if kind not in {"Body", "Ground"}:
        raise ModelRefused(
            f"'{component}' is attached to '{body}', a {kind}, which is not supported",
            field=component,
            remedy="Attach it to a body or to a PhysicalOffsetFrame",
        )
    return body, tuple(j for offset in offsets for j in _list_constant_moves(offset, body))


def _list_constant_moves(transform: Any, body: str) -> Iterator[Joint]:
    for axis, value in zip((_X, _Y, _Z), list_numbers(transform.p()), strict=True):
        if value:
            yield Joint("translation", axis, Law.constant(value), None if body == GROUND else body)
    matrix = transform.R()
    turn = convert_rotation_to_vector([[matrix.get(i, j) for j in range(3)] for i in range(3)])
    angle = float(np.linalg.norm(turn))
    if angle > _NO_TURN:
        yield Joint("rotation", to_vector(turn / angle), Law.constant(angle))


def _invert_chain(chain: Sequence[Joint]) -> tuple[Joint, ...]:
    """The chain that leads back."""
    return tuple(replace(joint, law=joint.law.scale(-1.0)) for joint in reversed(chain))


def _order_segments(model: Any, links: Sequence[_Link]) -> list[Segment]:
    """Segments in topological order: each joint is taken once the body on one side is reached."""
    bodies = {body.getName(): body for body in list_items(model.getBodySet())}
    waiting, reached = list(links), {GROUND}
    segments: list[Segment] = []
    while waiting:
        link = next((each for each in waiting if {each.parent, each.child} & reached), None)
        if link is None:
            raise _report_loose(waiting[0].child, waiting[0].name)
        waiting.remove(link)
        parent, child, chain = link.parent, link.child, link.chain
        if parent not in reached:
            parent, child, chain = child, parent, _invert_chain(chain)
        if child in reached:
            raise ModelRefused(
                f"joint '{link.name}' closes a loop",
                field=link.name,
                remedy="The model must be a tree: remove one of the loop's joints",
            )
        reached.add(child)
        body = bodies[child]
        com, inertia = (
            to_vector(list_numbers(body.get_mass_center())),
            to_tensor(list_numbers(body.get_inertia())),
        )
        segments.append(
            Segment(
                name=child,
                parent=parent,
                joint_name=link.name,
                joints=chain,
                mass=body.get_mass(),
                com=com,
                inertia=inertia,
            )
        )
    for name in bodies:
        if name not in reached:
            raise _report_loose(name, name)
    return segments


def _report_loose(body: str, component: str) -> ModelRefused:
    return ModelRefused(
        f"body '{body}' is not connected to ground by joints",
        field=component,
        remedy="Give it a joint (a FreeJoint to ground where it moves freely)",
    )


def _list_couplers(model: Any, ranges: Mapping[str, Range]) -> Iterator[tuple[str, Coupler]]:
    """Name and content of every constraint that is enforced."""
    for constraint in list_items(model.getConstraintSet()):
        if not constraint.get_isEnforced():
            continue
        name, kind = constraint.getName(), constraint.getConcreteClassName()
        coupler = import_opensim().CoordinateCouplerConstraint.safeDownCast(constraint)
        if coupler is None:
            raise ModelRefused(
                f"constraint '{name}' is a {kind}, which is not supported", field=name, remedy=_REMEDY
            )
        names = coupler.getIndependentCoordinateNames()
        if names.getSize() != 1:
            raise ModelRefused(
                f"constraint '{name}' couples to several coordinates", field=name, remedy=_REMEDY
            )
        law = _read_law(coupler.getFunction(), names.get(0), ranges, name)
        factor = import_opensim().PropertyHelper.getValueDouble(coupler.getPropertyByName("scale_factor"))
        yield name, Coupler(coupler.getDependentCoordinateName(), names.get(0), law.scale(factor))


def _resolve_coupler(dependent: str, direct: Mapping[str, tuple[str, Coupler]]) -> Coupler:
    """A coordinate's coupling to one that itself follows none."""
    name, coupler = direct[dependent]
    passed = {dependent}
    while (independent := coupler.independent) in direct:
        if independent in passed:
            raise ModelRefused(
                f"constraint '{name}' couples coordinates in a circle", field=name, remedy="Remove one"
            )
        passed.add(independent)
        inner = direct[independent][1]
        law = _substitute(coupler.law, independent, inner.law, name)
        coupler = Coupler(dependent, inner.independent, law)
    return coupler


def _substitute_coupler(segment: Segment, follows: Mapping[str, Coupler]) -> Segment:
    joints = []
    for joint in segment.joints:
        law = joint.law
        for coordinate in {t.coordinate for t in law.terms if t.coordinate in follows}:
            law = _substitute(law, str(coordinate), follows[str(coordinate)].law, segment.joint_name)
        joints.append(replace(joint, law=law))
    return replace(segment, joints=tuple(joints))


def _substitute(law: Law, coordinate: str, follows: Law, component: str) -> Law:
    try:
        return substitute(law, coordinate, follows)
    except NotPolynomial as error:
        raise ModelRefused(
            f"the coupled coordinate '{coordinate}' cannot be substituted in '{component}': {error}",
            field=component,
            remedy="Use functions of lower degree, such as piecewise linear ones, for the coupling",
        ) from error
