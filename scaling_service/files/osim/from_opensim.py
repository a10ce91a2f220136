"""From a model that OpenSim has loaded to a body model (worker side)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import replace
from itertools import pairwise, product
from typing import Any, Literal, NamedTuple

import numpy as np

from scaling_service.core.errors import ModelRefused
from scaling_service.files.osim.joints import REACH, NotPolynomial, fit_piecewise, substitute
from scaling_service.files.osim.library import import_opensim, list_items, list_numbers
from scaling_service.model.body import (
    GROUND,
    BodyModel,
    Constraint,
    Coordinate,
    Coupler,
    Joint,
    Law,
    Marker,
    Segment,
    Surface,
    Term,
    Vector,
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
    direct: dict[str, tuple[str, Coupler]] = {}
    constraints: list[Constraint] = []
    for item in list_items(model.getConstraintSet()):
        if item.get_isEnforced():
            coupled = item.getConcreteClassName() == "CoordinateCouplerConstraint"
            found = _read_coupler(item, ranges) if coupled else _read_constraint(item)
            if isinstance(found, Constraint):
                constraints.append(found)
            else:
                direct[found.dependent] = (item.getName(), found)
    while True:
        links = [_link(joint, ranges, direct.keys()) for joint in list_items(model.getJointSet())]
        segments, welds = _order_segments(model, links)
        try:
            follows = {dependent: _resolve_coupler(dependent, direct) for dependent in direct}
            driven = tuple(_substitute_coupler(segment, follows) for segment in segments)
            bound = tuple(replace(c, law=_substitute_all(c.law, follows)) for c in (*constraints, *welds))
            break
        except _NotSubstituted as error:  # the coordinate stays, and an equation holds it
            name, coupler = direct.pop(error.coordinate)
            law = Law.of(coupler.dependent) + coupler.law.scale(-1.0)
            constraints.append(Constraint(name=name, kind="law", law=law))
    coordinates = [
        _read_coordinate(c) for c in list_items(model.getCoordinateSet()) if c.getName() not in direct
    ]
    return BodyModel(
        name=model.getName(),
        segments=driven,
        coordinates=tuple(coordinates),
        markers=tuple(_read_marker(marker) for marker in list_items(model.getMarkerSet())),
        couplers=tuple(follows.values()),
        constraints=bound,
        notes=tuple(_note_constraints(model, bound)),
    )


def _note_constraints(model: Any, followed: Sequence[Constraint]) -> Iterator[str]:
    idle = [item.getName() for item in list_items(model.getConstraintSet()) if not item.get_isEnforced()]
    if idle:
        yield f"constraints that the model does not enforce are left out: {', '.join(idle)}"
    if followed:
        names = ", ".join(item.name for item in followed)
        yield f"motions obey the model's constraints ({names}); joint moments leave out their forces"


class _NotSubstituted(Exception):
    """A coordinate enters something in which the law that it follows cannot be put in its place."""

    def __init__(self, coordinate: str) -> None:
        super().__init__(coordinate)
        self.coordinate = coordinate


_SPLINE_DEGREE: Mapping[str, Callable[[Any], int]] = {
    "SimmSpline": lambda _: 3,
    "PiecewiseLinearFunction": lambda _: 1,
    "GCVSpline": lambda function: int(function.getDegree()),
}

POLYNOMIAL_SPAN = (-math.pi, math.pi)
"""Where a polynomial of a coordinate without a finite range is centred (chosen: one turn); the fit reaches
one further turn to each side."""


def _read_law(function: Any, coordinates: Sequence[str], ranges: Mapping[str, Range], component: str) -> Law:
    """A function of coordinates (none where the component names none) as a law.

    Raises ModelRefused if the function is of another kind, or has no argument and is not constant.
    """
    kind = function.getConcreteClassName()
    library = import_opensim()
    if kind == "Constant":
        return Law.constant(library.Constant.safeDownCast(function).getValue())
    if kind == "MultiplierFunction":
        scaled = library.MultiplierFunction.safeDownCast(function)
        return _read_law(scaled.getFunction(), coordinates, ranges, component).scale(scaled.getScale())
    if not coordinates:
        raise ModelRefused(
            f"the {kind} of '{component}' has no coordinate",
            field=component,
            remedy="Name the coordinate in <coordinates>, or use a Constant",
        )
    if kind == "LinearFunction":
        numbers = library.LinearFunction.safeDownCast(function).getCoefficients()
        *slopes, offset = (numbers.get(k) for k in range(numbers.getSize()))
        terms = (Term(slope, coordinate=c) for slope, c in zip(slopes, coordinates, strict=False) if slope)
        return Law(tuple(terms)) + Law.constant(offset)
    if kind == "MultivariatePolynomialFunction":
        polynomial = library.MultivariatePolynomialFunction.safeDownCast(function)
        return _read_multivariate(polynomial, coordinates)
    coordinate = coordinates[0]
    span = ranges.get(coordinate, (0.0, 0.0))
    if len(coordinates) > 1:
        raise ModelRefused(
            f"the {kind} of '{component}' is given several coordinates",
            field=component,
            remedy="Use a LinearFunction or a MultivariatePolynomialFunction",
        )
    if kind == "PolynomialFunction":
        polynomial = library.PolynomialFunction.safeDownCast(function)
        return _read_polynomial(polynomial, coordinate, span, component)
    if kind in _SPLINE_DEGREE:
        spline = getattr(library, kind).safeDownCast(function)
        return _read_spline(spline, _SPLINE_DEGREE[kind](spline), coordinate, component)
    if kind == "StepFunction":
        step = library.StepFunction.safeDownCast(function)
        return _fit_law(
            function, [step.getStartTime(), step.getEndTime()], _STEP_DEGREE, coordinate, component
        )
    # any other is followed in pieces so short that it is smooth within each
    lower, upper = span if _is_range(span) else POLYNOMIAL_SPAN
    breaks = [float(x) for x in np.linspace(lower - REACH, upper + REACH, _PIECES + 1)]
    return _fit_law(function, breaks, _PIECE_DEGREE, coordinate, component, follow_ends=False)


_STEP_DEGREE = 5  # of SimTK's step
_PIECES, _PIECE_DEGREE = 128, 9  # chosen: sines of up to ten turns a turn are met to EXACT


def _read_number(thing: Any, name: str) -> float:
    return float(import_opensim().PropertyHelper.getValueDouble(thing.getPropertyByName(name)))


def _read_multivariate(polynomial: Any, coordinates: Sequence[str]) -> Law:
    """One term for each product of powers; the last coordinate's power grows first."""
    order = polynomial.getOrder()
    powers = [e for e in product(range(order + 1), repeat=len(coordinates)) if sum(e) <= order]
    law = Law()
    for gain, exponents in zip(list_numbers(polynomial.getCoefficients()), powers, strict=True):
        if gain:
            law = law + _multiply_powers(gain, coordinates, exponents)
    return law


