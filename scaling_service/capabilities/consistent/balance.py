"""The step that serves two objectives alike: goal attainment on the Pareto front of their quadratic models.

Both objectives are counted in units of what is expected of them, and both goals are zero (Futamure et al.,
section II.C.1). The point of the front that comes nearest to the goals in the largest of both is where both
are equal. Points of the front minimise weighted sums, so one weight is sought.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.signals.splines_band import Quadratic, Step, banded, solve_band

RIDGE = 1e-9
"""Share of the mean diagonal that holds coefficients which nothing is said about (chosen: far above rounding,
far below what one frame says)."""

SMALLEST, LARGEST = 1e-3, 1e3
"""Weights of the wrench between which the balance is sought (chosen: at the ends one objective hardly
counts)."""

NEAR = 0.02
"""Relative difference of both objectives that no longer matters (chosen)."""

TRIES = 20
"""Most weights tried (chosen: five are usual)."""

ROUNDS = 8
"""Most times that coefficients are put on their bounds (chosen: three are usual)."""


@dataclass(frozen=True, slots=True, eq=False)
class Balanced:
    """A step on the front.

    Parameters
    ----------
    step : Step
    weight : float
        Of the wrench, where the markers' is one. At ``SMALLEST`` the markers alone attain the wrench's goal
        as well as their own.
    objectives : (float, float)
        Markers and wrench, as the quadratic models have them.
    """

    step: Step
    weight: float
    objectives: tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Front:
    """Minimises weighted sums of two quadratics between bounds.

    Parameters
    ----------
    markers, wrench : Quadratic
    at : ndarray, shape (n_coefficients, m)
        The coefficients that steps start from.
    bounds : two ndarrays, shape (m,)
    bands : two ndarrays
        Lower bands of both matrices.
    """

    markers: Quadratic
    wrench: Quadratic
    at: Array
    bounds: tuple[Array, Array]
    bands: tuple[Array, Array]

    @classmethod
    def of(cls, markers: Quadratic, wrench: Quadratic, at: Array, bounds: tuple[Array, Array]) -> Front:
        """Pose it."""
        return cls(markers, wrench, at, bounds, (banded(markers.blocks), banded(wrench.blocks)))

    def step(self, weight: float) -> Step:
        """The step that minimises markers + weight * wrench between the bounds.

        Coefficients that would pass a bound are put on it, and the others solved again.
        """
        gradient = self.markers.gradient + weight * self.wrench.gradient
        low, high = (bound - self.at for bound in self.bounds)
        held: NDArray[np.bool_] = ((low >= 0) & (gradient > 0)) | ((high <= 0) & (gradient < 0))
        fixed = np.zeros_like(gradient)
        for _ in range(ROUNDS):
            found = self._solved(weight, gradient, fixed, held)
            beyond = ((found.coefficients < low) | (found.coefficients > high)) & ~held
            if not beyond.any():
                break
            held |= beyond
            fixed = np.where(held, np.clip(found.coefficients, low, high), 0.0)
        return Step(np.asarray(np.clip(found.coefficients, low, high)), found.shared)

    def _solved(self, weight: float, gradient: Array, fixed: Array, held: NDArray[np.bool_]) -> Step:
        """Everything but the held coefficients, which change by ``fixed``; shared numbers by elimination."""
        markers, wrench = self.markers, self.wrench
        band = self.bands[0] + weight * self.bands[1]
        band[0] += RIDGE * band[0].mean()
        border = markers.border + weight * wrench.border
        k = border.shape[2]
        slope = gradient + markers.times(fixed) + weight * wrench.times(fixed)
        right = np.concatenate([slope[..., None], border], axis=2).reshape(-1, k + 1)
        solved = solve_band(band, right, held.ravel())
        flat = np.where(held.ravel()[:, None], 0.0, border.reshape(-1, k))
        corner = markers.corner + weight * wrench.corner - flat.T @ solved[:, 1:]
        pull = markers.shared_gradient + weight * wrench.shared_gradient
        pull = pull + np.einsum("amk,am->k", border, fixed) - flat.T @ solved[:, 0]
        shared = np.linalg.solve(corner, -pull) if k else np.zeros(0)
        return Step(fixed - (solved[:, 0] + solved[:, 1:] @ shared).reshape(fixed.shape), shared)

    def objectives(self, step: Step) -> tuple[float, float]:
        """Both after a step."""
        return self.markers.at(step), self.wrench.at(step)


def balanced(front: Front, guess: float = 1.0) -> Balanced:
    """Find the weight at which both objectives are equal.

    Parameters
    ----------
    front : Front
    guess : float
        The weight to try first.

    Notes
    -----
    Along the front the ratio of both falls about as a power of the weight, so a step in logarithms is tried,
    and the interval halved where it leaves it.
    """
    low, high = np.log(SMALLEST), np.log(LARGEST)
    weight = float(np.clip(np.log(guess), low, high))
    for _ in range(TRIES):
        step = front.step(float(np.exp(weight)))
        objectives = front.objectives(step)
        markers, wrench = (max(value, np.finfo(float).tiny) for value in objectives)
        if abs(markers - wrench) <= NEAR * max(markers, wrench) or high - low <= NEAR:
            break
        low, high = (weight, high) if wrench > markers else (low, weight)
        tried = weight + float(np.log(wrench / markers))
        weight = tried if low < tried < high else 0.5 * (low + high)
    return Balanced(step, float(np.exp(weight)), objectives)
