"""An OpenSim model as plain JSON: bodies, joints as axes with functions, markers (worker side)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Set
from itertools import pairwise
from pathlib import Path
from typing import Any

from scaling_service.core.errors import ModelRefused
from scaling_service.files.osim.library import items, load, numbers, opensim
from scaling_service.files.osim.shapes import NotPolynomial, fit_piecewise

Terms = list[dict[str, Any]]

_SPLINE_DEGREE: Mapping[str, Callable[[Any], int]] = {
    "SimmSpline": lambda _: 3,
    "PiecewiseLinearFunction": lambda _: 1,
    "GCVSpline": lambda function: int(function.getDegree()),
}

POLYNOMIAL_SPAN = (-math.pi, math.pi)
"""Where a polynomial of a coordinate without a finite range is centred (chosen: one turn); the fit reaches
one further turn to each side."""


def function_terms(function: Any, coordinate: str | None, span: tuple[float, float], component: str) -> Terms:
    """A function as terms ``gain * shape(coordinate)``.

    ``coordinate``: its argument; None where the component names none. ``span`` (lower, upper): the
    coordinate's range, where polynomials are represented best. ``component``: the joint or constraint, for
    the message. Raises ModelRefused if the function is of another kind, or has no argument and is not
    constant.
    """
    kind = function.getConcreteClassName()
    library = opensim()
    if kind == "Constant":
        return _constant(library.Constant.safeDownCast(function).getValue())
    if kind == "MultiplierFunction":
        scaled = library.MultiplierFunction.safeDownCast(function)
        inner = function_terms(scaled.getFunction(), coordinate, span, component)
        return [{**term, "gain": term["gain"] * scaled.getScale()} for term in inner]
    if coordinate is None:
        raise ModelRefused(
            f"the {kind} of '{component}' has no coordinate",
            field=component,
            remedy="Name the coordinate in <coordinates>, or use a Constant",
        )
    if kind == "LinearFunction":
        line = library.LinearFunction.safeDownCast(function)
        return [{"gain": line.getSlope(), "coordinate": coordinate}, *_constant(line.getIntercept())]
    if kind == "PolynomialFunction":
        return _polynomial(library.PolynomialFunction.safeDownCast(function), coordinate, span, component)
    if kind in _SPLINE_DEGREE:
        spline = getattr(library, kind).safeDownCast(function)
        return _spline(spline, _SPLINE_DEGREE[kind](spline), coordinate, component)
    raise ModelRefused(
        f"'{component}' uses a {kind}, which is no piecewise polynomial of one coordinate",
        field=component,
        remedy="Replace it by a SimmSpline, GCVSpline or PolynomialFunction",
    )


def _constant(value: float) -> Terms:
    return [{"gain": value}] if value else []


def _polynomial(function: Any, coordinate: str, span: tuple[float, float], component: str) -> Terms:
    vector = function.getCoefficients()
    coefficients = [vector.get(k) for k in range(vector.size())]
    while len(coefficients) > 1 and not coefficients[0]:
        coefficients.pop(0)
    if len(coefficients) <= 2:
        slope, offset = [0.0, *coefficients][-2:]
        line = [{"gain": slope, "coordinate": coordinate}] if slope else []
        return [*line, *_constant(offset)]
    lower, upper = span
    if not (math.isfinite(lower) and math.isfinite(upper) and 0.0 < upper - lower < 4.0 * math.pi):
        lower, upper = POLYNOMIAL_SPAN
    return _fitted(function, [lower, upper], len(coefficients) - 1, coordinate, component)


def _spline(function: Any, degree: int, coordinate: str, component: str) -> Terms:
    knots = [function.getX(k) for k in range(function.getSize())]
    if len(knots) < 2 or any(b <= a for a, b in pairwise(knots)):
        raise ModelRefused(
            f"the {function.getConcreteClassName()} of '{component}' needs at least two increasing knots",
            field=component,
            remedy="Sort the points and remove doubled ones",
        )
    return _fitted(function, knots, degree, coordinate, component)


def _fitted(function: Any, breaks: list[float], degree: int, coordinate: str, component: str) -> Terms:
    library = opensim()
    try:
        shape = fit_piecewise(lambda x: float(function.calcValue(library.Vector(1, x))), breaks, degree)
    except NotPolynomial as error:
        raise ModelRefused(
            f"the {function.getConcreteClassName()} of '{component}' is {error}",
            field=component,
            remedy="Replace it by a SimmSpline through its values",
        ) from error
    return [
        {
            "gain": 1.0,
            "coordinate": coordinate,
            "shape": {"breaks": shape.breaks, "coefficients": shape.coefficients},
        }
    ]


_X, _Y, _Z = [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]

# The joints of fixed kind: for each of their coordinates, in order, what it does. Ball and free joints
# turn by body-fixed x, y, z angles (Simbody's Euler mode, which OpenSim always chooses); translations
# act in the parent's joint frame, before the rotations.
_FIXED_JOINTS: Mapping[str, tuple[tuple[str, list[float]], ...]] = {
    "WeldJoint": (),
    "PinJoint": (("rotation", _Z),),
    "SliderJoint": (("translation", _X),),
    "UniversalJoint": (("rotation", _X), ("rotation", _Y)),
    "GimbalJoint": (("rotation", _X), ("rotation", _Y), ("rotation", _Z)),
    "BallJoint": (("rotation", _X), ("rotation", _Y), ("rotation", _Z)),
    "PlanarJoint": (("rotation", _Z), ("translation", _X), ("translation", _Y)),
    "FreeJoint": (
        ("rotation", _X),
        ("rotation", _Y),
        ("rotation", _Z),
        ("translation", _X),
        ("translation", _Y),
        ("translation", _Z),
    ),
}
_MOTION = {1: "rotation", 2: "translation", 3: "coupled"}
_REMEDY = "Remove or replace it in the model"


def read(request: dict[str, Any]) -> dict[str, Any]:
    """Describe the model in ``file``, with the markers of ``marker_set`` added where given."""
    return describe(load(Path(request["file"]), request.get("marker_set")))


def describe(model: Any) -> dict[str, Any]:
    """Everything of a connected model that a BodyModel holds.

    Raises ModelRefused: names the joint, constraint, coordinate or frame that cannot be represented.
    """
    spans = _spans(model)
    couplers = _couplers(model, spans)
    dependent = {coupler["dependent"] for coupler in couplers}
    return {
        "name": model.getName(),
        "bodies": [_body(body) for body in items(model.getBodySet())],
        "joints": [_joint(joint, spans, dependent) for joint in items(model.getJointSet())],
        "coordinates": [_coordinate(c) for c in items(model.getCoordinateSet())],
        "couplers": couplers,
        "markers": [_marker(marker) for marker in items(model.getMarkerSet())],
    }


def _spans(model: Any) -> dict[str, tuple[float, float]]:
    coordinates = items(model.getCoordinateSet())
    return {c.getName(): (c.getRangeMin(), c.getRangeMax()) for c in coordinates}


def _body(body: Any) -> dict[str, Any]:
    return {
        "name": body.getName(),
        "mass": body.get_mass(),
        "com": numbers(body.get_mass_center()),
        "inertia": numbers(body.get_inertia()),
    }


def _coordinate(coordinate: Any) -> dict[str, Any]:
    default, locked = coordinate.getDefaultValue(), coordinate.getDefaultLocked()
    if coordinate.get_prescribed():
        function = coordinate.get_prescribed_function()
        constant = opensim().Constant.safeDownCast(function)
        if constant is None:
            raise ModelRefused(
                f"coordinate '{coordinate.getName()}' is prescribed by a {function.getConcreteClassName()}",
                field=coordinate.getName(),
                remedy="Set <prescribed> to false, or prescribe a Constant",
            )
        default, locked = constant.getValue(), True
    return {
        "name": coordinate.getName(),
        "motion": _MOTION.get(int(coordinate.getMotionType()), "coupled"),
        "default": default,
        "lower": coordinate.getRangeMin(),
        "upper": coordinate.getRangeMax(),
        "clamped": coordinate.getDefaultClamped(),
        "locked": locked,
    }


def _joint(joint: Any, spans: Mapping[str, tuple[float, float]], dependent: Set[str]) -> dict[str, Any]:
    kind = joint.getConcreteClassName()
    name = joint.getName()
    if kind == "CustomJoint":
        axes = _custom_axes(opensim().CustomJoint.safeDownCast(joint), spans)
    elif kind in _FIXED_JOINTS:
        axes = [
            {
                "kind": what,
                "axis": axis,
                "terms": [{"gain": 1.0, "coordinate": joint.get_coordinates(k).getName()}],
                "scales": False,
            }
            for k, (what, axis) in enumerate(_FIXED_JOINTS[kind])
        ]
    else:
        raise ModelRefused(f"joint '{name}' is a {kind}, which is not supported", field=name, remedy=_REMEDY)
    for axis in axes:
        # OpenSim scales the coupling of a dependent translation, and so the translation itself.
        driven = {term.get("coordinate") for term in axis["terms"]} & dependent
        axis["scales"] = axis["kind"] == "translation" and (axis["scales"] or bool(driven))
    return {
        "name": name,
        "parent": _frame(joint.getParentFrame(), name),
        "child": _frame(joint.getChildFrame(), name),
        "axes": axes,
    }


def _custom_axes(joint: Any, spans: Mapping[str, tuple[float, float]]) -> list[dict[str, Any]]:
    transform = joint.getSpatialTransform()
    axes = []
    for k in range(6):
        axis = transform.getTransformAxis(k)
        names = axis.getCoordinateNamesInArray()
        if names.getSize() > 1:
            raise ModelRefused(
                f"joint '{joint.getName()}' uses a function of several coordinates",
                field=joint.getName(),
                remedy=_REMEDY,
            )
        coordinate = names.get(0) if names.getSize() else None
        terms = function_terms(
            axis.getFunction(), coordinate, spans.get(coordinate or "", (0.0, 0.0)), joint.getName()
        )
        axes.append(
            {
                "kind": "rotation" if k < 3 else "translation",
                "axis": numbers(axis.get_axis()),
                "terms": terms,
                "scales": k >= 3 and not is_pure(axis.getFunction()),
            }
        )
    return axes


def is_pure(function: Any) -> bool:
    """Whether a translation is its coordinate itself, which OpenSim's scaling leaves alone."""
    line = opensim().LinearFunction.safeDownCast(function)
    return line is not None and line.getSlope() == 1.0 and line.getIntercept() == 0.0


