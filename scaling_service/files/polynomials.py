"""Laws as MuJoCo can hold them: sums of quartics of one joint each.

Where a quartic of the coordinate is too far off, two helping joints follow it by squares, ``u = (s - a)^2``
and ``v = (s + a)^2`` with s the coordinate scaled to -1 to 1, and both scaled to that range, too. Their third
and fourth Chebyshev polynomials with the quartic span all polynomials of degree eight, and stay as small as
what the quartic leaves. If that is too far off as well, two more joints follow these by their second
Chebyshev polynomial, which takes the sum to degree sixteen.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.model import body
from scaling_service.model.compile import differentiate_law_at, evaluate_law

QUARTIC = 4  # the degree of MuJoCo's joint equality
_APART = 0.5  # a above; chosen: any but 0 spans the same
_T2, _T3, _T4 = (np.polynomial.Chebyshev.basis(k).convert(kind=np.polynomial.Polynomial) for k in (2, 3, 4))
_DEGREES = {1: QUARTIC, 3: 2 * QUARTIC, 5: 4 * QUARTIC}  # by number of summands
_POINTS = 401  # chosen: several between any two knots of a spline
_ENOUGH = 1e-5  # m or rad; chosen: a hundredth of what is asked of a muscle's length
_SLOPES = 0.3
"""Weight, rad, of a law's slope beside its value in the fit: moment arms are slopes. Chosen: 1 mm counts as
much as 3 mm a radian."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Followed:
    """How near a law is held."""

    joint: str  # the segment, and which of its joints
    coordinate: str
    degree: int
    off: float  # m or rad, at most, over the coordinate's range
    kind: str  # rotation or translation


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Eased:
    """A model whose laws are quartics of one coordinate each."""

    model: body.BodyModel  # with helping coordinates
    helpers: Mapping[str, tuple[str, Array]]
    """To the coordinate that each follows, which comes before, and the quartic, lowest power first."""
    followed: tuple[Followed, ...]

    def fill(self, columns: Mapping[str, Array]) -> dict[str, Array]:
        """Values of coordinates with those of helping ones, rad or m."""
        found = dict(columns)
        for name, (leader, quartic) in self.helpers.items():
            found[name] = np.polynomial.Polynomial(quartic)(found[leader])
        return found


def ease_laws(model: body.BodyModel) -> Eased:
    """Put every law of one coordinate as near as it goes; surfaces and parameters are left as they are."""
    helpers: dict[str, tuple[str, Array]] = {}
    followed: list[Followed] = []
    known = {c.name: c for c in model.coordinates}
    segments = []
    for segment in model.segments:
        joints = []
        for k, joint in enumerate(segment.joints):
            terms: list[body.Term] = []
            for term in joint.law.terms:
                own = None if term.coordinate is None else known[term.coordinate]
                if term.shape is None or own is None or own.locked:
                    terms.append(term)
                    continue
                found, off = _ease(dataclasses.replace(term, gain=1.0), own, helpers)
                terms += [dataclasses.replace(each, gain=term.gain) for each in found]
                followed.append(
                    Followed(
                        joint=f"{segment.name} {joint.kind} {k}",
                        coordinate=own.name,
                        degree=_DEGREES[len(found)],
                        off=abs(term.gain) * off,
                        kind=joint.kind,
                    )
                )
            joints.append(dataclasses.replace(joint, law=body.Law(tuple(terms))))
        segments.append(dataclasses.replace(segment, joints=tuple(joints)))
    more = tuple(body.Coordinate(name=name, lower=-1.0, upper=1.0) for name in helpers)
    eased = dataclasses.replace(model, segments=tuple(segments), coordinates=(*model.coordinates, *more))
    return Eased(eased, helpers, tuple(followed))


def find_span(shape: body.Shape, coordinate: body.Coordinate) -> tuple[float, float]:
    """Where a law has to hold: the coordinate's range, or the law's own where that has no end."""
    if np.isfinite([coordinate.lower, coordinate.upper]).all() and coordinate.lower < coordinate.upper:
        return coordinate.lower, coordinate.upper
    return shape.breaks[0], shape.breaks[-1]


def _ease(
    term: body.Term, coordinate: body.Coordinate, helpers: dict[str, tuple[str, Array]]
) -> tuple[list[body.Term], float]:
    """Terms that add up to a term as nearly as they can, and how far they are off at most, m or rad."""
    assert term.shape is not None
    lower, upper = find_span(term.shape, coordinate)
    x, half = np.linspace(lower, upper, _POINTS), 0.5 * (upper - lower)
    s, law = np.linspace(-1.0, 1.0, _POINTS), body.Law((term,))
    wanted = np.concatenate([evaluate_law(law, {coordinate.name: x}), _SLOPES * differentiate_law_at(law, x)])
    scaled = np.polynomial.Polynomial([-(lower + upper) / (2.0 * half), 1.0 / half])
    squares = [np.polynomial.Polynomial([-sign * _APART, 1.0]) ** 2 for sign in (1.0, -1.0)]
    first = [2.0 / (1.0 + _APART) ** 2 * square - 1.0 for square in squares]
    second = [_T2(square) for square in first]
    powers = [np.polynomial.Polynomial.basis(k) for k in range(QUARTIC + 1)]
    for inner in ([], first, first + second):
        basis = powers + [wave(each) for each in inner for wave in (_T3, _T4)]
        values = np.column_stack([p(s) for p in basis])
        slopes = np.column_stack([p.deriv()(s) / half for p in basis])
        rows = np.concatenate([values, _SLOPES * slopes])
        found = np.linalg.lstsq(rows, wanted, rcond=None)[0]
        left = np.abs(rows @ found - wanted)
        if left.max() < _ENOUGH:
            break
    own, *rest = np.split(found, range(QUARTIC + 1, len(found), 2))
    terms = [_make_term(coordinate.name, np.polynomial.Polynomial(own)(scaled), (lower, upper))]
    names: list[str] = []
    for k, (third, fourth) in enumerate(rest):
        leader, law_of = (
            (coordinate.name, first[k](scaled)) if k < len(first) else (names[k - len(first)], _T2)
        )
        # The joint that follows another one by a square, a new one if there is none yet
        square = _list_powers(law_of)
        same = [name for name, (one, _) in helpers.items() if one == leader]
        name = next((name for name in same if np.array_equal(helpers[name][1], square)), None)
        if name is None:
            name = f"{leader} square {1 + len(same)}"
            helpers[name] = (leader, square)
        names.append(name)
        terms.append(_make_term(names[-1], third * _T3 + fourth * _T4, (-1.0, 1.0)))
    return terms, float(left[:_POINTS].max())


def _list_powers(polynomial: np.polynomial.Polynomial) -> Array:
    """Coefficients, lowest power first, (5,)."""
    own = np.asarray(polynomial.coef, dtype=float)
    return np.pad(own, (0, QUARTIC + 1 - len(own)))


def _make_term(coordinate: str, polynomial: np.polynomial.Polynomial, span: tuple[float, float]) -> body.Term:
    """A polynomial of a coordinate, over a span."""
    local = _list_powers(polynomial(np.polynomial.Polynomial([span[0], 1.0])))
    return body.Term(
        1.0, coordinate=coordinate, shape=body.Shape(span, (tuple(float(c) for c in local[::-1]),))
    )
