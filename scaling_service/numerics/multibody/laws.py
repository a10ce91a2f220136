"""Joint values from coordinates and shared parameters, and the moves that they drive.

A law's value is ``constant + sum_t gain_t * parameter_t * factor_t``. A *factor* is one coordinate,
a piecewise polynomial of one coordinate, or a surface: a smooth function of several. Every distinct
factor is evaluated once for all frames and then shared by the laws that use it. Arrays keep frames on
the last axis, so that every operation runs over contiguous memory.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import perm

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.arrays import Array as Array
from scaling_service.numerics.multibody.surfaces import Surface

NONE = -1


@dataclass(frozen=True, slots=True, eq=False)
class Piecewise:
    """A piecewise polynomial, continued linearly outside its breaks."""

    breaks: Array  # (n_pieces + 1,)
    coefficients: Array  # (degree + 1, n_pieces): highest power first, in the variable ``x - breaks[piece]``

    def evaluate(self, x: Array) -> tuple[Array, Array]:
        """Value and slope at ``x`` (any shape)."""
        value, slope = evaluate_together(self.breaks, self.coefficients[:, None], np.ravel(x)[None])
        return value.reshape(np.shape(x)), slope.reshape(np.shape(x))


def evaluate_together(breaks: Array, coefficients: Array, x: Array) -> tuple[Array, Array]:
    """Values and slopes of piecewise polynomials that share their breaks.

    ``breaks``: (n_pieces + 1,).
    ``coefficients``: (degree + 1, n_shapes, n_pieces).
    ``x``: (n_shapes, n).
    """
    inside = np.minimum(np.maximum(x, breaks[0]), breaks[-1])  # np.clip is slow on small arrays
    piece = np.searchsorted(breaks[1:-1], inside, side="right")
    local = inside - breaks[piece]
    taken = coefficients[:, np.arange(len(x))[:, None], piece]
    value, slope = taken[0], np.zeros_like(local)
    for row in taken[1:]:  # Horner, over powers
        slope = slope * local + value
        value = value * local + row
    return value + slope * (x - inside), slope


@dataclass(frozen=True, slots=True, eq=False)
class Factor:
    """What varies from frame to frame: a coordinate, a shape of it, or a surface over several."""

    coordinates: tuple[int, ...]
    shape: Piecewise | Surface | None = None

    @property
    def coordinate(self) -> int:
        """The first coordinate, which is the only one of all but surfaces."""
        return self.coordinates[0]


@dataclass(frozen=True, slots=True, eq=False)
class ShapeGroup:
    """Factors that are shapes with the same breaks and degree, evaluated together.

    ``coefficients`` is (degree + 1, n_shapes, n_pieces).
    """

    factors: tuple[int, ...]
    coordinates: NDArray[np.intp]
    breaks: Array
    coefficients: Array

    def derivatives(self, q: Array, order: int) -> Array:
        """Derivatives of an order above one with the coordinates q (n_coordinates, n), (n_shapes, n)."""
        x = q[self.coordinates]
        inside = np.clip(x, self.breaks[0], self.breaks[-1])
        piece = np.searchsorted(self.breaks[1:-1], inside, side="right")
        local = inside - self.breaks[piece]
        taken = self.coefficients[:, np.arange(len(x))[:, None], piece]
        degree, value = len(taken) - 1, np.zeros_like(local)
        for power in range(degree, order - 1, -1):  # Horner, over powers
            value = value * local + perm(power, order) * taken[degree - power]
        return np.where(inside == x, value, 0.0)  # zero where a shape goes on linearly


def group_shapes(factors: tuple[Factor, ...]) -> tuple[ShapeGroup, ...]:
    """Sort the factors that are shapes into groups."""
    found: dict[tuple[bytes, int], list[int]] = {}
    for k, factor in enumerate(factors):
        if isinstance(factor.shape, Piecewise):
            key = (factor.shape.breaks.tobytes(), len(factor.shape.coefficients))
            found.setdefault(key, []).append(k)
    groups = []
    for rows in found.values():
        shapes = [shape for k in rows if isinstance(shape := factors[k].shape, Piecewise)]
        groups.append(
            ShapeGroup(
                tuple(rows),
                np.array([factors[k].coordinate for k in rows], dtype=np.intp),
                shapes[0].breaks,
                np.stack([shape.coefficients for shape in shapes], axis=1),
            )
        )
    return tuple(groups)


def follow_slopes(
    factors: tuple[Factor, ...],
    groups: tuple[ShapeGroup, ...],
    q: Array,
    qdot: Array,
    qddot: Array | None = None,
) -> list[list[tuple[Array, ...]] | None]:
    """How the slopes of factors change along a motion.

    ``q``, ``qdot``: (n_coordinates, n). ``qddot``: the same; if given, second rates are found, too.
    Returns for every factor, and each of its coordinates, the rates, (n,); None for what is not curved.
    """
    found: list[list[tuple[Array, ...]] | None] = [None] * len(factors)
    for group in groups:
        rate, second = qdot[group.coordinates], group.derivatives(q, 2)
        rates = [second * rate]
        if qddot is not None:
            rates.append(group.derivatives(q, 3) * rate**2 + second * qddot[group.coordinates])
        for row, k in enumerate(group.factors):
            found[k] = [tuple(each[row] for each in rates)]
    for k, factor in enumerate(factors):
        if isinstance(factor.shape, Surface):
            own = list(factor.coordinates)
            found[k] = factor.shape.follow_slopes(q[own], qdot[own], None if qddot is None else qddot[own])
    return found


@dataclass(frozen=True, slots=True, eq=False)
class TermArrays:
    """One term of a law by index; ``gain`` is (3,) for a shift and (1,) for a turn."""

    gain: Array
    parameter: int = NONE
    factor: int = NONE


@dataclass(frozen=True, slots=True, eq=False)
class Values:
    """Everything that laws depend on, evaluated for a block of frames.

    ``factors`` are (n_frames,), one per factor; ``slopes`` (n_frames,), one for each coordinate of a factor,
    or None where that is taken as it is; ``p`` is (n_parameters,).
    """

    factors: list[Array]
    slopes: list[tuple[Array, ...] | None]
    p: Array

    @classmethod
    def of(cls, factors: tuple[Factor, ...], groups: tuple[ShapeGroup, ...], q: Array, p: Array) -> Values:
        """Evaluate all factors.

        ``groups``: of the factors, as :func:`group_shapes` gives them.
        ``q``: (n_coordinates, n_frames).
        ``p``: (n_parameters,).
        """
        values = [q[factor.coordinate] for factor in factors]
        slopes: list[tuple[Array, ...] | None] = [None] * len(factors)
        for group in groups:
            value, slope = evaluate_together(group.breaks, group.coefficients, q[group.coordinates])
            for row, k in enumerate(group.factors):
                values[k], slopes[k] = value[row], (slope[row],)
        for k, factor in enumerate(factors):
            if isinstance(factor.shape, Surface):
                values[k], slopes[k] = factor.shape.evaluate(q[list(factor.coordinates)])
        return cls(values, slopes, p)

    def scalar(self, term: TermArrays) -> Array | float:
        """What a term's gain is multiplied by, (n_frames,) or one number for all."""
        scale = self.p[term.parameter] if term.parameter != NONE else 1.0
        return scale * self.factors[term.factor] if term.factor != NONE else scale

    def by_coordinate(self, term: TermArrays, number: int = 0) -> Array | float:
        """Derivative of a term's scalar part with one of its factor's coordinates, per unit gain."""
        scale = self.p[term.parameter] if term.parameter != NONE else 1.0
        slopes = self.slopes[term.factor]
        return scale if slopes is None else scale * slopes[number]

    def by_parameter(self, term: TermArrays) -> Array | float:
        """Derivative of a term's scalar part with respect to its parameter, per unit gain."""
        return self.factors[term.factor] if term.factor != NONE else 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Shift:
    """A translation by ``constant + sum of terms``, expressed in the frame reached so far (m)."""

    constant: Array
    terms: tuple[TermArrays, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Turn:
    """A rotation about axis 0, 1 or 2 of the frame reached so far (rad)."""

    axis: int
    constant: float
    terms: tuple[TermArrays, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Fixed:
    """A constant rotation, (3, 3), mapping the new frame to the one reached so far."""

    rotation: Array


Move = Shift | Turn | Fixed


@dataclass(frozen=True, slots=True, eq=False)
class Link:
    """The moves that lead from a parent link to this one; parent ``NONE`` is ground."""

    parent: int
    moves: tuple[Move, ...]
