"""Functions of OpenSim's as laws of coordinates, and back."""

from __future__ import annotations

import math
from collections import abc
from itertools import pairwise, product
from typing import Any

import numpy as np

from scaling_service.core.errors import ModelRefused
from scaling_service.files.osim import joints
from scaling_service.files.osim.library import import_opensim, list_numbers
from scaling_service.model import body
from scaling_service.model.compile import evaluate_shape

Range = tuple[float, float]

_SPLINE_DEGREE: abc.Mapping[str, abc.Callable[[Any], int]] = {
    "SimmSpline": lambda _: 3,
    "PiecewiseLinearFunction": lambda _: 1,
    "GCVSpline": lambda function: int(function.getDegree()),
}


POLYNOMIAL_SPAN = (-math.pi, math.pi)
"""Where a polynomial of a coordinate without a finite range is centred (chosen: one turn); the fit reaches
one further turn to each side."""

_STEP_DEGREE = 5  # of SimTK's step

_PIECES, _PIECE_DEGREE = 128, 9  # chosen: sines of up to ten turns a turn are met to EXACT


def read_law(
    function: Any, coordinates: abc.Sequence[str], ranges: abc.Mapping[str, Range], component: str
) -> body.Law:
    """A function of coordinates (none where the component names none) as a law.

    Raises ModelRefused if the function is of another kind, or has no argument and is not constant.
    """
    kind = function.getConcreteClassName()
    library = import_opensim()
    if kind == "Constant":
        return body.Law.constant(library.Constant.safeDownCast(function).getValue())
    if kind == "MultiplierFunction":
        scaled = library.MultiplierFunction.safeDownCast(function)
        return read_law(scaled.getFunction(), coordinates, ranges, component).scale(scaled.getScale())
    if not coordinates:
        raise ModelRefused(
            f"the {kind} of '{component}' has no coordinate",
            field=component,
            remedy="Name the coordinate in <coordinates>, or use a Constant",
        )
    if kind == "LinearFunction":
        numbers = library.LinearFunction.safeDownCast(function).getCoefficients()
        *slopes, offset = (numbers.get(k) for k in range(numbers.getSize()))
        terms = (
            body.Term(slope, coordinate=c) for slope, c in zip(slopes, coordinates, strict=False) if slope
        )
        return body.Law(tuple(terms)) + body.Law.constant(offset)
    if kind == "MultivariatePolynomialFunction":
        polynomial = library.MultivariatePolynomialFunction.safeDownCast(function)
        # One term for each product of powers; the last coordinate's power grows first.
        order = polynomial.getOrder()
        powers = [e for e in product(range(order + 1), repeat=len(coordinates)) if sum(e) <= order]
        law = body.Law()
        for gain, exponents in zip(list_numbers(polynomial.getCoefficients()), powers, strict=True):
            if gain:
                law = law + _multiply_powers(gain, coordinates, exponents)
        return law
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
        coefficients = list_numbers(polynomial.getCoefficients())
        while len(coefficients) > 1 and not coefficients[0]:
            coefficients.pop(0)
        if len(coefficients) <= 2:
            slope, offset = [0.0, *coefficients][-2:]
            return body.Law.of(coordinate, slope, offset) if slope else body.Law.constant(offset)
        lower, upper = span if _is_range(span) else POLYNOMIAL_SPAN
        return _fit_law(polynomial, [lower, upper], len(coefficients) - 1, coordinate, component)
    if kind in _SPLINE_DEGREE:
        spline = getattr(library, kind).safeDownCast(function)
        degree = _SPLINE_DEGREE[kind](spline)
        knots = [spline.getX(k) for k in range(spline.getSize())]
        if len(knots) < 2 or any(b <= a for a, b in pairwise(knots)):
            raise ModelRefused(
                f"the {spline.getConcreteClassName()} of '{component}' needs at least two increasing knots",
                field=component,
                remedy="Sort the points and remove doubled ones",
            )
        return _fit_law(spline, knots, degree, coordinate, component)
    if kind == "StepFunction":
        step = library.StepFunction.safeDownCast(function)
        return _fit_law(
            function, [step.getStartTime(), step.getEndTime()], _STEP_DEGREE, coordinate, component
        )
    # any other is followed in pieces so short that it is smooth within each
    lower, upper = span if _is_range(span) else POLYNOMIAL_SPAN
    breaks = [float(x) for x in np.linspace(lower - joints.REACH, upper + joints.REACH, _PIECES + 1)]
    return _fit_law(function, breaks, _PIECE_DEGREE, coordinate, component, follow_ends=False)


