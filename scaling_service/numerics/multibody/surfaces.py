"""Smooth functions of several coordinates, with exact derivatives to any order.

Each is written once, in the arithmetic of truncated Taylor series: numbers are series in the deviations
of the coordinates, so that value, slopes and higher derivatives come from one formula (Griewank &
Walther 2008, Evaluating Derivatives, ch. 13).
"""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass
from math import factorial

import numpy as np

from scaling_service.core.arrays import Array

Powers = tuple[int, ...]

_NEAR = 0.5  # of 1 - cos: below it the series, above it the recursion keeps all digits (chosen)
_SERIES = np.array([2.0**k * factorial(k) ** 2 / factorial(2 * k + 1) for k in range(40)])
"""Coefficients of angle / sin(angle) in 1 - cos(angle): 40 leave 1e-24 at the half."""


@dataclass(frozen=True, slots=True, eq=False)
class _Series:
    """A truncated Taylor series: coefficient (n,) by the powers of the deviations."""

    terms: abc.Mapping[Powers, Array]
    order: int

    def __add__(self, other: _Series | float) -> _Series:
        terms = dict(self.terms)
        added = other.terms if isinstance(other, _Series) else {self._origin: np.array(float(other))}
        for powers, value in added.items():
            terms[powers] = terms[powers] + value if powers in terms else value
        return _Series(terms, self.order)

    def __mul__(self, other: _Series | float) -> _Series:
        if not isinstance(other, _Series):
            return _Series({powers: value * other for powers, value in self.terms.items()}, self.order)
        terms: dict[Powers, Array] = {}
        for a, x in self.terms.items():
            for b, y in other.terms.items():
                if sum(a) + sum(b) <= self.order:
                    powers = tuple(i + j for i, j in zip(a, b, strict=True))
                    terms[powers] = terms[powers] + x * y if powers in terms else x * y
        return _Series(terms, self.order)

    @property
    def _origin(self) -> Powers:
        return (0,) * len(next(iter(self.terms)))

    @property
    def value(self) -> Array:
        return self.terms[self._origin]

    def through(self, derivatives: abc.Sequence[Array]) -> _Series:
        """A function of the series, by the function's derivatives at its value."""
        away = _Series({k: v for k, v in self.terms.items() if any(k)}, self.order)
        result = _Series({self._origin: derivatives[0]}, self.order)
        power = _Series({self._origin: np.array(1.0)}, self.order)
        for k, derivative in enumerate(derivatives[1 : self.order + 1], start=1):
            power = power * away
            scaled = {key: v * derivative / factorial(k) for key, v in power.terms.items()}
            result = result + _Series(scaled, self.order)
        return result


def _turn(angle: _Series) -> tuple[_Series, _Series]:
    """Sine and cosine."""
    sine, cosine = np.sin(angle.value), np.cos(angle.value)
    cycle = [sine, cosine, -sine, -cosine]
    count = angle.order + 1
    return (
        angle.through([cycle[k % 4] for k in range(count)]),
        angle.through([cycle[(k + 1) % 4] for k in range(count)]),
    )


def _invert(x: _Series) -> _Series:
    return x.through([(-1.0) ** k * factorial(k) / x.value ** (k + 1) for k in range(x.order + 1)])


def _point_normal(x: abc.Sequence[_Series], _: abc.Sequence[float], axis: int) -> _Series:
    """A component of the z axis after turns about x and y, both of the frame reached."""
    (sin_a, cos_a), (sin_b, cos_b) = _turn(x[0]), _turn(x[1])
    return (sin_b, sin_a * cos_b * -1.0, cos_a * cos_b)[axis]


