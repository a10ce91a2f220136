"""Motions of a leg with what was measured of them, for the tests of the sweeps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from hypothesis import strategies as st

from scaling_service.model.body import BodyModel
from scaling_service.model.compile import compile_model, list_parameter_values
from scaling_service.numerics.multibody.sweep import SweepSettings, solve_motion
from scaling_service.numerics.multibody.tree import pose_markers
from tests.numerics.bodies import Array, leg, leg_motion

SEEDS = st.integers(0, 10_000)
TIGHT = SweepSettings(max_steps=300, left=1e-13)


@dataclass(frozen=True, eq=False)
class Case:
    """A motion, what was measured of it, and everything that enters the cost."""

    model: BodyModel
    truth: Array
    start: Array
    measured: Array
    weights: Array
    options: dict[str, Any]

    def solve(self, how: SweepSettings = TIGHT) -> Any:
        tree = compile_model(self.model)
        p = list_parameter_values(self.model)
        return solve_motion(tree, self.measured, self.weights, self.start, p, settings=how, **self.options)

    def rows(self, q: Array, frame: int) -> Array:
        """The residuals of one frame: weighted gaps, then the priors'."""
        p = list_parameter_values(self.model)
        gap = pose_markers(compile_model(self.model), q[None], p)[0] - self.measured[frame]
        weights = self.weights[frame] if self.weights.ndim == 2 else self.weights
        data = (np.nan_to_num(gap) * np.sqrt(weights)[:, None]).ravel()
        if "prior" not in self.options:
            return data
        value, pull = self.options["prior"]
        return np.concatenate([data, np.sqrt(pull) * (q - value[frame])])


def case(seed: int, *, noise: float = 0.01, n: int = 6, **options: Any) -> Case:
    rng = np.random.default_rng(seed)
    model = leg(rng)
    truth = leg_motion(rng, n)
    exact = pose_markers(compile_model(model), truth, np.zeros(0))
    measured = exact + rng.normal(0.0, noise, exact.shape)
    start = truth + rng.normal(0.0, 0.05, truth.shape)
    return Case(model, truth, start, measured, rng.uniform(0.5, 3.0, len(model.markers)), options)
