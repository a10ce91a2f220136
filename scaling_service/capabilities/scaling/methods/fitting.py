"""Fitting freed parameters to calibration frames: together with the motion, or in turn.

Many combinations of axes and marker coordinates change nothing that markers could show: a thigh's
markers may turn about its long axis while hip rotation turns back. Others change so little that
skin movement decides them. The paper's loop leaves them near their start because it stops early;
solved to the end, they drift to their bounds. Here a prior around the first guess holds them: its
weight against the markers is their noise, taken from the residuals and lengthened by how often the
same is seen again, over the prior's variance.
"""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.motion.inverse_kinematics import solve_task
from scaling_service.capabilities.motion.task import Task
from scaling_service.capabilities.shared.settings import CalibrationSettings
from scaling_service.core.arrays import Array
from scaling_service.core.errors import TrialUnusable
from scaling_service.model.body import BodyModel
from scaling_service.model.trial import Trial
from scaling_service.numerics.least_squares import estimator
from scaling_service.numerics.least_squares import problem as problems

_FEWEST_BLOCKS = 4  # chosen: of fewer trials, stretches of equal length stand for independent parts

_ROUNDS = 12  # chosen: the weight of the prior settles in three or four
_SETTLED = 0.1  # chosen: relative change of the noise that no longer matters


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationFrames:
    """Frames of several trials as one recording, and the block (trial, or part of it) of each frame."""

    trial: Trial
    blocks: NDArray[np.intp]


def choose_calibration_frames(
    trials: abc.Sequence[Trial], markers: abc.Sequence[str], count: int
) -> CalibrationFrames:
    """Frames equally spaced in time over all calibration trials (Puchaud 2019, section 2.2.4).

    Frames that show none of the markers are passed over.

    Raises TrialUnusable: there is no frame to calibrate on.
    """
    measured = np.concatenate([np.zeros((0, len(markers), 3)), *(t.select(markers).markers for t in trials)])
    usable = np.flatnonzero(problems.find_seen(measured).any(axis=1))
    if not len(usable):
        raise TrialUnusable(
            "no calibration trial shows a marker of the model",
            field="trials.calibration",
            remedy="Give at least one functional movement under `trials: calibration:`",
        )
    chosen = usable[np.unique(np.linspace(0, len(usable) - 1, min(count, len(usable))).round().astype(int))]
    clock = np.arange(len(chosen), dtype=float)  # several trials: their order is all they share
    recording = Trial(
        name="calibration", times=clock, labels=tuple(markers), markers=measured[chosen], rate_hz=1.0
    )
    parts = -(-_FEWEST_BLOCKS // len(trials))
    labels = [k * parts + (np.arange(t.n_frames) * parts) // t.n_frames for k, t in enumerate(trials)]
    return CalibrationFrames(recording, np.concatenate(labels).astype(np.intp)[chosen])


Progress = abc.Callable[[int, float], None]
"""Called with the number of a step and what it left, m2."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Fit:
    """The bordered problem of one calibration, and where it starts."""

    task: Task
    problem: problems.Problem
    q0: Array
    p0: Array
    prior_sd: Array
    blocks: NDArray[np.intp]

    @classmethod
    def of(
        cls, model: BodyModel, freed: BodyModel, frames: CalibrationFrames, settings: CalibrationSettings
    ) -> Fit:
        """Pose the problem: ``freed`` is the start's ``model`` with parameters."""
        q0 = solve_task(Task.of(model, frames.trial), frames.trial.times).q
        loss = problems.SQUARED if settings.robust_m is None else problems.Huber(settings.robust_m)
        task = Task.of(freed, frames.trial)
        lower = np.array([p.lower for p in freed.parameters])
        upper = np.array([p.upper for p in freed.parameters])
        wide = [np.inf if p.prior_sd is None or not settings.prior else p.prior_sd for p in freed.parameters]
        problem = problems.Problem(
            tree=task.tree,
            measured=task.measured,
            weights=task.weights,
            coordinates=np.flatnonzero(task.free),
            parameters=np.arange(len(freed.parameters)),
            scale=0.5 * (upper - lower),
            lower=lower,
            upper=upper,
            prior_weight=np.zeros(len(freed.parameters)),
            coordinate_bounds=task.bounds,
            loss=loss,
            closure=task.closure,
        )
        return cls(
            task=task, problem=problem, q0=q0, p0=task.p, prior_sd=np.array(wide), blocks=frames.blocks
        )

    def with_prior(self, variance: float) -> Fit:
        """The same fit with the prior weighed against this noise (m2)."""
        return replace(self, problem=replace(self.problem, prior_weight=variance / self.prior_sd**2))

    def noise(self, q: Array, p: Array) -> float:
        """Variance of a marker coordinate in one frame as if frames were independent (m2)."""
        variance = estimator.estimate_residual_variance(self.problem, q, p)
        return variance * estimator.estimate_repetition(self.problem, q, p, self.blocks, variance)

    def error(self, solution: problems.Solution) -> float:
        """The cumulative kinematic error alone, without the prior's share (Puchaud 2019, eq. 1; m2)."""
        return estimator.compute_total_cost(self.with_prior(0.0).problem, solution.q, solution.p, self.p0)


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """A solution with the fit that it solves, and the noise of one independent frame (m2)."""

    fit: Fit
    solution: problems.Solution
    variance: float


def fit_together(fit: Fit, _: CalibrationSettings, progress: Progress | None) -> Fitted:
    """Motion and parameters in one bordered problem, the prior weighed by the noise that is left."""
    steps = 0
    solution = problems.Solution(q=fit.q0, p=fit.p0, cost=np.inf, steps=0, outcome=problems.Outcome.MAX_STEPS)
    variance = fit.noise(fit.q0, fit.p0)
    for _round in range(_ROUNDS):
        weighed = fit.with_prior(variance)
        report = None if progress is None else partial(count_on, progress, steps)
        solution = estimator.solve(weighed.problem, solution.q, fit.p0, progress=report, start=solution.p)
        steps += solution.steps
        before, variance = variance, weighed.noise(solution.q, solution.p)
        if abs(variance - before) <= _SETTLED * before or not np.isfinite(fit.prior_sd).any():
            break
    return Fitted(fit.with_prior(variance), replace(solution, steps=steps), variance)


def count_on(progress: Progress, before: int, number: int, cost: float) -> None:
    """Report steps of several looks as one count."""
    progress(before + number, cost)


def fit_in_turn(fit: Fit, settings: CalibrationSettings, progress: Progress | None) -> Fitted:
    """Inverse kinematics and parameters in turn, until the cost hardly changes (Puchaud 2019, 2.2.4)."""
    q, p = fit.q0, fit.p0
    cost, outcome, loop = (
        estimator.compute_total_cost(fit.problem, q, p, fit.p0),
        problems.Outcome.MAX_STEPS,
        0,
    )
    while outcome is problems.Outcome.MAX_STEPS and loop < settings.max_loops:
        loop += 1
        p = estimator.solve(fit.problem.hold_motion(), q, fit.p0, start=p).p
        q = solve_task(fit.task.at(p), np.arange(len(q), dtype=float), q).q
        before, cost = cost, estimator.compute_total_cost(fit.problem, q, p, fit.p0)
        if progress is not None:
            progress(loop, cost)
        if abs(before - cost) < settings.loop_tolerance * before:
            outcome = problems.Outcome.CONVERGED
    return Fitted(fit, problems.Solution(q=q, p=p, cost=cost, steps=loop, outcome=outcome), fit.noise(q, p))
