"""Joint coordinates of a whole trial from its markers.

All frames are solved at once (Lu & O'Connor 1999 for the criterion). Long recordings are solved
coarse to fine: every few frames first, from several starts, then all frames from the interpolated
coarse motion, so that two or three steps are left for each.
"""

from __future__ import annotations

from collections import abc
from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from scaling_service.capabilities.motion import doubts as motion_doubts
from scaling_service.capabilities.motion import restarts, steady
from scaling_service.capabilities.motion.branches import join_branches
from scaling_service.capabilities.motion.everyday import follow_everyday
from scaling_service.capabilities.motion.loops import follow_neighbours
from scaling_service.capabilities.motion.solving import solve_from
from scaling_service.capabilities.motion.task import Task, guess_start
from scaling_service.capabilities.motion.uncertainty import find_determined
from scaling_service.core.arrays import Array
from scaling_service.model import compile as compiling
from scaling_service.model.body import BodyModel
from scaling_service.model.results import Motion
from scaling_service.model.trial import Trial
from scaling_service.numerics.least_squares import problem
from scaling_service.numerics.multibody import sweep, tree
from scaling_service.numerics.multibody.closure import CLOSED

_SHORT = 48  # frames: below this a coarse level costs more than it saves
_ROUGH = sweep.SweepSettings(left=2e-2)
_QUORUM = 0.9  # chosen: of the coarse frames; the few that linger would cost as many steps again as all
_FINE = sweep.SweepSettings(close=True)
_PROBE = sweep.SweepSettings(left=2e-2, max_steps=12, quorum=0.5)  # chosen: one better pose is enough to know
# Chosen: enough to see that limits hold a limb far off its markers
_RELEASE = sweep.SweepSettings(left=2e-2, max_steps=3)
_FRAMES = 1024  # placed together; a long recording at once would take gigabytes
_STUCK = 4.0  # chosen: times the cost of a good frame; artefact alone changes it less
_GOOD = 25  # per cent of the frames, taken in order of their cost, whose worst is still a good frame
_BETTER = 0.5  # chosen: a neighbour is worth starting from where it costs at most this share
_TINY = 1e-12  # m2: noise-free frames differ by more than any factor


