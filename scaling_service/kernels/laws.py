"""Joint values from coordinates, shared parameters and known signals, with their derivatives.

A law's value is ``constant + sum_t gain_t * parameter_t * factor_t``. A *factor* is one coordinate,
a piecewise polynomial of one coordinate, or a signal; every distinct factor is evaluated once for
all frames and then shared by the laws that use it. Arrays keep frames on the last axis, so that
every operation runs over contiguous memory.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
NONE = -1


@dataclass(frozen=True, slots=True, eq=False)
class Piecewise:
    """A piecewise polynomial, continued linearly outside its breaks.

    Parameters
    ----------
    breaks : ndarray, shape (n_pieces + 1,)
    coefficients : ndarray, shape (degree + 1, n_pieces)
        Highest power first, in the variable ``x - breaks[piece]``.
    """

    breaks: Array
    coefficients: Array

    def evaluate(self, x: Array) -> tuple[Array, Array]:
        """Value and slope at ``x`` (any shape)."""
        inside = np.clip(x, self.breaks[0], self.breaks[-1])
        piece = np.clip(np.searchsorted(self.breaks, inside, side="right") - 1, 0, len(self.breaks) - 2)
        local = inside - self.breaks[piece]
        value = np.zeros_like(local)
        slope = np.zeros_like(local)
        for row in self.coefficients:  # Horner, over powers
            slope = slope * local + value
            value = value * local + row[piece]
        return value + slope * (x - inside), slope


@dataclass(frozen=True, slots=True, eq=False)
class Factor:
    """What varies from frame to frame: a coordinate, a shape of it, or a signal (``NONE`` if not)."""

    coordinate: int
    shape: Piecewise | None = None
    signal: int = NONE


@dataclass(frozen=True, slots=True, eq=False)
class TermArrays:
    """One term of a law by index; ``gain`` is (3,) for a shift and (1,) for a turn."""

    gain: Array
    parameter: int = NONE
    factor: int = NONE


@dataclass(frozen=True, slots=True, eq=False)
class Values:
    """Everything that laws depend on, evaluated for a block of frames.

    ``factors`` and ``slopes`` are lists of (n_frames,) arrays, one per factor; ``p`` is (n_parameters,).
    """

    factors: list[Array]
    slopes: list[Array | None]
    p: Array

    @classmethod
    def of(cls, factors: tuple[Factor, ...], q: Array, p: Array, signals: Array | None) -> Values:
        """Evaluate all factors.

        Parameters
        ----------
        q : ndarray, shape (n_coordinates, n_frames)
        p : ndarray, shape (n_parameters,)
        signals : ndarray, shape (n_signals, n_frames), optional
        """
        values: list[Array] = []
        slopes: list[Array | None] = []
        for factor in factors:
            if factor.signal != NONE:
                if signals is None:
                    raise ValueError("the tree uses signals and none were given")
                value, slope = signals[factor.signal], None
            elif factor.shape is None:
                value, slope = q[factor.coordinate], None
            else:
                value, slope = factor.shape.evaluate(q[factor.coordinate])
            values.append(value)
            slopes.append(slope)
        return cls(values, slopes, p)

    def scalar(self, constant: float, terms: tuple[TermArrays, ...]) -> Array | float:
        """Value of a turn's law, (n_frames,) or a number if nothing in it varies."""
        total: Array | float = constant
        for term in terms:
            scale = term.gain[0] * (self.p[term.parameter] if term.parameter != NONE else 1.0)
            total = total + (scale * self.factors[term.factor] if term.factor != NONE else scale)
        return total

    def vector(self, constant: Array, terms: tuple[TermArrays, ...]) -> Array:
        """Value of a shift's law, (3, n_frames) or (3, 1)."""
        total = constant[:, None]
        for term in terms:
            gain = term.gain * (self.p[term.parameter] if term.parameter != NONE else 1.0)
            total = total + (
                gain[:, None] * self.factors[term.factor] if term.factor != NONE else gain[:, None]
            )
        return total

    def by_coordinate(self, term: TermArrays) -> Array | float:
        """Derivative of a term's scalar part with respect to its coordinate, per unit gain."""
        scale = self.p[term.parameter] if term.parameter != NONE else 1.0
        slope = self.slopes[term.factor]
        return scale if slope is None else scale * slope

    def by_parameter(self, term: TermArrays) -> Array | float:
        """Derivative of a term's scalar part with respect to its parameter, per unit gain."""
        return self.factors[term.factor] if term.factor != NONE else 1.0