def _multiply_powers(gain: float, coordinates: Sequence[str], exponents: Sequence[int]) -> Law:
    used = {c: e for c, e in zip(coordinates, exponents, strict=True) if e}
    if not used:
        return Law.constant(gain)
    if list(used.values()) == [1]:
        return Law((Term(gain, coordinate=next(iter(used))),))
    return Law((Term(gain, surface=Surface("powers", tuple(used), tuple(map(float, used.values())))),))


def _read_polynomial(function: Any, coordinate: str, span: Range, component: str) -> Law:
    coefficients = list_numbers(function.getCoefficients())
    while len(coefficients) > 1 and not coefficients[0]:
        coefficients.pop(0)
    if len(coefficients) <= 2:
        slope, offset = [0.0, *coefficients][-2:]
        return Law.of(coordinate, slope, offset) if slope else Law.constant(offset)
    lower, upper = span if _is_range(span) else POLYNOMIAL_SPAN
    return _fit_law(function, [lower, upper], len(coefficients) - 1, coordinate, component)


def _is_range(span: Range) -> bool:
    lower, upper = span
    return math.isfinite(lower) and math.isfinite(upper) and 0.0 < upper - lower < 4.0 * math.pi


def _read_spline(function: Any, degree: int, coordinate: str, component: str) -> Law:
    knots = [function.getX(k) for k in range(function.getSize())]
    if len(knots) < 2 or any(b <= a for a, b in pairwise(knots)):
        raise ModelRefused(
            f"the {function.getConcreteClassName()} of '{component}' needs at least two increasing knots",
            field=component,
            remedy="Sort the points and remove doubled ones",
        )
    return _fit_law(function, knots, degree, coordinate, component)