def read_number(thing: Any, name: str) -> float:
    """A property of an OpenSim object that is a number."""
    return float(import_opensim().PropertyHelper.getValueDouble(thing.getPropertyByName(name)))


def _multiply_powers(gain: float, coordinates: abc.Sequence[str], exponents: abc.Sequence[int]) -> body.Law:
    used = {c: e for c, e in zip(coordinates, exponents, strict=True) if e}
    if not used:
        return body.Law.constant(gain)
    if list(used.values()) == [1]:
        return body.Law((body.Term(gain, coordinate=next(iter(used))),))
    return body.Law(
        (body.Term(gain, surface=body.Surface("powers", tuple(used), tuple(map(float, used.values())))),)
    )


def _is_range(span: Range) -> bool:
    lower, upper = span
    return math.isfinite(lower) and math.isfinite(upper) and 0.0 < upper - lower < 4.0 * math.pi


def _fit_law(
    function: Any,
    breaks: list[float],
    degree: int,
    coordinate: str,
    component: str,
    *,
    follow_ends: bool = True,
) -> body.Law:
    library = import_opensim()
    try:
        shape = joints.fit_piecewise(
            lambda x: float(function.calcValue(library.Vector(1, x))), breaks, degree, follow_ends=follow_ends
        )
    except joints.NotPolynomial as error:
        raise ModelRefused(
            f"the {function.getConcreteClassName()} of '{component}' is {error}",
            field=component,
            remedy="Replace it by a SimmSpline through its values",
        ) from error
    return body.Law((body.Term(1.0, coordinate=coordinate, shape=shape),))


def list_strings(names: Any) -> list[str]:
    """An array of OpenSim's strings as a list."""
    return [names.get(k) for k in range(names.getSize())]


def make_function(law: body.Law) -> Any:
    """A law of one coordinate, or of none, as a function of OpenSim's."""
    library = import_opensim()
    if law.is_constant:
        return library.Constant(law.constant_part)
    if all(t.shape is None for t in law.terms):
        slope = sum(t.gain for t in law.terms if t.coordinate is not None)
        return library.LinearFunction(slope, law.constant_part)
    shape = joints.merge_shapes(law)
    # Coefficients in the coordinate itself, if all pieces are one polynomial (highest power first)
    middle = len(shape.coefficients) // 2
    local = np.poly1d(shape.coefficients[middle])
    breaks = np.array(shape.breaks)
    between = np.concatenate([breaks[:-1] + f * np.diff(breaks) for f in (0.0, 0.37, 0.81)])
    there = evaluate_shape(shape, between)
    size = max(1e-3, float(np.abs(there).max()))
    if np.abs(local(between - breaks[middle]) - there).max() > joints.EXACT * size:
        single: list[float] | None = None
    else:
        moved = local(np.poly1d([1.0, -breaks[middle]]))
        single = [float(c) for c in np.atleast_1d(moved.coeffs)]
    if single is not None:
        coefficients = library.Vector(len(single), 0.0)
        for k, value in enumerate(single):
            coefficients.set(k, value)
        return library.PolynomialFunction(coefficients)
    straight = all(not any(piece[:-2]) for piece in shape.coefficients)
    spline = library.PiecewiseLinearFunction() if straight else library.SimmSpline()
    for x, y in zip(shape.breaks, evaluate_shape(shape, np.array(shape.breaks)).tolist(), strict=True):
        spline.addPoint(x, y)
    return spline
