"""Joint coordinates of a whole trial from its markers.

All frames are solved at once (Lu & O'Connor 1999 for the criterion). Long recordings are solved
coarse to fine: every few frames first, from several starts, then all frames from the interpolated
coarse motion, so that two or three steps are left for each.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from scaling_service.capabilities.motion.task import Task, guess_start
from scaling_service.capabilities.motion.uncertainty import find_determined
from scaling_service.model.body import BodyModel
from scaling_service.model.compile import list_coordinate_ranges, repeat_default_pose
from scaling_service.model.results import Motion
from scaling_service.model.trial import Trial
from scaling_service.numerics.least_squares.estimator import Settings, solve_motion_alone
from scaling_service.numerics.least_squares.problem import SQUARED, Loss, Problem
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.sweep import (
    DEFAULT,
    MotionSolution,
    SweepSettings,
    is_articulated,
    solve_motion,
)
from scaling_service.numerics.multibody.tree import place_tree_markers, pose_links

_COARSE_S = (
    0.08  # chosen: human joints turn by less than 20 deg in this time in walking (knee, 400 deg/s: 32)
)
_SHORT = 48  # frames: below this a coarse level costs more than it saves
_ROUGH = SweepSettings(left=2e-2)
_QUORUM = 0.9  # chosen: of the coarse frames; the few that linger would cost as many steps again as all
_FINE = SweepSettings(close=True)
_TURN = 2.0 * np.pi
_FRAMES = 1024  # placed together; a long recording at once would take gigabytes
_STUCK = 4.0  # chosen: times the cost of a good frame; artefact alone changes it less
_GOOD = 25  # per cent of the frames, taken in order of their cost, whose worst is still a good frame
_BETTER = 0.5  # chosen: a neighbour is worth starting from where it costs at most this share
_TINY = 1e-12  # m2: noise-free frames differ by more than any factor


def inverse_kinematics(
    model: BodyModel,
    trial: Trial,
    *,
    weights: Mapping[str, float] | None = None,
    loss: Loss = SQUARED,
    bounded: bool = True,
    start: Array | None = None,
    progress: Callable[[int], None] | None = None,
) -> Motion:
    """Coordinates that bring the model nearest to the measured markers in every frame.

    Parameters
    ----------
    model : BodyModel
        It stays as it is.
    trial : Trial
        Markers (n_frames, n_markers, 3), m, in the model's axes; labels are the model's marker names. NaN
        where a marker is not seen.
    weights : mapping of str to float, optional
        Marker weights that replace the model's own.
    loss : Loss
        Robust losses lower the influence of outliers.
    bounded : bool
        Whether clamped coordinates keep to their range.
    start : ndarray, optional
        A first guess (n_frames, n_coordinates), rad or m; otherwise the root is placed on its markers.
    progress : callable, optional
        Called with the number of frames done.

    Returns
    -------
    Motion
        Coordinates (n_frames, n_coordinates) in rad or m, and residuals (n_frames, n_markers, 3) in m.

    Raises
    ------
    TrialUnusable
        No marker of the model is seen.

    Notes
    -----
    Lu & O'Connor 1999, J Biomech 32:129-134.

    Examples
    --------
    >>> import scaling_service as ss
    >>> session = ss.scale("lab/subject.json", "MB").session
    >>> motion = ss.inverse_kinematics(session.model, session.evaluation[0])
    >>> motion.q.shape, motion.residuals.shape
    ((278, 14), (278, 14, 3))
    """
    task = Task.of(model, trial, weights=weights, loss=loss, bounded=bounded)
    return make_motion(task, trial, solve_task(task, trial.times, start, progress))


def solve_task(
    task: Task, times: Array, start: Array | None = None, progress: Callable[[int], None] | None = None
) -> MotionSolution:
    """The coordinates alone; see :func:`inverse_kinematics`.

    The first solution keeps to the ranges that the model declares, whether or not they bind: an
    elbow bent backwards with a twisted arm can follow its markers nearly as well as a real one.
    """
    n = len(times)
    if start is not None:
        return _solve(task, slice(None), start, progress)
    neutral = repeat_default_pose(task.model, 1)[0]
    stride = _choose_stride(times)
    rows = np.unique(np.append(np.arange(0, n, stride), n - 1))
    guess = guess_start(task.tree, task.measured[rows], neutral, task.p, task.free)
    within = replace(task, bounds=list_coordinate_ranges(task.model))
    if stride == 1:
        rough = _solve(within, rows, guess, settings=_ROUGH)
    else:
        rough = _solve(within, rows, guess, settings=replace(_ROUGH, quorum=_QUORUM))
        kept = _find_not_alone(rough.converged)
        rows, rough = rows[kept], rough.frames(kept)
    natural = free_trapped(rough, lambda some, near: _solve(within, rows[some], near, settings=_ROUGH))
    close = natural.q if stride == 1 else _interpolate(task.model, times, rows, natural.q)
    fine = _solve(task, slice(None), close, progress, _FINE)
    return free_trapped(fine, lambda some, near: _solve(task, some, near))


def _choose_stride(times: Array) -> int:
    if len(times) < _SHORT:
        return 1
    step = float(np.median(np.diff(times)))
    regular = np.allclose(np.diff(times), step, rtol=0.0, atol=0.2 * step)
    return max(1, round(_COARSE_S / step)) if regular else 1


def _solve(
    task: Task,
    rows: slice | NDArray[np.intp],
    start: Array,
    progress: Callable[[int], None] | None = None,
    settings: SweepSettings = DEFAULT,
) -> MotionSolution:
    if is_articulated(task.tree) and task.loss is SQUARED:
        return solve_motion(
            task.tree,
            task.measured[rows],
            task.weights,
            start,
            task.p,
            free=task.free,
            bounds=task.bounds,
            prior=task.ranges.in_frames(rows).prior,
            settings=settings,
            progress=progress,
        )
    return _solve_densely(task, rows, start)


def _find_not_alone(converged: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """All frames but those that did not converge while both of their neighbours did."""
    kept = np.ones(len(converged), dtype=bool)
    kept[1:-1] = converged[1:-1] | ~(converged[:-2] & converged[2:])
    return kept


def _solve_densely(task: Task, rows: slice | NDArray[np.intp], start: Array) -> MotionSolution:
    """By the general estimator: for coordinates that enter several links, and for robust losses."""
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
    )
    found = solve_motion_alone(problem, start, task.p, Settings(relative_decrease=1e-7))
    gap = measured - np.moveaxis(
        place_tree_markers(task.tree, pose_links(task.tree, np.ascontiguousarray(found.q.T), task.p)), -1, 0
    )
    cost = np.nansum(task.weights[:, None] * gap**2, axis=(1, 2))
    steps = np.full(len(measured), found.steps)
    return MotionSolution(found.q, cost, steps, np.ones(len(measured), dtype=bool))


def _interpolate(model: BodyModel, times: Array, rows: NDArray[np.intp], q: Array) -> Array:
    """The coarse motion at all times, by cubic splines; angles without jumps."""
    turning = [k for k, c in enumerate(model.coordinates) if c.kind == "rotation"]
    q = q.copy()
    q[:, turning] = np.unwrap(q[:, turning], axis=0, period=_TURN)
    return np.asarray(CubicSpline(times[rows], q, bc_type="natural")(times))


def free_trapped(
    found: MotionSolution, solve: Callable[[NDArray[np.intp], Array], MotionSolution]
) -> MotionSolution:
    """Solve frames that settled in a wrong minimum again from their neighbours, until nothing improves.

    A good pose spreads through a whole stretch of wrong ones, one frame from each side at a time.

    ``found``: frames in the order of time. ``solve``: frames (rows) and starts (n_rows, n_coordinates) to
    their solution.
    """
    q, cost, steps = found.q.copy(), found.cost.copy(), found.steps.copy()
    limit = _STUCK * float(np.percentile(cost, _GOOD)) + _TINY if len(cost) else 0.0
    tried = np.zeros((2, len(cost)), dtype=bool)
    while True:
        rows, sources = _find_frontier(cost, limit, tried)
        if not len(rows):
            return MotionSolution(q, cost, steps, found.converged)
        again = solve(rows, q[sources])
        steps[rows] += again.steps
        better = again.cost < cost[rows]
        rows = rows[better]
        q[rows], cost[rows] = again.q[better], again.cost[better]
        tried[0, np.minimum(rows + 1, len(cost) - 1)] = False  # their neighbours have a new start
        tried[1, np.maximum(rows - 1, 0)] = False


def _find_frontier(
    cost: Array, limit: float, tried: NDArray[np.bool_]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Outstanding frames beside a better one that they were not yet started from, and that one."""
    every = np.arange(len(cost))
    for side, shift in enumerate((1, -1)):
        source = every - shift
        inside = (source >= 0) & (source < len(cost))
        beside = inside & (cost[np.clip(source, 0, len(cost) - 1)] < _BETTER * cost)
        rows = np.flatnonzero((cost > limit) & beside & ~tried[side])
        if len(rows):
            tried[side, rows] = True
            return rows, source[rows]
    return every[:0], every[:0]


def make_motion(task: Task, trial: Trial, solution: MotionSolution) -> Motion:
    """The motion that a solution is, with what it leaves unexplained and what it does not determine."""
    residual = np.empty(task.measured.shape)
    for rows in (slice(start, start + _FRAMES) for start in range(0, len(residual), _FRAMES)):
        placed = place_tree_markers(
            task.tree, pose_links(task.tree, np.ascontiguousarray(solution.q[rows].T), task.p)
        )
        np.subtract(task.measured[rows], np.moveaxis(placed, -1, 0), out=residual[rows])
    known = find_determined(task.tree, task.measured, task.weights, solution.q, task.p, task.free)
    known &= task.ranges.shown
    sometimes = np.asarray(known.any(axis=0))
    q = np.where(known | ~sometimes, solution.q, np.nan)
    names = task.model.coordinate_names
    return Motion(
        trial=trial.name,
        times=trial.times,
        coordinates=names,
        q=q,
        markers=task.markers,
        residuals=residual,
        estimated=tuple(
            n for n, known, free in zip(names, sometimes, task.free, strict=True) if known and free
        ),
        iterations=int(solution.steps.max(initial=0)),
    )
