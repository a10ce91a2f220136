"""A kinematic problem: markers to be explained by coordinates per frame and shared parameters; its answer."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from enum import Enum
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.arrays import Array
from scaling_service.core.arrays import Mask as Mask
from scaling_service.numerics.least_squares import descent
from scaling_service.numerics.multibody import tree as trees
from scaling_service.numerics.multibody.closure import Closure

_BLOCK = 256  # frames linearised together
_DAMPING = descent.Damping(ease=0.2, tighten=8.0, least=1e-12, lost=1e12)  # of coordinates (chosen)
CLOSING = 1e6
"""Weight of an equation that a pose must obey, as a share of all markers' (chosen: residuals of 1 cm then
open it by 10 nm at most, and ten digits are left for the markers)."""


class Loss(Protocol):
    """Cost of squared distances (m2), any shape, and their weight in iteratively reweighted least squares.

    Huber 1964.
    """

    def cost(self, squared: Array) -> Array:
        """Cost, equal to ``squared`` near zero."""

    def weight(self, squared: Array) -> Array:
        """Derivative of the cost with respect to ``squared``."""


@dataclasses.dataclass(frozen=True, slots=True)
class Squared:
    """Plain least squares."""

    def cost(self, squared: Array) -> Array:
        """The squared distance itself."""
        return squared

    def weight(self, squared: Array) -> Array:
        """One."""
        return np.ones_like(squared)


@dataclasses.dataclass(frozen=True, slots=True)
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


SQUARED = Squared()


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class Problem:
    """Markers to be explained by coordinates per frame and parameters shared by all frames."""

    tree: trees.Tree
    measured: Array  # (n_frames, n_markers, 3), m: NaN where a marker was not seen
    weights: Array  # (n_markers,)
    coordinates: NDArray[np.intp]  # (n_free_coordinates,): the coordinates to estimate
    parameters: NDArray[np.intp]  # (n_free,): the parameters to estimate
    # scale, lower, upper: (n_free,): size of a typical change (for normalisation) and bounds
    scale: Array
    lower: Array
    upper: Array
    # (n_free,): weight of ``(p - p0)**2`` beside the weighted squared distances; zero for none
    prior_weight: Array
    coordinate_bounds: tuple[Array, Array]  # each (n_coordinates,)
    loss: Loss = SQUARED
    # Values and weights of ``(q - value)**2`` beside the squared distances, each (n_frames, n_coordinates)
    coordinate_prior: tuple[Array, Array] | None = None
    closure: Closure | None = None  # what every pose must obey
    # Whether coordinates are kept where the closure is obeyed; otherwise it counts as one more marker
    closed: bool = True

    @property
    def n_frames(self) -> int:
        """The number of frames."""
        return len(self.measured)

    @property
    def variables(self) -> NDArray[np.intp]:
        """Free coordinates, then free parameters, as the tree numbers them."""
        return np.concatenate([self.coordinates, self.tree.n_coordinates + self.parameters])

    def blocks(self) -> Iterator[slice]:
        """Frames to be linearised together."""
        return (slice(k, min(k + _BLOCK, self.n_frames)) for k in range(0, self.n_frames, _BLOCK))

    def of_frames(self, rows: NDArray[np.intp]) -> Problem:
        """The same of some frames."""
        prior = self.coordinate_prior
        prior = None if prior is None else (prior[0][rows], prior[1][rows])
        return dataclasses.replace(self, measured=self.measured[rows], coordinate_prior=prior)

    @property
    def closing(self) -> float:
        """The weight of the closure's equations."""
        return float(self.weights.sum()) * (CLOSING if self.closed else 1.0)

    def hold_motion(self) -> Problem:
        """The same with no coordinate to estimate, only parameters."""
        return dataclasses.replace(self, coordinates=np.zeros(0, dtype=np.intp))


class Outcome(Enum):
    """How an iteration ended."""

    CONVERGED = "converged"
    MAX_STEPS = "max_steps"


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Settings(descent.Settings):
    """When to stop, and how strongly to damp: a share of the curvature of coordinates and of parameters."""

    max_steps: int = 100
    damping: float = 1e-4
    rule: descent.Damping = _DAMPING
    left: float = 1e-8
    alike: bool = True
    left_over: float = 1e-26  # m2: a decrease that double precision cannot show on positions of 1 m


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Solution:
    """Coordinates (n_frames, n_coordinates), parameters (n_parameters,), cost (m2) and how it ended."""

    q: Array
    p: Array
    cost: float
    steps: int
    outcome: Outcome


def find_seen(positions: NDArray[np.float64]) -> Mask:
    """Whether each position is known.

    ``positions`` (..., 3): NaN in any coordinate means that the point was not seen.
    Returns bool (...).
    """
    return np.asarray(np.isfinite(positions).all(axis=-1))


def find_shown(positions: NDArray[np.float64]) -> Mask:
    """Which markers some frame shows.

    ``positions`` (n_frames, n_markers, 3). Returns bool (n_markers,).
    """
    return np.asarray(find_seen(positions).any(axis=0))
