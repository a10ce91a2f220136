"""How fast the values of laws change along a motion: exact first and second derivatives in time.

For a shape s of a coordinate q: ``d/dt s = s' qdot`` and ``d2/dt2 s = s'' qdot^2 + s' qddot``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scaling_service.numerics.multibody.laws import NONE, Array, Factor, ShapeGroup, TermArrays


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Coordinates along a motion with their exact rates, frames last."""

    # q, qdot, qddot: (n_coordinates, n), rad or m, per s, per s2: frames of several samples may stand one
    # after the other
    q: Array
    qdot: Array
    qddot: Array
    signals: Array | None = None  # (3, n_signals, n): known signals, their first and their second rates

    def __post_init__(self) -> None:
        if not self.q.shape == self.qdot.shape == self.qddot.shape:
            raise ValueError(f"q {self.q.shape}, qdot {self.qdot.shape} and qddot {self.qddot.shape} differ")

    @classmethod
    def of_frames(cls, q: Array, qdot: Array, qddot: Array) -> Motion:
        """From arrays with frames first, shape (..., n_coordinates); leading axes are joined."""
        flat = [np.ascontiguousarray(x.reshape(-1, x.shape[-1]).T, dtype=float) for x in (q, qdot, qddot)]
        return cls(*flat)

    @property
    def n(self) -> int:
        """The number of frames."""
        return int(self.q.shape[1])

    def block(self, rows: slice) -> Motion:
        """Only these frames."""
        signals = None if self.signals is None else self.signals[..., rows]
        return Motion(self.q[:, rows], self.qdot[:, rows], self.qddot[:, rows], signals)


def curvatures(groups: Sequence[ShapeGroup], n_factors: int, q: Array) -> list[Array | None]:
    """Second derivatives of all shapes with respect to their coordinates; zero where they go on linearly.

    ``q``: (n_coordinates, n).
    One per factor; None where the factor is no shape.
    """
    found: list[Array | None] = [None] * n_factors
    for group in groups:
        value = _second_derivatives(group, q[group.coordinates])
        for row, k in enumerate(group.factors):
            found[k] = value[row]
    return found


def _second_derivatives(group: ShapeGroup, x: Array) -> Array:
    inside = np.clip(x, group.breaks[0], group.breaks[-1])
    piece = np.searchsorted(group.breaks[1:-1], inside, side="right")
    local = inside - group.breaks[piece]
    taken = group.coefficients[:, np.arange(len(x))[:, None], piece]
    degree = len(taken) - 1
    value = np.zeros_like(local)
    for power in range(degree, 1, -1):  # Horner, over powers
        value = value * local + power * (power - 1) * taken[degree - power]
    return np.where(inside == x, value, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class FactorRates:
    """First and second rates in time of every factor, lists of (n,) arrays."""

    first: list[Array]
    second: list[Array]

    @classmethod
    def of(
        cls,
        factors: tuple[Factor, ...],
        motion: Motion,
        slopes: Sequence[Array | None],
        curves: Sequence[Array | None],
    ) -> FactorRates:
        """Rates of all factors.

        ``slopes``, ``curves``: first and second derivatives of the shapes, None where a factor is none.
        Raises ValueError: if a signal moves the tree and its rates are not given.
        """
        first, second = [], []
        for factor, slope, curve in zip(factors, slopes, curves, strict=True):
            if factor.signal != NONE:
                if motion.signals is None:
                    raise ValueError("the tree uses signals and their rates were not given")
                first.append(motion.signals[1, factor.signal])
                second.append(motion.signals[2, factor.signal])
                continue
            rate, pace = motion.qdot[factor.coordinate], motion.qddot[factor.coordinate]
            if slope is None or curve is None:
                first.append(rate)
                second.append(pace)
            else:
                first.append(slope * rate)
                second.append(curve * rate**2 + slope * pace)
        return cls(first, second)

    def of_terms(self, terms: Sequence[TermArrays], p: Array) -> tuple[Array, Array]:
        """Rates of the scalar parts of some terms, each (n_terms, n)."""
        scale = np.array([1.0 if t.parameter == NONE else p[t.parameter] for t in terms])[:, None]
        first = np.array([self.first[t.factor] for t in terms])
        second = np.array([self.second[t.factor] for t in terms])
        return scale * first, scale * second