def _reach_along_arc(x: abc.Sequence[_Series], offsets: abc.Sequence[float], axis: int) -> _Series:
    """A component of the end of an arc of length one and constant curvature that leaves the origin along y.

    At its end the tangent is the y axis after turns about x and z (``offsets`` added to the coordinates),
    which is off y by the angle ``t``; so the end is ``sin t / t`` up and ``(1 - cos t) / t`` to the side.
    """
    (sin_a, cos_a), (sin_b, cos_b) = _turn(x[0] + offsets[0]), _turn(x[1] + offsets[1])
    cosine = cos_a * cos_b
    # Derivatives of `w = t / sin t` with `c = cos t`, from order zero. `(1 - c^2) w' = c w - 1`, and so
    # on by differentiation; near `c = 1` its series in `1 - c`.
    u = 1.0 - cosine.value
    near = u < _NEAR
    far = np.where(near, 0.0, cosine.value)
    rest = 1.0 - far**2
    found = [np.arccos(far) / np.sqrt(rest)]
    for k in range(1, cosine.order + 1):
        above = (k - 1) ** 2 * found[k - 2] if k > 1 else -1.0
        found.append(((2 * k - 1) * far * found[k - 1] + above) / rest)
    small, coefficients = np.where(near, u, 0.0), _SERIES
    for k in range(cosine.order + 1):
        found[k] = np.where(
            near, (-1.0) ** k * np.polynomial.polynomial.polyval(small, coefficients), found[k]
        )
        coefficients = np.polynomial.polynomial.polyder(coefficients)
    ratio = cosine.through(found)
    if axis == 1:
        return _invert(ratio)
    aside = _invert(ratio * (cosine + 1.0))
    return aside * (sin_b * -1.0 if axis == 0 else sin_a * cos_b)


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """A smooth function of several coordinates, as ``model.body.Surface`` describes it."""

    kind: str
    numbers: tuple[float, ...]

    def evaluate(self, x: Array) -> tuple[Array, tuple[Array, ...]]:
        """Value and slopes at coordinates (n_coordinates, n), each (n,)."""
        series = self._expand(x, 1)
        return self._read(series, x, ()), tuple(self._read(series, x, (k,)) for k in range(len(x)))

    def follow_slopes(self, x: Array, qdot: Array, qddot: Array | None) -> list[tuple[Array, ...]]:
        """Rates of every slope where coordinates move, (n,); second rates, too, where ``qddot`` is given.

        ``x``, ``qdot``, ``qddot``: (n_coordinates, n).
        """
        series, count = self._expand(x, 2 if qddot is None else 3), range(len(x))
        second = np.array([[self._read(series, x, (i, j)) for j in count] for i in count])
        once = np.einsum("ijn,jn->in", second, qdot)
        if qddot is None:
            return [(each,) for each in once]
        third = np.array([[[self._read(series, x, (i, j, k)) for k in count] for j in count] for i in count])
        twice = np.einsum("ijkn,jn,kn->in", third, qdot, qdot) + np.einsum("ijn,jn->in", second, qddot)
        return list(zip(once, twice, strict=True))

    def _expand(self, x: Array, order: int) -> _Series:
        units = np.eye(len(x), dtype=int)
        one = np.ones_like(x[0])
        inputs = [
            _Series({(0,) * len(x): value, tuple(unit.tolist()): one}, order)
            for value, unit in zip(x, units, strict=True)
        ]
        if self.kind == "powers":
            result = _Series({inputs[0]._origin: one}, order)
            for each, exponent in zip(inputs, self.numbers, strict=True):
                for _ in range(round(exponent)):
                    result = result * each
            return result
        kind, _, letter = self.kind.partition("_")
        follow = {"normal": _point_normal, "arc": _reach_along_arc}[kind]
        return follow(inputs, self.numbers, "xyz".index(letter))

    def _read(self, series: _Series, x: Array, by: tuple[int, ...]) -> Array:
        """A partial derivative with the coordinates ``by``."""
        powers = tuple(by.count(k) for k in range(len(x)))
        share = float(np.prod([factorial(p) for p in powers]))
        return np.broadcast_to(series.terms.get(powers, np.zeros(1)), x[0].shape) * share
