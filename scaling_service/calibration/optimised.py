"""Optimisation-based scaling: parameters that make the model follow the calibration movements.

Minimises the cumulative kinematic error over frames equally spaced in time (Puchaud 2019, eq. 1
and 2), either as the paper does, alternating inverse kinematics and parameters, or for motion and
parameters together, which reaches a minimum of both.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from scaling_service.calibration.freedom import Freedom, knee_joints
from scaling_service.calibration.settings import CalibrationSettings
from scaling_service.core.errors import TrialUnusable
from scaling_service.core.text import few
from scaling_service.estimation.inverse_kinematics import Task, solve_task
from scaling_service.kernels.estimator import (
    Outcome,
    Solution,
    Uncertainty,
    solve,
    solve_parameters,
    uncertainty,
)
from scaling_service.kernels.laws import Array
from scaling_service.kernels.losses import SQUARED, Huber
from scaling_service.kernels.masks import ever, seen
from scaling_service.kernels.problem import Problem, total_cost
from scaling_service.models.body import BodyModel
from scaling_service.models.parameters import fold
from scaling_service.models.results import Calibration, EstimatedParameter
from scaling_service.models.trial import Trial

Progress = Callable[[int, float], None]
_DETERMINED = 1e-4  # share of a parameter's direction that may lie where the recording says nothing
_UNIFORM = math.sqrt(12.0)  # range over standard deviation of a uniform distribution


def calibration_frames(trials: Sequence[Trial], markers: Sequence[str], count: int) -> Trial:
    """Frames equally spaced in time over all calibration trials, as one recording.

    Frames that show none of the markers are passed over.

    Raises
    ------
    TrialUnusable
        There is no frame to calibrate on.
    """
    columns = [t.selected(markers) for t in trials]
    measured = np.concatenate([t.markers for t in columns]) if columns else np.zeros((0, len(markers), 3))
    usable = np.flatnonzero(seen(measured).any(axis=1))
    if not len(usable):
        raise TrialUnusable(
            "no calibration trial shows a marker of the model",
            field="trials.calibration",
            remedy="Give at least one functional movement under `trials: calibration:`",
        )
    chosen = usable[np.unique(np.linspace(0, len(usable) - 1, min(count, len(usable))).round().astype(int))]
    clock = np.arange(
        len(chosen), dtype=float
    )  # the frames come from several trials: order is all they share
    return Trial("calibration", clock, tuple(markers), measured[chosen], 1.0)


def optimise(
    method: str,
    start: Calibration,
    trials: Sequence[Trial],
    freedom: Freedom,
    settings: CalibrationSettings,
    progress: Progress | None = None,
) -> Calibration:
    """Free what the method frees on the start's model, and fit it to the calibration trials.

    Parameters
    ----------
    start : Calibration
        The linear (MB) or image-based (EB) model: the first guess.
    progress : callable, optional
        Called with the step's number and the cumulative kinematic error (m2).

    Raises
    ------
    TrialUnusable
        No calibration trial shows a marker of the model.
    """
    clock = time.perf_counter()
    names = [m.name for m in start.model.markers if m.weight > 0.0]
    frames = calibration_frames(trials, names, settings.n_frames)
    shown = frozenset(n for n, once in zip(names, ever(seen(frames.markers)), strict=True) if once)
    freed = freedom.apply(start.model, shown, settings)
    fit = _Fit.of(start.model, freed, frames, settings)
    solution = STRATEGIES[settings.strategy](fit, settings, progress)
    doubt = uncertainty(fit.problem, solution, fit.p0)
    estimated = _parameters(freed, solution.p, doubt)
    values = {p.name: p.value for p in estimated}
    return Calibration(
        method,
        fold(freed, values),
        start.generic,
        _factors(start, values),
        _tilts(start, values),
        estimated,
        solution.cost,
        solution.steps,
        time.perf_counter() - clock,
        (*start.warnings, *_warnings(method, estimated, solution, doubt)),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """The bordered problem of one calibration, and where it starts."""

    task: Task
    problem: Problem
    q0: Array
    p0: Array

    @classmethod
    def of(cls, model: BodyModel, freed: BodyModel, frames: Trial, settings: CalibrationSettings) -> _Fit:
        q0 = solve_task(Task.of(model, frames), frames.times).q
        loss = SQUARED if settings.robust_m is None else Huber(settings.robust_m)
        task = Task.of(freed, frames)
        lower = np.array([p.lower for p in freed.parameters])
        upper = np.array([p.upper for p in freed.parameters])
        problem = Problem(
            task.tree,
            task.measured,
            task.weights,
            np.flatnonzero(task.free),
            np.arange(len(freed.parameters)),
            0.5 * (upper - lower),
            lower,
            upper,
            np.zeros(len(freed.parameters)),
            task.bounds,
            loss=loss,
        )
        return cls(task, problem, q0, task.p)


def _together(fit: _Fit, _: CalibrationSettings, progress: Progress | None) -> Solution:
    """Motion and parameters in one bordered problem."""
    return solve(fit.problem, fit.q0, fit.p0, progress=progress)


def _alternating(fit: _Fit, settings: CalibrationSettings, progress: Progress | None) -> Solution:
    """Inverse kinematics and parameters in turn, until the cost hardly changes (Puchaud 2019, 2.2.4)."""
    q, p = fit.q0, fit.p0
    cost = total_cost(fit.problem, q, p, fit.p0)
    for loop in range(1, settings.max_loops + 1):
        found = solve_parameters(fit.problem, q, fit.p0, p)
        p = found.p
        q = solve_task(fit.task.at(p), np.arange(len(q), dtype=float), q).q
        before, cost = cost, total_cost(fit.problem, q, p, fit.p0)
        if progress is not None:
            progress(loop, cost)
        if abs(before - cost) < settings.loop_tolerance * before:
            return Solution(q, p, cost, loop, Outcome.CONVERGED)
    return Solution(q, p, cost, settings.max_loops, Outcome.MAX_STEPS)


STRATEGIES = {"joint": _together, "alternating": _alternating}


def _parameters(freed: BodyModel, p: Array, doubt: Uncertainty) -> tuple[EstimatedParameter, ...]:
    found = []
    for k, parameter in enumerate(freed.parameters):
        at_bound = bool(doubt.at_bound[k])
        narrow = at_bound or doubt.sd[k] < (parameter.upper - parameter.lower) / _UNIFORM
        known = bool(narrow and doubt.undetermined[k] <= _DETERMINED)
        found.append(
            EstimatedParameter(
                parameter.name,
                float(p[k]),
                parameter.unit,
                float(doubt.sd[k]),
                at_bound,
                known,
                parameter.group,
                parameter.target,
            )
        )
    return tuple(found)


def _factors(start: Calibration, values: dict[str, float]) -> dict[str, tuple[float, float, float]]:
    factors = {}
    for segment in start.model.segment_names:
        x, y, z = start.scale_factors.get(segment, (1.0, 1.0, 1.0))
        k = values.get(f"scale.{segment}", 1.0)
        factors[segment] = (k * x, k * y, k * z)
    return factors


def _tilts(start: Calibration, values: dict[str, float]) -> dict[str, tuple[float, float]]:
    return {
        joint: (values.get(f"axis.{joint}.x", 0.0), values.get(f"axis.{joint}.y", 0.0))
        for joint in knee_joints(start.model)
    }


def _warnings(
    method: str, estimated: Sequence[EstimatedParameter], solution: Solution, doubt: Uncertainty
) -> tuple[str, ...]:
    found = []
    if solution.outcome is not Outcome.CONVERGED:
        found.append(f"{method}: stopped after {solution.steps} steps before it converged")
    bound = [p.name for p in estimated if p.at_bound]
    loose = [p.name for p in estimated if not p.identifiable]
    if bound:
        found.append(
            f"{method}: {len(bound)} of {len(estimated)} parameters stopped at their bounds: {few(bound)}"
        )
    if doubt.free_directions:
        found.append(
            f"{method}: {doubt.free_directions} combinations of parameters are not determined by these "
            f"recordings; they were left near their start, and these alone mean little: {few(loose)}"
        )
    return tuple(found)
