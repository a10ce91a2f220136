"""Dynamically consistent inverse kinematics: the motion that markers and ground wrench agree on best."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.consistent import problem as problems
from scaling_service.capabilities.kinetics.inverse_dynamics import RatedMotion
from scaling_service.core.arrays import Array
from scaling_service.numerics.signals import splines

STEPS = 15
"""Most Gauss-Newton steps (chosen: three are usual)."""

SETTLED = 1e-2
"""Relative change of both objectives that no longer matters (chosen)."""

HALVINGS = 8
"""Most times that a step is halved (chosen)."""

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


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ConsistentMotion:
    """A motion and how it was balanced."""

    rated: RatedMotion  # velocities and accelerations are exact derivatives of the angles
    state: splines.Unknowns  # coefficients of the splines of the free coordinates, and the shared numbers
    objectives: problems.Objectives
    # (n, n_markers, 3), m: how far markers glide on their segments, in ground axes: the artefact that follows
    # the joints
    glide: Array
    weight: float  # of the wrench against the markers, where both goals are attained alike


def solve_consistent_motion(
    problem: problems.ConsistentProblem,
    start: splines.Unknowns,
    bounds: tuple[Array, Array],
    weight: float = 1.0,
) -> ConsistentMotion:
    """Balance markers against ground wrench (Futamure et al., eq. 6).

    ``bounds`` (m,) are those of the free coordinates; the search for the balance begins at ``weight``.
    Gauss-Newton on both objectives. At every step the weight is sought at which both, in units of what is
    expected of them, are equal: goal attainment with the goal zero, as in the paper.
    So what is minimised changes from step to step, and both objectives must settle.
    """
    at = splines.Unknowns(np.clip(start.coefficients, *bounds), start.shared)
    now = problem.objectives(at)
    for _ in range(STEPS):
        markers, wrench = problem.normal(at)
        front = Front(markers=markers, wrench=wrench, at=at.coefficients, bounds=bounds)
        step, weight = balance(front, weight)
        after, at = _descend(problem, at, now, step, weight)
        changes = (abs(after.markers / now.markers - 1.0), abs(after.wrench / now.wrench - 1.0))
        now = after
        if max(changes) < SETTLED:
            break
    motion = problem.motion(at.coefficients)
    parts = [np.ascontiguousarray(x.T) for x in (motion.q, motion.qdot, motion.qddot)]
    return ConsistentMotion(
        rated=RatedMotion(problem.basis.times, *parts),
        state=at,
        objectives=now,
        glide=problem.glide(at),
        weight=weight,
    )


def _descend(
    problem: problems.ConsistentProblem,
    at: splines.Unknowns,
    now: problems.Objectives,
    step: splines.Unknowns,
    weight: float,
) -> tuple[problems.Objectives, splines.Unknowns]:
    """The step, halved until the weighted sum falls; where it never does, no step."""
    before = now.markers + weight * now.wrench
    for halving in range(HALVINGS):
        share = 0.5**halving
        moved = splines.Unknowns(at.coefficients + share * step.coefficients, at.shared + share * step.shared)
        after = problem.objectives(moved)
        if after.markers + weight * after.wrench < before:
            return after, moved
    return now, at


@dataclass(frozen=True, eq=False, kw_only=True)
class Front:
    """Minimises weighted sums of two quadratics between bounds."""

    markers: splines.Quadratic
    wrench: splines.Quadratic
    at: Array  # (n_coefficients, m): the coefficients that steps start from
    bounds: tuple[Array, Array]  # (m,)

    @cached_property
    def bands(self) -> tuple[Array, Array]:
        """Lower bands of both matrices."""
        return splines.pack_band(self.markers.blocks), splines.pack_band(self.wrench.blocks)

    def step(self, weight: float) -> splines.Unknowns:
        """The step that minimises markers + weight * wrench between the bounds.

        Coefficients that would pass a bound are put on it, and the others solved again.
        """
        gradient = self.markers.gradient + weight * self.wrench.gradient
        low, high = (bound - self.at for bound in self.bounds)
        held: NDArray[np.bool_] = ((low >= 0) & (gradient > 0)) | ((high <= 0) & (gradient < 0))
        fixed = np.zeros_like(gradient)
        for _ in range(ROUNDS):
            # Everything but the held coefficients, which change by `fixed`; shared numbers by elimination.
            markers, wrench = self.markers, self.wrench
            band = self.bands[0] + weight * self.bands[1]
            band[0] += RIDGE * band[0].mean()
            border = markers.border + weight * wrench.border
            k = border.shape[2]
            slope = gradient + markers.times(fixed) + weight * wrench.times(fixed)
            right = np.concatenate([slope[..., None], border], axis=2).reshape(-1, k + 1)
            solved = splines.solve_band(band, right, held.ravel())
            flat = np.where(held.ravel()[:, None], 0.0, border.reshape(-1, k))
            corner = markers.corner + weight * wrench.corner - flat.T @ solved[:, 1:]
            pull = markers.shared_gradient + weight * wrench.shared_gradient
            pull = pull + np.einsum("amk,am->k", border, fixed) - flat.T @ solved[:, 0]
            shared = np.linalg.solve(corner, -pull) if k else np.zeros(0)
            found = fixed - (solved[:, 0] + solved[:, 1:] @ shared).reshape(fixed.shape)
            beyond = ((found < low) | (found > high)) & ~held
            if not beyond.any():
                break
            held |= beyond
            fixed = np.where(held, np.clip(found, low, high), 0.0)
        return splines.Unknowns(np.asarray(np.clip(found, low, high)), shared)


def balance(front: Front, guess: float) -> tuple[splines.Unknowns, float]:
    """The step at which both objectives are equal, and the weight of the wrench there.

    Both are counted in units of what is expected of them, and both goals are zero (Futamure et al., section
    II.C.1). The point of the Pareto front that comes nearest to the goals in the largest of both is where
    both are equal. Points of the front minimise weighted sums, so one weight is sought, from a guess. At
    ``SMALLEST`` the markers alone attain the wrench's goal as well as their own.

    Along the front the ratio of both falls about as a power of the weight, so a step in logarithms is tried,
    and the interval halved where it leaves it.
    """
    low, high = np.log(SMALLEST), np.log(LARGEST)
    weight = float(np.clip(np.log(guess), low, high))
    for _ in range(TRIES):
        step = front.step(float(np.exp(weight)))
        tiny = float(np.finfo(float).tiny)
        markers, wrench = max(front.markers.at(step), tiny), max(front.wrench.at(step), tiny)
        if abs(markers - wrench) <= NEAR * max(markers, wrench) or high - low <= NEAR:
            break
        low, high = (weight, high) if wrench > markers else (low, weight)
        tried = weight + float(np.log(wrench / markers))
        weight = tried if low < tried < high else 0.5 * (low + high)
    return step, float(np.exp(weight))
