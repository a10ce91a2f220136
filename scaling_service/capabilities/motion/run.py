"""Follow trials with a model that exists."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from scaling_service.capabilities.motion.inverse_kinematics import Task, motion_of, solve_task
from scaling_service.capabilities.motion.kinematic_error import kinematic_error
from scaling_service.capabilities.motion.poses import segment_poses
from scaling_service.capabilities.motion.result import MotionResult, TrackedTrial
from scaling_service.capabilities.motion.uncertainty import coordinate_sd
from scaling_service.model.body import BodyModel
from scaling_service.model.trial import Trial

Progress = Callable[[str, float], None]


def track_all(
    model: BodyModel, trials: Sequence[Trial], *, poses: bool = False, progress: Progress | None = None
) -> MotionResult:
    """Follow every trial with the model.

    Parameters
    ----------
    model : BodyModel
    trials : sequence of Trial
        Labels are the model's marker names, axes X forward, Y up, Z right.
    poses : bool
        Whether to tell where every segment is, too.
    progress : callable, optional
        Called with what is being done and the share that is done.

    Raises
    ------
    TrialUnusable
        A trial shows no marker of the model.
    """
    found = {}
    for k, trial in enumerate(trials):
        if progress is not None:
            progress(f"following {trial.name}", k / len(trials))
        found[trial.name] = track(model, trial, poses=poses)
    return MotionResult(model, found)


def track(model: BodyModel, trial: Trial, *, poses: bool = False) -> TrackedTrial:
    """Follow one trial: coordinates, their standard deviations, kinematic error; see :func:`track_all`."""
    task = Task.of(model, trial)
    solution = solve_task(task, trial.times)
    motion = motion_of(task, trial, solution)
    # What is not determined in a frame is NaN there, what is so in no frame stands at its default.
    ever = np.array([name in motion.estimated for name in motion.coordinates]) | ~task.free
    known = np.isfinite(motion.q) & ever
    return TrackedTrial(
        motion,
        coordinate_sd(task, solution.q, motion.residuals, known),
        kinematic_error(motion, model),
        segment_poses(model, motion) if poses else None,
    )
