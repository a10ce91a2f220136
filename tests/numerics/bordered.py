"""Bordered problems with a known truth: a leg, its motion and its free parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from scaling_service.model.body import BodyModel, Parameter
from scaling_service.model.compile import compile_model, list_parameter_values
from scaling_service.model.parameters import free_axis, free_marker, free_scale
from scaling_service.numerics.least_squares.problem import Problem, Settings
from scaling_service.numerics.multibody.tree import pose_markers
from tests.numerics.bodies import Array, leg, leg_motion

TIGHT = Settings(max_steps=300, left=1e-15)


@dataclass(frozen=True, eq=False)
class Case:
    """A problem with its truth and a start away from it."""

    problem: Problem
    model: BodyModel
    q: Array
    p: Array
    q0: Array
    p0: Array

    def measured(self, rng: np.random.Generator, noise: float) -> Problem:
        exact = pose_markers(self.problem.tree, self.q, self.p)
        return replace(self.problem, measured=exact + rng.normal(0.0, noise, exact.shape))


def freed(rng: np.random.Generator, *, coupled: bool = False) -> BodyModel:
    model = leg(rng, coupled=coupled)
    model = free_scale(free_scale(model, "pelvis", 0.2), "femur", 0.2)
    model = free_axis(model, "knee", 0.3, 0.5)
    return free_marker(free_marker(model, "femur1", "x", 0.05), "tibia2", "z", 0.05)


def case(
    seed: int, *, n: int = 8, noise: float = 0.003, model: BodyModel | None = None, spread: float = 0.03
) -> Case:
    rng = np.random.default_rng(seed)
    model = freed(rng) if model is None else model
    start = list_parameter_values(model)
    truth = start + rng.uniform(-spread, spread, len(start))
    tree, q = compile_model(model), leg_motion(rng, n)
    exact = pose_markers(tree, q, truth)
    problem = make(model, exact + rng.normal(0.0, noise, exact.shape))
    return Case(problem, model, q, truth, q + rng.normal(0.0, 0.02, q.shape), start)


def make(model: BodyModel, measured: Array) -> Problem:
    free: tuple[Parameter, ...] = model.parameters
    nq = len(model.coordinates)
    return Problem(
        tree=compile_model(model),
        measured=measured,
        weights=np.linspace(0.8, 1.3, len(model.markers)),
        coordinates=np.arange(nq),
        parameters=np.arange(len(free)),
        scale=np.array([0.05] * len(free)),
        lower=np.array([p.lower for p in free]),
        upper=np.array([p.upper for p in free]),
        prior_weight=np.zeros(len(free)),
        coordinate_bounds=(np.full(nq, -np.inf), np.full(nq, np.inf)),
    )
