"""What a squared distance costs: squared, or robust against outliers.

A loss maps the squared distance of one marker to its cost and to the weight that iteratively
reweighted least squares gives it (Huber 1964; Cauchy as in Holland & Welsch 1977).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from scaling_service.numerics.multibody.laws import Array


class Loss(Protocol):
    """Cost and weight of squared distances (m2), any shape."""

    def cost(self, squared: Array) -> Array:
        """Cost, equal to ``squared`` near zero."""

    def weight(self, squared: Array) -> Array:
        """Derivative of the cost with respect to ``squared``."""


@dataclass(frozen=True, slots=True)
class Squared:
    """Plain least squares."""

    def cost(self, squared: Array) -> Array:
        """The squared distance itself."""
        return squared

    def weight(self, squared: Array) -> Array:
        """One."""
        return np.ones_like(squared)


@dataclass(frozen=True, slots=True)
class Huber:
    """Quadratic up to ``scale_m``, linear beyond."""

    scale_m: float

    def cost(self, squared: Array) -> Array:
        """``d^2`` up to the scale, ``2 s d - s^2`` beyond."""
        distance = np.sqrt(squared)
        return np.where(distance <= self.scale_m, squared, self.scale_m * (2.0 * distance - self.scale_m))

    def weight(self, squared: Array) -> Array:
        """One up to the scale, ``s / d`` beyond."""
        distance = np.sqrt(np.maximum(squared, self.scale_m**2))
        return self.scale_m / distance


@dataclass(frozen=True, slots=True)
class Cauchy:
    """Logarithmic beyond ``scale_m``; outliers hardly count."""

    scale_m: float

    def cost(self, squared: Array) -> Array:
        """``s^2 log(1 + d^2 / s^2)``."""
        return self.scale_m**2 * np.log1p(squared / self.scale_m**2)

    def weight(self, squared: Array) -> Array:
        """``1 / (1 + d^2 / s^2)``."""
        return 1.0 / (1.0 + squared / self.scale_m**2)


SQUARED = Squared()