def _frame(frame: Any, component: str) -> dict[str, Any]:
    """The body under a frame and the offsets that lead from it to the frame, outwards."""
    offsets: list[dict[str, Any]] = []
    while (offset := opensim().PhysicalOffsetFrame.safeDownCast(frame)) is not None:
        transform = offset.getOffsetTransform()
        rotation = transform.R()
        offsets.insert(
            0,
            {
                "translation": numbers(transform.p()),
                "rotation": [[rotation.get(i, j) for j in range(3)] for i in range(3)],
            },
        )
        frame = offset.getParentFrame()
    kind = frame.getConcreteClassName()
    if kind not in {"Body", "Ground"}:
        raise ModelRefused(
            f"'{component}' is attached to '{frame.getName()}', a {kind}, which is not supported",
            field=component,
            remedy="Attach it to a body or to a PhysicalOffsetFrame",
        )
    return {"body": frame.getName(), "offsets": offsets}


def _marker(marker: Any) -> dict[str, Any]:
    frame = marker.getParentFrame()
    in_body = frame.findTransformInBaseFrame().shiftFrameStationToBase(marker.get_location())
    return {
        "name": marker.getName(),
        "body": frame.findBaseFrame().getName(),
        "position": numbers(in_body),
        "fixed": marker.get_fixed(),
    }


def _couplers(model: Any, spans: Mapping[str, tuple[float, float]]) -> list[dict[str, Any]]:
    found = []
    for constraint in items(model.getConstraintSet()):
        if not constraint.get_isEnforced():
            continue
        name, kind = constraint.getName(), constraint.getConcreteClassName()
        coupler = opensim().CoordinateCouplerConstraint.safeDownCast(constraint)
        if coupler is None:
            raise ModelRefused(
                f"constraint '{name}' is a {kind}, which is not supported", field=name, remedy=_REMEDY
            )
        independent = coupler.getIndependentCoordinateNames()
        if independent.getSize() != 1:
            raise ModelRefused(
                f"constraint '{name}' couples to several coordinates", field=name, remedy=_REMEDY
            )
        terms = function_terms(coupler.getFunction(), independent.get(0), spans[independent.get(0)], name)
        factor = opensim().PropertyHelper.getValueDouble(coupler.getPropertyByName("scale_factor"))
        found.append(
            {
                "name": name,
                "dependent": coupler.getDependentCoordinateName(),
                "independent": independent.get(0),
                "terms": [{**term, "gain": term["gain"] * factor} for term in terms],
            }
        )
    return found
