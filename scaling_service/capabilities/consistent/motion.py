"""Dynamically consistent inverse kinematics: the motion that markers and ground wrench agree on best."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scaling_service.capabilities.consistent.balance import Balanced, Front, balanced
from scaling_service.capabilities.consistent.problem import ConsistentProblem, Objectives, State
from scaling_service.capabilities.dynamics.inverse_dynamics import RatedMotion
from scaling_service.numerics.multibody.laws import Array

STEPS = 15
"""Most Gauss-Newton steps (chosen: three are usual)."""

SETTLED = 1e-2
"""Relative change of both objectives that no longer matters (chosen)."""

HALVINGS = 8
"""Most times that a step is halved (chosen)."""


@dataclass(frozen=True, slots=True, eq=False)
class ConsistentMotion:
    """A motion and how it was balanced.

    Parameters
    ----------
    rated : RatedMotion
        Velocities and accelerations are exact derivatives of the angles.
    state : State
        Coefficients of the splines of the free coordinates, and the shared numbers.
    objectives : Objectives
    glide : ndarray, shape (n, n_markers, 3), m
        How far markers glide on their segments, in ground axes: the artefact that follows the joints.
    weight : float
        Of the wrench against the markers, where both goals are attained alike.
    steps : int
    converged : bool
    """

    rated: RatedMotion
    state: State
    objectives: Objectives
    glide: Array
    weight: float
    steps: int
    converged: bool


def consistent_motion(
    problem: ConsistentProblem, start: State, bounds: tuple[Array, Array], weight: float = 1.0
) -> ConsistentMotion:
    """Balance markers against ground wrench (Futamure et al., eq. 6).

    Parameters
    ----------
    problem : ConsistentProblem
    start : State
    bounds : two ndarrays, shape (m,)
        Of the free coordinates.
    weight : float
        Where the search for the balance begins.

    Notes
    -----
    Gauss-Newton on both objectives. At every step the weight is sought at which both, in units of what is
    expected of them, are equal: goal attainment with the goal zero, as in the paper.
    """
    at = State(np.clip(start.coefficients, *bounds), start.shared)
    now, converged, steps = problem.objectives(at), False, 0
    while not converged and steps < STEPS:
        steps += 1
        front = Front.of(*problem.normal(at), at.coefficients, bounds)
        found = balanced(front, weight)
        weight = found.weight
        after, at = _descended(problem, at, now, found)
        changes = (abs(after.markers / now.markers - 1.0), abs(after.wrench / now.wrench - 1.0))
        converged, now = max(changes) < SETTLED, after
    return ConsistentMotion(_rated(problem, at), at, now, problem.glide(at), weight, steps, converged)


def _descended(
    problem: ConsistentProblem, at: State, now: Objectives, found: Balanced
) -> tuple[Objectives, State]:
    """The step, halved until the weighted sum falls; where it never does, no step."""
    before = now.markers + found.weight * now.wrench
    for halving in range(HALVINGS):
        share = 0.5**halving
        moved = State(
            at.coefficients + share * found.step.coefficients, at.shared + share * found.step.shared
        )
        after = problem.objectives(moved)
        if after.markers + found.weight * after.wrench < before:
            return after, moved
    return now, at


def _rated(problem: ConsistentProblem, at: State) -> RatedMotion:
    motion = problem.motion(at.coefficients)
    parts = [np.ascontiguousarray(x.T) for x in (motion.q, motion.qdot, motion.qddot)]
    return RatedMotion(problem.basis.times, *parts)
