"""Joint coordinates of a whole trial from its markers.

All frames are solved at once (Lu & O'Connor 1999 for the criterion). Long recordings are solved
coarse to fine: every few frames first, from several starts, then all frames from the interpolated
coarse motion, so that two or three steps are left for each.
"""

from __future__ import annotations

from collections import abc
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from scaling_service.capabilities.motion import doubts as motion_doubts
from scaling_service.capabilities.motion import restarts, steady
from scaling_service.capabilities.motion.branches import join_branches
from scaling_service.capabilities.motion.everyday import follow_everyday
from scaling_service.capabilities.motion.residuals import make_motion
from scaling_service.capabilities.motion.solving import (
    ROUGH,
    follow_neighbours,
    free_trapped,
    guess_start,
    solve_from,
)
from scaling_service.capabilities.motion.task import Task
from scaling_service.core.arrays import Array
from scaling_service.model import compile as compiling
from scaling_service.model.body import BodyModel
from scaling_service.model.results import Motion
from scaling_service.model.trial import Trial
from scaling_service.numerics.least_squares import problem
from scaling_service.numerics.multibody import sweep

_SHORT = 48  # frames: below this a coarse level costs more than it saves
_QUORUM = 0.9  # chosen: of the coarse frames; the few that linger would cost as many steps again as all
_FINE = sweep.SweepSettings(close=True)


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
    everyday = model.posterior is not None and weights is None and loss is problem.SQUARED
    return follow_task(task, trial, everyday=everyday, start=start, progress=progress)[1]


def follow_task(
    task: Task,
    trial: Trial,
    *,
    everyday: bool,
    start: Array | None = None,
    progress: abc.Callable[[int], None] | None = None,
) -> tuple[Array, Motion]:
    """A task's coordinates (n_frames, n_coordinates), and the motion that they are.

    ``everyday``: whether markers of a segment err together as far as skin wanders, see
    :func:`inverse_kinematics`.
    """
    solution = solve_task(task, trial.times, start, progress)
    q = follow_everyday(task.model, trial, solution.q) if everyday else solution.q
    return q, make_motion(task, trial, q, solution.steps)


def solve_task(
    task: Task, times: Array, start: Array | None = None, progress: abc.Callable[[int], None] | None = None
) -> sweep.MotionSolution:
    """The coordinates alone; see :func:`inverse_kinematics`."""
    if start is None:
        return _solve_anew(task, times, progress)
    return solve_from(task, start, progress=progress)


def _solve_anew(task: Task, times: Array, progress: abc.Callable[[int], None] | None) -> sweep.MotionSolution:
    """From a guess of where the root is, coarse to fine.

    The first solution keeps to the ranges that the model declares, whether or not they bind: an
    elbow bent backwards with a twisted arm can follow its markers nearly as well as a real one.
    """
    neutral = compiling.repeat_default_pose(task.model, 1)[0]
    stride = 1
    if len(times) >= _SHORT:
        step = float(np.median(np.diff(times)))
        regular = np.allclose(np.diff(times), step, rtol=0.0, atol=0.2 * step)
        stride = max(1, round(steady.COARSE_S / step)) if regular else 1
    rows = np.unique(np.append(np.arange(0, len(times), stride), len(times) - 1))
    ranges = compiling.list_coordinate_ranges(task.model)
    part = replace(task.in_frames(rows), bounds=ranges)
    guess = guess_start(part, neutral)
    found = solve_from(part, guess, settings=ROUGH if stride == 1 else replace(ROUGH, quorum=_QUORUM))
    if stride > 1:
        # All frames but those that did not converge while both of their neighbours did.
        converged = found.converged
        kept = np.ones(len(converged), dtype=bool)
        kept[1:-1] = converged[1:-1] | ~(converged[:-2] & converged[2:])
        rows, part, found = rows[kept], part.in_frames(kept), found.frames(kept)
    found = free_trapped(found, part, ROUGH)
    looped = task.closure is not None
    if looped:  # a loop of joints keeps to one of the ways in which it closes, as a whole
        joined = found.q if stride == 1 else np.unwrap(found.q, axis=0)
    else:
        # The frames as they were found, or sought again from many starts where something speaks against them
        joined = join_branches(task.tree, found.q, ranges, ranges, neutral)
        doubts = motion_doubts.find_held(part, found.q) | motion_doubts.find_outlying(part, found)
        doubts |= motion_doubts.find_far(part, found.q)
        jumps = motion_doubts.find_jumps(part, times[rows], joined)
        if jumps.any() or (doubts.any() and restarts.confirm_doubts(part, found, doubts)):
            found = restarts.choose_minima(part, times[rows], found, doubts | jumps)
            joined = join_branches(task.tree, found.q, ranges, ranges, neutral)
    # The coarse motion at all times, by cubic splines
    close = joined if stride == 1 else CubicSpline(times[rows], joined, bc_type="natural")(times)
    fine = solve_from(task, close, settings=_FINE, progress=progress)
    fine = free_trapped(fine, task)
    if looped:
        return follow_neighbours(fine, task, times)
    fine = replace(fine, q=join_branches(task.tree, fine.q, task.bounds, ranges, neutral))
    return steady.hold_steady(task, times, fine)
