"""Piecewise polynomials of one coordinate: fitted exactly, composed exactly."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise

import numpy as np

from scaling_service.model.body import Law, Shape, Term
from scaling_service.model.compile import law_value, shape_values

Function = Callable[[float], float]

EXACT = 1e-9
"""How far a fit may miss the function, relative to its size (chosen: far above rounding, far below 1 µm)."""

REACH = 2.0 * float(np.pi)
"""How far beyond the last break a function that does not continue linearly is followed (chosen: a turn)."""

MAX_DEGREE = 12  # the highest degree of a composition (chosen: above it, fitted powers lose their digits)


class NotPolynomial(ValueError):
    """A function is not a polynomial of the supposed degree between its breaks."""


def fit_piecewise(
    function: Function, breaks: Sequence[float], degree: int, *, follow_ends: bool = True
) -> Shape:
    """The piecewise polynomial that equals a function between breaks, and beyond them.

    ``function``: value of the function at one coordinate (rad or m). ``degree``: at least the degree of
    every piece. ``follow_ends``: whether to add a piece of length REACH at an end where the function does
    not continue linearly. Raises NotPolynomial if the function differs from the fit between the points that
    were fitted.
    """
    inner = list(breaks)
    shape = _fit(function, inner, degree)
    extended = list(inner)
    if follow_ends and not _agrees(shape, function, [inner[0] - 0.5 * REACH, inner[0] - REACH]):
        extended.insert(0, inner[0] - REACH)
    if follow_ends and not _agrees(shape, function, [inner[-1] + 0.5 * REACH, inner[-1] + REACH]):
        extended.append(inner[-1] + REACH)
    if len(extended) > len(inner):
        shape = _fit(function, extended, degree)
    between = [a + f * (b - a) for a, b in pairwise(extended) for f in (0.13, 0.59)]
    if not _agrees(shape, function, between):
        raise NotPolynomial(f"not a polynomial of degree {degree} between its breaks")
    return shape


def _fit(function: Function, breaks: Sequence[float], degree: int) -> Shape:
    # Chebyshev points keep the small linear system well conditioned.
    nodes = 0.5 - 0.5 * np.cos(np.pi * np.arange(degree + 1) / degree) if degree else np.array([0.5])
    powers = np.vander(nodes, degree + 1)
    pieces = []
    for start, end in pairwise(breaks):
        width = end - start
        values = np.array([function(float(start + width * u)) for u in nodes])
        unit = np.linalg.solve(powers, values)
        pieces.append(tuple(float(c) for c in unit / width ** np.arange(degree, -1, -1)))
    return Shape(tuple(float(b) for b in breaks), tuple(pieces))


def _agrees(shape: Shape, function: Function, points: Sequence[float]) -> bool:
    wanted = np.array([function(float(x)) for x in points])
    size = max(1e-3, float(np.abs(wanted).max()))
    return bool(np.abs(shape_values(shape, points) - wanted).max() <= EXACT * size)


def at_coordinate(law: Law, x: float) -> float:
    """Value of a law of one coordinate and no parameter at one coordinate value."""
    return float(law_value(law, {term.coordinate: x for term in law.terms if term.coordinate is not None}))


def law_breaks(law: Law) -> list[float]:
    """All breaks of a law's shapes, increasing."""
    return sorted({b for term in law.terms if term.shape is not None for b in term.shape.breaks})


def law_degree(law: Law) -> int:
    """The highest degree among a law's terms."""
    degrees = [0]
    for term in law.terms:
        if term.shape is not None:
            degrees.append(max(len(piece) for piece in term.shape.coefficients) - 1)
        elif term.coordinate is not None:
            degrees.append(1)
    return max(degrees)


def one_shape(law: Law) -> Shape:
    """A law of one coordinate, with at least one shape in it, as a single shape.

    Raises NotPolynomial: cannot happen for laws of shapes, lines and constants; kept as the check of the
    fit.
    """
    return fit_piecewise(lambda x: at_coordinate(law, x), law_breaks(law), law_degree(law), follow_ends=False)


def substitute(law: Law, coordinate: str, follows: Law) -> Law:
    """A law with one coordinate replaced by the law of another coordinate that it follows.

    ``coordinate``: the dependent coordinate. ``follows``: its value; of at most one coordinate. Raises
    NotPolynomial if the composition's degree is above MAX_DEGREE.
    """
    terms: list[Term] = []
    for term in law.terms:
        if term.coordinate != coordinate:
            terms.append(term)
        elif term.shape is None:
            terms.extend(follows.scaled(term.gain).terms)
        else:
            terms.extend(_composed(term.shape, follows).scaled(term.gain).terms)
    return Law(tuple(terms))


def _composed(outer: Shape, inner: Law) -> Law:
    names = {t.coordinate for t in inner.terms if t.coordinate is not None}
    if not names:
        at = np.array(inner.constant_part)
        return Law.constant(float(shape_values(outer, at)))
    (name,) = names
    if inner == Law.of(name):
        return Law((Term(1.0, coordinate=name, shape=outer),))
    degree = max(len(piece) for piece in outer.coefficients) - 1
    degree *= law_degree(inner)
    if degree > MAX_DEGREE:
        raise NotPolynomial(f"the composition has degree {degree}, above {MAX_DEGREE}")
    shape = fit_piecewise(
        lambda x: float(shape_values(outer, at_coordinate(inner, x))),
        _crossings(outer, inner),
        degree,
        follow_ends=False,
    )
    return Law((Term(1.0, coordinate=name, shape=shape),))


def _crossings(outer: Shape, inner: Law) -> list[float]:
    """Where the inner law has a break or its value crosses a break of the outer shape.

    A curved inner law is followed by REACH beyond its breaks, and not further.
    """
    known = law_breaks(inner)
    if not known:
        slope = at_coordinate(inner, 1.0) - at_coordinate(inner, 0.0)
        offset = at_coordinate(inner, 0.0)
        return sorted((b - offset) / slope for b in outer.breaks)
    known = [known[0] - REACH, *known, known[-1] + REACH]
    pieces = _fit(lambda x: at_coordinate(inner, x), known, law_degree(inner))
    found = set(known)
    for start, end, piece in zip(known, known[1:], pieces.coefficients, strict=False):
        for level in outer.breaks:
            found.update(start + r for r in _real_roots(piece, level) if 0.0 < r < end - start)
    return _separated(found)


def _real_roots(piece: Sequence[float], level: float) -> Iterable[float]:
    moved = np.array(piece)
    moved[-1] -= level
    roots = np.roots(np.where(np.abs(moved) < 1e-14 * np.abs(moved).max(initial=1e-300), 0.0, moved))
    return (float(r.real) for r in roots if abs(r.imag) < 1e-9)


def _separated(points: Iterable[float]) -> list[float]:
    """Sorted, with points closer than rounding merged."""
    kept: list[float] = []
    for point in sorted(points):
        if not kept or point - kept[-1] > 1e-9:
            kept.append(point)
    return kept
