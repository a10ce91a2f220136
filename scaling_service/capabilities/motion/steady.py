"""What markers hardly tell, held steady where a joint turns faster than people's joints do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy

from scaling_service.capabilities.motion import branches, doubts
from scaling_service.capabilities.motion.solving import solve_from
from scaling_service.capabilities.motion.task import Task
from scaling_service.capabilities.motion.uncertainty import estimate_noise_variance
from scaling_service.core.arrays import Array
from scaling_service.numerics.multibody import sweep
from scaling_service.numerics.signals.filters import find_runs

COARSE_S = 0.08
"""Chosen: human joints turn by less than 20 deg in this time in walking (knee, 400 deg/s: 32)."""

_SHARES = (100.0, 10.0, *15 * (1.0,))  # chosen: of the pull to the neighbours, first strong, then as it is
_DEARER = 1.25  # chosen: times its cost that a frame held steady may have; noise asks for a tenth of that
_SURE = 5.0  # chosen: SDs of a camera's noise, along what it turns at will, that are no disagreement
_STEADY = sweep.SweepSettings(max_steps=2, close=True)
_LOOK = sweep.SweepSettings(max_steps=1)  # what a pose costs, but for one step


def hold_steady(task: Task, times: Array, found: sweep.MotionSolution) -> sweep.MotionSolution:
    """What the markers hardly tell, held steady where a joint turns faster than people's joints do.

    Where the first and the third of three rotations stand nearly in one line, or an arm is nearly straight,
    a camera's noise turns coordinates against each other at will. Around such frames the motion is the most
    likely one if angular velocities are normal, of standard deviation ``SPEED``, and markers are as good as
    cameras: each frame is pulled to the mean of its neighbours, until it hardly moves. It stays as it was
    where that is not likelier.
    """
    if not task.is_swept or len(times) < 3:
        return found
    jumps = np.asarray(doubts.find_jumps(task, times, found.q).any(axis=1))
    if not jumps.any():
        return found
    step = float(np.median(np.diff(times)))
    moving = task.free & np.isin(np.arange(len(task.free)), task.tree.rotations)
    loose = np.zeros(len(jumps), dtype=bool)
    limit = doubts.FASTEST * step / 3.0  # rad: what noise alone turns by more is hardly told
    variance = estimate_noise_variance(task.in_frames(jumps), found.q[jumps], doubts.CAMERA_M)
    loose[jumps] = (variance[:, moving[task.free]] > limit**2).any(axis=1)
    if not loose.any():
        return found
    around = np.ones(2 * max(1, round(COARSE_S / step)) + 1, dtype=bool)
    near = scipy.ndimage.binary_propagation(loose, mask=scipy.ndimage.binary_dilation(jumps, around))
    near[[0, -1]] = False
    found = replace(found, q=branches.cross_stretches(task.tree, found.q, find_runs(near), task.bounds))
    weight = np.where(moving, (doubts.CAMERA_M / (doubts.SPEED * step)) ** 2, 0.0)
    for doubted in (near, jumps):  # a start across the whole stretch, else across its jumps alone
        rows, kept = np.flatnonzero(near), np.flatnonzero(~(doubted & near))
        if not len(rows):
            break
        q, part = found.q.copy(), task.in_frames(rows)
        # Coordinates in some rows, linear in time between those that are kept
        q[rows] = np.where(
            moving, np.stack([np.interp(rows, kept, q[kept, k]) for k in range(q.shape[1])], axis=1), q[rows]
        )
        for share in _SHARES:
            # Half way to the neighbours' mean at twice the weight: the same minimum, but all move together.
            middle = 0.5 * q[rows] + 0.25 * (q[rows - 1] + q[rows + 1])
            q[rows] = solve_from(part, q[rows], settings=_STEADY, prior=(middle, 4.0 * share * weight)).q
        cost = found.cost.copy()
        cost[rows] = solve_from(part, q[rows], settings=_LOOK).cost
        # Stretches in which cost and steps fall together, no frame much farther from its markers than it was
        runs, _ = scipy.ndimage.label(scipy.ndimage.binary_dilation(near, [True, True, False]))
        before, after = (
            np.bincount(runs, each + np.append(np.square(np.diff(pose, axis=0)) @ weight, 0.0))
            for each, pose in ((found.cost, found.q), (cost, q))
        )
        dear = np.bincount(runs, cost > _DEARER * found.cost + (_SURE * doubts.CAMERA_M) ** 2) > 0
        likelier = near & ((after < before) & ~dear)[runs]
        better = np.where(likelier[:, None], q, found.q)
        found = replace(found, q=better, cost=np.where(likelier, cost, found.cost))
        near &= ~likelier
    return found