def _fit_law(
    function: Any,
    breaks: list[float],
    degree: int,
    coordinate: str,
    component: str,
    *,
    follow_ends: bool = True,
) -> Law:
    library = import_opensim()
    try:
        shape = fit_piecewise(
            lambda x: float(function.calcValue(library.Vector(1, x))), breaks, degree, follow_ends=follow_ends
        )
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
    """The moves between a joint's two frames, and between these and the bodies."""
    name = joint.getName()
    parent, outwards = _read_frame(joint.getParentFrame(), name)
    child, onwards = _read_frame(joint.getChildFrame(), name)
    kind = joint.getConcreteClassName()
    if kind in _SURFACE_JOINTS:
        moves = _SURFACE_JOINTS[kind](joint, *(None if body == GROUND else body for body in (parent, child)))
    else:
        moves = _read_moves(joint, parent, ranges, dependent)
    return _Link(name, parent, child, (*outwards, *moves, *_invert_chain(onwards)))


def _read_moves(joint: Any, parent: str, ranges: Mapping[str, Range], dependent: Set[str]) -> list[Joint]:
    """Translations along axes fixed in the parent's joint frame, then body-fixed successive rotations.

    So Simbody's function-based mobilizer moves.
    """
    axes = _read_axes(joint, ranges)
    moves = [_move(axis, parent, dependent) for axis in axes if axis[2].terms]
    return sorted(moves, key=lambda move: move.kind == "rotation")


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
    law = _read_law(axis.getFunction(), _list_strings(axis.getCoordinateNamesInArray()), ranges, joint)
    kind: Kind = "translation" if translates else "rotation"
    return kind, list_numbers(axis.get_axis()), law, not is_pure(axis.getFunction())


def _list_strings(names: Any) -> list[str]:
    return [names.get(k) for k in range(names.getSize())]


def _read_ellipsoid(joint: Any, parent: str | None, _: str | None) -> list[Joint]:
    """The child glides on an ellipsoid of the parent, its z axis along the normal of the unit sphere."""
    radii = list_numbers(import_opensim().EllipsoidJoint.safeDownCast(joint).get_radii_x_y_z())
    names = _list_coordinates(joint)
    turns = [Joint("rotation", axis, Law.of(name)) for axis, name in zip((_X, _Y, _Z), names, strict=True)]
    return [*_glide(names, "xyz", (_X, _Y, _Z), radii, parent), *turns]


def _read_scapulothoracic(joint: Any, parent: str | None, child: str | None) -> list[Joint]:
    """An ellipsoid joint a quarter turn about z off the joint frames, then a hinge in the tangent plane.

    Seth et al. 2016, PLoS ONE 11:e0141028.
    """
    own = import_opensim().ScapulothoracicJoint.safeDownCast(joint)
    across, along, through = list_numbers(own.get_thoracic_ellipsoid_radii_x_y_z())
    *names, winging = _list_coordinates(joint)
    quarter = Joint("rotation", _Z, Law.constant(0.5 * math.pi))
    turns = [Joint("rotation", axis, Law.of(name)) for axis, name in zip((_X, _Y, _Z), names, strict=True)]
    to_hinge = [
        Joint("translation", axis, Law.constant(own.get_scapula_winging_axis_origin(k)), child)
        for k, axis in enumerate((_X, _Y))
    ]
    slant = own.get_scapula_winging_axis_direction()
    hinge = Joint("rotation", (-math.sin(slant), math.cos(slant), 0.0), Law.of(winging))
    # x and y of the turned frame are y and -x of the joint's
    glide = _glide(names, "yxz", (_X, _Y, _Z), (-across, along, through), parent)
    back = (*_invert_chain([quarter]), *to_hinge, hinge, *_invert_chain(to_hinge))
    return [*glide, quarter, *turns, *back]


