"""OpenSim functions of one coordinate as law terms (worker side)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import Any

from scaling_service.core.errors import ModelRefused
from scaling_service.files.osim.library import opensim
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
