"""Frames solved again from their neighbours, where they settled otherwise than these.

In a wrong minimum; or, where a loop of joints that markers do not show can be closed in several ways (a knee
bent this way or that) that follow the markers equally well, in another of these. Frames are solved by
themselves, so a motion may change from one way to another between them, which no joint does.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.motion.task import Task
from scaling_service.core.arrays import Array
from scaling_service.numerics.multibody.sweep import MotionSolution, SweepSettings

_STUCK = 4.0  # chosen: times the cost of a good frame; artefact alone changes it less
_GOOD = 25  # per cent of the frames, taken in order of their cost, whose worst is still a good frame
_BETTER = 0.5  # chosen: a neighbour is worth starting from where it costs at most this share
_NOISE_FREE = 1e-12  # m2: such frames differ by more than any factor

_FASTEST = 20.0  # rad/s, chosen: faster than joints turn in walking, running and cycling
_AS_GOOD = 1.01  # chosen: times its cost that a frame may have where it follows its neighbour
_TINY = 1e-9  # m2; chosen: far below what a camera resolves


def free_trapped(
    found: MotionSolution, task: Task, settings: SweepSettings = SweepSettings()
) -> MotionSolution:
    """Solve frames that settled in a wrong minimum again from their neighbours, until nothing improves.

    A good pose spreads through a whole stretch of wrong ones, one frame from each side at a time.

    ``found``: the task's frames in the order of time.
    """
    q, cost, steps = found.q.copy(), found.cost.copy(), found.steps.copy()
    limit = find_limit(cost)
    tried = np.zeros((2, len(cost)), dtype=bool)
    while True:
        rows, sources = _find_frontier(cost, limit, tried)
        if not len(rows):
            return MotionSolution(q, cost, steps, found.converged)
        again = task.in_frames(rows).solve(q[sources], settings=settings)
        steps[rows] += again.steps
        better = again.cost < cost[rows]
        rows = rows[better]
        q[rows], cost[rows] = again.q[better], again.cost[better]
        tried[0, np.minimum(rows + 1, len(cost) - 1)] = False  # their neighbours have a new start
        tried[1, np.maximum(rows - 1, 0)] = False


def find_limit(cost: Array) -> float:
    """The cost (m2) beyond which a frame stands out among all, whose costs are (n_frames,)."""
    return _STUCK * float(np.percentile(cost, _GOOD)) + _NOISE_FREE if len(cost) else 0.0


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


def follow_neighbours(found: MotionSolution, task: Task, times: Array) -> MotionSolution:
    """The motion with frames beyond a jump solved from this side of it, where that is as good.

    From the longest stretch without a jump outwards, until the motion is joined again.

    ``found``: the task's frames in the order of ``times`` (n_frames,), s.
    """
    ends = np.append(np.flatnonzero(_find_jumps(found.q, times)), len(times) - 1)
    longest = int(np.argmax(np.diff(ends, prepend=-1)))
    first = 0 if longest == 0 else int(ends[longest - 1]) + 1
    q, cost = found.q.copy(), found.cost.copy()
    for part in (slice(first, None), slice(int(ends[longest]), None, -1)):
        rows = np.arange(len(times))[part]
        # Coordinates and costs of frames in an order, the first of which is right
        near = q[rows]
        costs = cost[rows]
        moments = times[rows]
        at = 0
        while len(jumps := np.flatnonzero(_find_jumps(near[at:], moments[at:]))):
            at += int(jumps[0]) + 1
            again = task.in_frames(rows[at : at + 1]).solve(near[at - 1 : at])
            nearer = np.abs(again.q[0] - near[at - 1]).max() < np.abs(near[at] - near[at - 1]).max()
            if nearer and again.cost[0] <= _AS_GOOD * costs[at] + _TINY:
                near[at], costs[at] = again.q[0], again.cost[0]
        q[rows], cost[rows] = near, costs
    return replace(found, q=q, cost=cost)


def _find_jumps(q: Array, times: Array) -> NDArray[np.bool_]:
    """Whether a coordinate moves faster than joints do from each frame to the next, (n_frames - 1,)."""
    pace = np.abs(np.diff(q, axis=0)) / np.abs(np.diff(times))[:, None]
    return np.asarray((pace > _FASTEST).any(axis=1))