def _glide(
    names: Sequence[str],
    components: str,
    axes: Sequence[tuple[float, float, float]],
    radii: Sequence[float],
    parent: str | None,
) -> list[Joint]:
    surfaces: dict[str, Surface] = {
        "x": Surface("normal_x", tuple(names[:2])),
        "y": Surface("normal_y", tuple(names[:2])),
        "z": Surface("normal_z", tuple(names[:2])),
    }
    return [
        Joint("translation", axis, Law((Term(radius, surface=surfaces[letter]),)), parent)
        for letter, axis, radius in zip(components, axes, radii, strict=True)
    ]


def _read_constant_curvature(joint: Any, _: str | None, child: str | None) -> list[Joint]:
    """An arc that leaves the parent along y and arrives in the child along y, then turned about it.

    OpenSim takes the end of the arc's chord where it bends by less than 0.001 or more than 1.53 rad, and
    leaves it unturned within the bound of 1.56 rad; here it stays an arc.
    """
    own = import_opensim().ConstantCurvatureJoint.safeDownCast(joint)
    x, z, y = list_numbers(own.get_neutral_angle_x_z_y())
    names = _list_coordinates(joint)
    bent = tuple(names[:2])
    surfaces = (
        Surface("arc_x", bent, (x, z)),
        Surface("arc_y", bent, (x, z)),
        Surface("arc_z", bent, (x, z)),
    )
    moves = [
        Joint("translation", axis, Law((Term(own.get_length(), surface=surface),)), child, _Y)
        for axis, surface in zip((_X, _Y, _Z), surfaces, strict=True)
    ]
    turns = zip((_X, _Z, _Y), names, (x, z, y), strict=True)
    return [*moves, *(Joint("rotation", axis, Law.of(name, offset=angle)) for axis, name, angle in turns)]


def _list_coordinates(joint: Any) -> list[str]:
    return [joint.get_coordinates(k).getName() for k in range(joint.numCoordinates())]


_SURFACE_JOINTS: Mapping[str, Callable[[Any, str | None, str | None], list[Joint]]] = {
    "EllipsoidJoint": _read_ellipsoid,
    "ScapulothoracicJoint": _read_scapulothoracic,
    "ConstantCurvatureJoint": _read_constant_curvature,
}


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


def name_copy(body: str, joint: str) -> str:
    """What the massless copy of a body is called that a joint carries in a loop."""
    return f"{body}_of_{joint}"


def _order_segments(model: Any, links: Sequence[_Link]) -> tuple[list[Segment], list[Constraint]]:
    """Segments in topological order: each joint is taken once the body on one side is reached.

    A joint that closes a loop carries a massless copy of its body, welded to it, as OpenSim does it.
    """
    bodies = {body.getName(): body for body in list_items(model.getBodySet())}
    waiting, reached = list(links), {GROUND}
    segments: list[Segment] = []
    welds: list[Constraint] = []
    while waiting:
        link = next((each for each in waiting if {each.parent, each.child} & reached), None)
        if link is None:
            raise _report_loose(waiting[0].child, waiting[0].name)
        waiting.remove(link)
        parent, child, chain = link.parent, link.child, link.chain
        if parent not in reached:
            parent, child, chain = child, parent, _invert_chain(chain)
        if child in reached:
            copy = name_copy(child, link.name)
            ends = tuple(Marker.at(link.name, name, (0.0, 0.0, 0.0)) for name in (copy, child))
            welds.append(Constraint(name=link.name, kind="weld", ends=ends))
            segments.append(Segment(name=copy, parent=parent, joint_name=link.name, joints=chain))
            continue
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
    return segments, welds


def _report_loose(body: str, component: str) -> ModelRefused:
    return ModelRefused(
        f"body '{body}' is not connected to ground by joints",
        field=component,
        remedy="Give it a joint (a FreeJoint to ground where it moves freely)",
    )


def _read_coupler(constraint: Any, ranges: Mapping[str, Range]) -> Coupler | Constraint:
    """A coordinate that follows one other, or an equation between several."""
    name = constraint.getName()
    coupler = import_opensim().CoordinateCouplerConstraint.safeDownCast(constraint)
    names, dependent = (
        _list_strings(coupler.getIndependentCoordinateNames()),
        coupler.getDependentCoordinateName(),
    )
    law = _read_law(coupler.getFunction(), names, ranges, name).scale(_read_number(coupler, "scale_factor"))
    if len(law.coordinates) <= 1:
        return Coupler(dependent, next(iter(law.coordinates), names[0]), law)
    return Constraint(name=name, kind="law", law=Law.of(dependent) + law.scale(-1.0))