def inverse_kinematics(
    model: BodyModel,
    trial: Trial,
    *,
    weights: abc.Mapping[str, float] | None = None,
    loss: problem.Loss = problem.SQUARED,
    bounded: bool = True,
    start: Array | None = None,
    progress: abc.Callable[[int], None] | None = None,
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
    Lu & O'Connor 1999, J Biomech 32:129-134. Of a model with a posterior (``MAP``'s) the motion is the
    likeliest one where the markers of a segment err together as far as skin wanders.

    Examples
    --------
    >>> import scaling_service as ss
    >>> session = ss.scale("lab/subject.json", "MB").session
    >>> motion = ss.inverse_kinematics(session.model, session.evaluation[0])
    >>> motion.q.shape, motion.residuals.shape
    ((278, 14), (278, 14, 3))
    """
    task = Task.of(model, trial, weights=weights, loss=loss, bounded=bounded)
    solution = solve_task(task, trial.times, start, progress)
    if model.posterior is not None and weights is None and loss is problem.SQUARED:
        solution = replace(solution, q=follow_everyday(model, trial, solution.q))
    return make_motion(task, trial, solution)


def solve_task(
    task: Task, times: Array, start: Array | None = None, progress: abc.Callable[[int], None] | None = None
) -> sweep.MotionSolution:
    """The coordinates alone; see :func:`inverse_kinematics`.

    The first solution keeps to the ranges that the model declares, whether or not they bind: an
    elbow bent backwards with a twisted arm can follow its markers nearly as well as a real one.
    """
    n = len(times)
    if start is not None:
        return solve_from(task, slice(None), start, progress)
    neutral = compiling.repeat_default_pose(task.model, 1)[0]
    if len(times) < _SHORT:
        stride = 1
    else:
        step = float(np.median(np.diff(times)))
        regular = np.allclose(np.diff(times), step, rtol=0.0, atol=0.2 * step)
        stride = max(1, round(steady.COARSE_S / step)) if regular else 1
    rows = np.unique(np.append(np.arange(0, n, stride), n - 1))
    guess = guess_start(task.tree, task.measured[rows], neutral, task.p, task.free)
    within = replace(task, bounds=compiling.list_coordinate_ranges(task.model))
    if stride == 1:
        rough = solve_from(within, rows, guess, settings=_ROUGH)
    else:
        rough = solve_from(within, rows, guess, settings=replace(_ROUGH, quorum=_QUORUM))
        # All frames but those that did not converge while both of their neighbours did.
        converged = rough.converged
        kept = np.ones(len(converged), dtype=bool)
        kept[1:-1] = converged[1:-1] | ~(converged[:-2] & converged[2:])
        rows, rough = rows[kept], rough.frames(kept)
    natural = free_trapped(rough, _solver(within, rows))
    if task.closure is not None:  # a loop of joints keeps to one of the ways in which it closes, as a whole
        close = natural.q if stride == 1 else _interpolate(times, rows, np.unwrap(natural.q, axis=0))
        fine = solve_from(task, slice(None), close, progress, _FINE)
        fine = free_trapped(fine, lambda some, near: solve_from(task, some, near))
        return follow_neighbours(fine, times, lambda some, near: solve_from(task, some, near))
    # The frames as they were found, or sought again from many starts where something speaks against them
    moments = times[rows]
    part = within.in_frames(rows)
    free = replace(within, bounds=(np.full(len(within.free), -np.inf), np.full(len(within.free), np.inf)))
    joined = join_branches(task.tree, natural.q, within.bounds, within.bounds, neutral)
    doubts = motion_doubts.find_held(part, natural.q, _solver(free, rows, _RELEASE))
    doubts |= motion_doubts.find_outlying(
        part, natural.q, np.flatnonzero(natural.cost > _find_limit(natural.cost))
    )
    doubts |= motion_doubts.find_far(part, natural.q)
    jumps = motion_doubts.find_jumps(part, moments, joined)
    if jumps.any() or (
        doubts.any() and restarts.confirm_doubts(part, natural, doubts, _solver(within, rows, _PROBE))
    ):
        natural = restarts.choose_minima(part, moments, natural, doubts | jumps, _solver(within, rows))
        joined = join_branches(task.tree, natural.q, within.bounds, within.bounds, neutral)
    close = joined if stride == 1 else _interpolate(times, rows, joined)
    fine = free_trapped(
        solve_from(task, slice(None), close, progress, _FINE), lambda some, near: solve_from(task, some, near)
    )
    fine = replace(fine, q=join_branches(task.tree, fine.q, task.bounds, within.bounds, neutral))
    return steady.hold_steady(task, times, fine)


def _solver(
    task: Task, rows: NDArray[np.intp], settings: sweep.SweepSettings = _ROUGH
) -> motion_doubts.Solve:
    """How frames among ``rows`` are solved from given starts."""
    return lambda some, near: solve_from(task, rows[some], near, settings=settings)


def _find_limit(cost: Array) -> float:
    return _STUCK * float(np.percentile(cost, _GOOD)) + _TINY if len(cost) else 0.0


def _interpolate(times: Array, rows: NDArray[np.intp], q: Array) -> Array:
    """The coarse motion, written without jumps, at all times, by cubic splines."""
    return np.asarray(scipy.interpolate.CubicSpline(times[rows], q, bc_type="natural")(times))


def free_trapped(
    found: sweep.MotionSolution, solve: abc.Callable[[NDArray[np.intp], Array], sweep.MotionSolution]
) -> sweep.MotionSolution:
    """Solve frames that settled in a wrong minimum again from their neighbours, until nothing improves.

    A good pose spreads through a whole stretch of wrong ones, one frame from each side at a time.

    ``found``: frames in the order of time. ``solve``: frames (rows) and starts (n_rows, n_coordinates) to
    their solution.
    """
    q, cost, steps = found.q.copy(), found.cost.copy(), found.steps.copy()
    limit = _find_limit(cost)
    tried = np.zeros((2, len(cost)), dtype=bool)
    while True:
        rows, sources = _find_frontier(cost, limit, tried)
        if not len(rows):
            return sweep.MotionSolution(q, cost, steps, found.converged)
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


def make_motion(task: Task, trial: Trial, solution: sweep.MotionSolution) -> Motion:
    """The motion that a solution is, with what it leaves unexplained and what it does not determine."""
    residual = np.empty(task.measured.shape)
    for rows in (slice(start, start + _FRAMES) for start in range(0, len(residual), _FRAMES)):
        placed = tree.place_tree_markers(
            task.tree, tree.pose_links(task.tree, np.ascontiguousarray(solution.q[rows].T), task.p)
        )
        np.subtract(task.measured[rows], np.moveaxis(placed, -1, 0), out=residual[rows])
    known = find_determined(
        task.tree, task.measured, task.weights, solution.q, task.p, task.free, task.closure
    )
    if task.closure is not None:
        known &= np.abs(task.closure.evaluate(solution.q, task.p)).max(axis=1, keepdims=True) <= CLOSED
    else:
        known &= task.ranges.shown
    sometimes = np.asarray(known.any(axis=0))
    q = np.where(known | ~sometimes, solution.q, np.nan)
    names = task.model.coordinate_names
    # Tips of directions say by how much a rotation is missed; they are no markers.
    points = np.array([not task.model.marker(name).is_direction for name in task.markers], dtype=bool)
    # How far each measured rotation is from the model's, (n_frames,), rad; see `motion/mounting.py`.
    turns: list[tuple[str, Array]] = []
    own = [name for name in task.markers if task.model.marker(name).is_direction]
    for label in dict.fromkeys(name.rpartition("@")[0] for name in own):
        tips = [k for k, name in enumerate(task.markers) if name in own and name.rpartition("@")[0] == label]
        arm = float(np.linalg.norm(task.model.marker(task.markers[tips[0]]).nominal))
        gap = np.linalg.norm(residual[:, tips].reshape(len(residual), -1), axis=1)
        turns.append((label, 2.0 * np.arcsin(np.minimum(gap / (np.sqrt(8.0) * arm), 1.0))))
    return Motion(
        trial=trial.name,
        times=trial.times,
        coordinates=names,
        q=q,
        markers=tuple(name for name, point in zip(task.markers, points, strict=True) if point),
        residuals=residual[:, points],
        turns=dict(turns),
        estimated=tuple(
            n for n, known, free in zip(names, sometimes, task.free, strict=True) if known and free
        ),
        iterations=int(solution.steps.max(initial=0)),
    )
