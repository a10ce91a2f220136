"""Laws as MuJoCo can hold them: sums of quartics of one joint each.

Where a quartic of the coordinate is too far off, two helping joints follow it by squares, ``u = (s - a)^2``
and ``v = (s + a)^2`` with s the coordinate scaled to -1 to 1. Their third and fourth Chebyshev polynomials
with the quartic span all polynomials of degree eight, and stay as small as what the quartic leaves.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from scaling_service.model.body import BodyModel, Coordinate, Law, Shape, Term
from scaling_service.model.compile import differentiate_law_at, evaluate_law
from scaling_service.model.trial import Array

QUARTIC = 4  # the degree of MuJoCo's joint equality
_APART = 0.5  # a above; chosen: any but 0 spans the same
_MOST = (1.0 + _APART) ** 2  # of a square
_WAVES = [
    np.polynomial.Chebyshev.basis(degree, domain=[0.0, _MOST]).convert(kind=np.polynomial.Polynomial)
    for degree in (QUARTIC - 1, QUARTIC)
]
_POINTS = 401  # chosen: several between any two knots of a spline
_ENOUGH = 1e-5  # m or rad; chosen: a hundredth of what is asked of a muscle's length
_SLOPES = 0.3
"""Weight, rad, of a law's slope beside its value in the fit: moment arms are slopes. Chosen: 1 mm counts as
much as 3 mm a radian."""


@dataclass(frozen=True, slots=True)
class Followed:
    """How near a law is held."""

    joint: str  # the segment, and which of its joints
    coordinate: str
    degree: int
    off: float  # m or rad, at most, over the coordinate's range
    off_slope: float  # m or rad for each radian or metre of the coordinate
    kind: str  # rotation or translation


@dataclass(frozen=True, slots=True, eq=False)
class Eased:
    """A model whose laws are quartics of one coordinate each."""

    model: BodyModel  # with helping coordinates
    helpers: Mapping[str, tuple[str, Array]]  # to the coordinate and the polynomial, lowest power first, (5,)
    followed: tuple[Followed, ...]


def ease_laws(model: BodyModel) -> Eased:
    """Put every law of one coordinate as near as it goes; surfaces and parameters are left as they are."""
    helpers: dict[str, tuple[str, Array]] = {}
    followed: list[Followed] = []
    known = {c.name: c for c in model.coordinates}
    segments = []
    for segment in model.segments:
        joints = []
        for k, joint in enumerate(segment.joints):
            terms: list[Term] = []
            for term in joint.law.terms:
                own = None if term.coordinate is None else known[term.coordinate]
                if term.shape is None or own is None or own.locked:
                    terms.append(term)
                    continue
                found, off = _ease(replace(term, gain=1.0), own, helpers)
                terms += [replace(each, gain=term.gain) for each in found]
                name = f"{segment.name} {joint.kind} {k}"
                sizes = (abs(term.gain) * off[0], abs(term.gain) * off[1])
                degree = QUARTIC if len(found) == 1 else 2 * QUARTIC
                followed.append(Followed(name, own.name, degree, *sizes, joint.kind))
            joints.append(replace(joint, law=Law(tuple(terms))))
        segments.append(replace(segment, joints=tuple(joints)))
    more = tuple(Coordinate(name=name, lower=0.0, upper=_MOST) for name in helpers)
    eased = replace(model, segments=tuple(segments), coordinates=(*model.coordinates, *more))
    return Eased(eased, helpers, tuple(followed))


def find_span(shape: Shape, coordinate: Coordinate) -> tuple[float, float]:
    """Where a law has to hold: the coordinate's range, or the law's own where that has no end."""
    if np.isfinite([coordinate.lower, coordinate.upper]).all() and coordinate.lower < coordinate.upper:
        return coordinate.lower, coordinate.upper
    return shape.breaks[0], shape.breaks[-1]


def _ease(
    term: Term, coordinate: Coordinate, helpers: dict[str, tuple[str, Array]]
) -> tuple[list[Term], tuple[float, float]]:
    """Terms that add up to a term as nearly as they can, and how far values and slopes are off."""
    assert term.shape is not None
    lower, upper = find_span(term.shape, coordinate)
    x, half = np.linspace(lower, upper, _POINTS), 0.5 * (upper - lower)
    s, law = np.linspace(-1.0, 1.0, _POINTS), Law((term,))
    wanted = np.concatenate([evaluate_law(law, {coordinate.name: x}), _SLOPES * differentiate_law_at(law, x)])
    powers = [np.polynomial.Polynomial.basis(k) for k in range(QUARTIC + 1)]
    squares = [np.polynomial.Polynomial([_APART**2, sign * 2.0 * _APART, 1.0]) for sign in (-1.0, 1.0)]
    for basis in (powers, powers + [wave(square) for square in squares for wave in _WAVES]):
        rows = np.concatenate(
            [
                np.column_stack([p(s) for p in basis]),
                _SLOPES * np.column_stack([p.deriv()(s) / half for p in basis]),
            ]
        )
        found = np.linalg.lstsq(rows, wanted, rcond=None)[0]
        left = np.abs(rows @ found - wanted)
        off = (float(left[:_POINTS].max()), float(left[_POINTS:].max()) / _SLOPES)
        if off[0] < _ENOUGH:
            break
    scaled = np.polynomial.Polynomial([-(lower + upper) / (2.0 * half), 1.0 / half])
    own = np.polynomial.Polynomial(found[: QUARTIC + 1])(scaled)
    terms = [
        _make_term(coordinate.name, _list_powers(own(np.polynomial.Polynomial([lower, 1.0]))), (lower, upper))
    ]
    for k, square in enumerate(squares if len(found) > QUARTIC + 1 else ()):
        name = _name_helper(coordinate.name, _list_powers(square(scaled)), helpers)
        sizes = found[QUARTIC + 1 + len(_WAVES) * k :]
        wave = sum(
            (w * size for w, size in zip(_WAVES, sizes, strict=False)), np.polynomial.Polynomial([0.0])
        )
        terms.append(_make_term(name, _list_powers(wave), (0.0, _MOST)))
    return terms, off


def _list_powers(polynomial: np.polynomial.Polynomial) -> Array:
    """Coefficients, lowest power first, (5,)."""
    own = np.asarray(polynomial.coef, dtype=float)
    return np.pad(own, (0, QUARTIC + 1 - len(own)))


def _name_helper(coordinate: str, square: Array, helpers: dict[str, tuple[str, Array]]) -> str:
    """The joint that follows a coordinate by a square, a new one if there is none yet."""
    for name, (own, known) in helpers.items():
        if own == coordinate and np.array_equal(known, square):
            return name
    name = f"{coordinate} square {1 + sum(own == coordinate for own, _ in helpers.values())}"
    helpers[name] = (coordinate, square)
    return name


def _make_term(coordinate: str, polynomial: Array, span: tuple[float, float]) -> Term:
    """A polynomial, lowest power first, of a coordinate less the span's lower end."""
    shape = Shape(span, (tuple(float(c) for c in polynomial[::-1]),))
    return Term(1.0, coordinate=coordinate, shape=shape)