def _read_constraint(constraint: Any) -> Constraint:
    """A constraint between bodies.

    ModelRefused: of a kind that no equation between points says.
    """
    name, kind = constraint.getName(), constraint.getConcreteClassName()
    library = import_opensim()
    if kind == "WeldConstraint":
        weld = library.WeldConstraint.safeDownCast(constraint)
        places = [_find_in_body(frame, name) for frame in (weld.getFrame1(), weld.getFrame2())]
        ends = tuple(Marker.at(name, body, shift) for body, shift, _ in places)
        return Constraint(name=name, kind="weld", ends=ends, turns=(places[0][2], places[1][2]))
    if kind not in POINTS:
        raise ModelRefused(
            f"constraint '{name}' is a {kind}, which is not supported", field=name, remedy=_REMEDY
        )
    own = getattr(library, kind).safeDownCast(constraint)
    frames = list_end_frames(constraint)
    ends = tuple(_read_end(name, frame, getattr(own, f"get_{place}")()) for frame, place in frames)
    found = Constraint(name=name, kind=POINTS[kind][0], ends=ends)
    if kind == "ConstantDistanceConstraint":
        return replace(found, distance=own.get_constant_distance())
    if kind == "PointOnLineConstraint":
        line = frames[0][0].findTransformInBaseFrame()
        return replace(
            found, direction=to_vector(list_numbers(line.xformFrameVecToBase(own.get_line_direction_vec())))
        )
    return found


_BODIES = (("body_1", "location_body_1"), ("body_2", "location_body_2"))

POINTS: Mapping[str, tuple[Literal["point", "distance", "line"], Sequence[tuple[str, str]]]] = {
    "PointConstraint": ("point", _BODIES),
    "ConstantDistanceConstraint": ("distance", _BODIES),
    "PointOnLineConstraint": (
        "line",
        (("line_body", "point_on_line"), ("follower_body", "point_on_follower")),
    ),
}
"""Constraints between points: what they say; for both ends, the frame's socket and the name of the place."""


def list_end_frames(constraint: Any) -> list[tuple[Any, str]]:
    """The frames of a constraint between points, each with the name of the point's place in it."""
    cast = import_opensim().PhysicalFrame.safeDownCast
    _, ends = POINTS[constraint.getConcreteClassName()]
    return [(cast(constraint.getConnectee(socket)), place) for socket, place in ends]


def _read_end(name: str, frame: Any, location: Any) -> Marker:
    place = frame.findTransformInBaseFrame().shiftFrameStationToBase(location)
    return Marker.at(name, frame.findBaseFrame().getName(), to_vector(list_numbers(place)))


def _find_in_body(frame: Any, component: str) -> tuple[str, Vector, Vector]:
    """The body under a frame, where the frame is in it and how it is turned (a rotation vector)."""
    body, _ = _read_frame(frame, component)
    place = frame.findTransformInBaseFrame()
    turn = convert_rotation_to_vector([[place.R().get(i, j) for j in range(3)] for i in range(3)])
    return body, to_vector(list_numbers(place.p())), to_vector(turn)


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
        law = _substitute(coupler.law, independent, inner.law)
        coupler = Coupler(dependent, inner.independent, law)
    return coupler


def _substitute_coupler(segment: Segment, follows: Mapping[str, Coupler]) -> Segment:
    joints = (replace(joint, law=_substitute_all(joint.law, follows)) for joint in segment.joints)
    return replace(segment, joints=tuple(joints))


def _substitute_all(law: Law, follows: Mapping[str, Coupler]) -> Law:
    for coordinate in sorted(law.coordinates & follows.keys()):
        law = _substitute(law, coordinate, follows[coordinate].law)
    return law


def _substitute(law: Law, coordinate: str, follows: Law) -> Law:
    try:
        return substitute(law, coordinate, follows)
    except NotPolynomial as error:
        raise _NotSubstituted(coordinate) from error
