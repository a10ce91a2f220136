"""Some frames of a task from given starts: by sweeps over the tree, or by the general estimator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.motion.task import Task
from scaling_service.core.arrays import Array
from scaling_service.numerics.least_squares import estimator
from scaling_service.numerics.least_squares.problem import Problem
from scaling_service.numerics.multibody import sweep, tree

_OPEN = 1e-2  # m or rad; chosen: from so near a loop closes without a detour
_LOOSE = estimator.Settings(relative_decrease=1e-3)


def solve_from(
    task: Task,
    rows: slice | NDArray[np.intp],
    start: Array,
    progress: Callable[[int], None] | None = None,
    settings: sweep.SweepSettings = sweep.SweepSettings(),
    prior: tuple[Array, Array] | None = None,
) -> sweep.MotionSolution:
    """Some frames of a task from a start (n, n_coordinates), each to the minimum nearest to it.

    ``prior``: values and weights of the coordinates beside the markers, in place of the joints' ranges.
    """
    prior = task.ranges.in_frames(rows).prior if prior is None else prior
    if task.is_swept:
        return sweep.solve_motion(
            task.tree,
            task.measured[rows],
            task.weights,
            start,
            task.p,
            free=task.free,
            bounds=task.bounds,
            prior=prior,
            settings=settings,
            progress=progress,
        )
    return _solve_densely(task, rows, start, prior)


def _solve_densely(
    task: Task, rows: slice | NDArray[np.intp], start: Array, prior: tuple[Array, Array] | None
) -> sweep.MotionSolution:
    """By the general estimator: coordinates that enter several links, closed loops, and robust losses.

    Where a loop is open at the start, it first counts as one more marker: to close it at once would forget
    the markers.
    """
    none, nothing = np.zeros(0), np.zeros(0, dtype=np.intp)
    measured = task.measured[rows]
    problem = Problem(
        tree=task.tree,
        measured=measured,
        weights=task.weights,
        coordinates=np.flatnonzero(task.free),
        parameters=nothing,
        scale=none,
        lower=none,
        upper=none,
        prior_weight=none,
        coordinate_bounds=task.bounds,
        loss=task.loss,
        coordinate_prior=prior
        and (
            np.broadcast_to(prior[0], start.shape),
            np.broadcast_to(prior[1], start.shape),
        ),
        closure=task.closure,
    )
    if task.closure is not None and np.abs(task.closure.evaluate(start, task.p)).max(initial=0.0) > _OPEN:
        start = estimator.solve_motion_alone(replace(problem, closed=False), start, task.p, _LOOSE).q
    found = estimator.solve_motion_alone(problem, start, task.p, estimator.Settings(relative_decrease=1e-7))
    gap = measured - np.moveaxis(
        tree.place_tree_markers(
            task.tree, tree.pose_links(task.tree, np.ascontiguousarray(found.q.T), task.p)
        ),
        -1,
        0,
    )
    cost = np.nansum(task.weights[:, None] * gap**2, axis=(1, 2))
    steps = np.full(len(measured), found.steps)
    return sweep.MotionSolution(found.q, cost, steps, np.ones(len(measured), dtype=bool))
