"""One way of closing loops throughout a recording.

A loop of joints that markers do not show can often be closed in several ways (a knee bent this way or that)
that follow the markers equally well. Frames are solved by themselves, so a motion may change from one way
to another between them, which no joint does.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.arrays import Array
from scaling_service.numerics.multibody.sweep import MotionSolution

_FASTEST = 20.0  # rad/s, chosen: faster than joints turn in walking, running and cycling
_AS_GOOD = 1.01  # chosen: times its cost that a frame may have where it follows its neighbour
_TINY = 1e-9  # m2; chosen: far below what a camera resolves

Solve = Callable[[NDArray[np.intp], Array], MotionSolution]
"""Frames (rows) from starts (n_rows, n_coordinates)."""


def follow_neighbours(found: MotionSolution, times: Array, solve: Solve) -> MotionSolution:
    """The motion with frames beyond a jump solved from this side of it, where that is as good.

    From the longest stretch without a jump outwards, until the motion is joined again.

    ``found``: frames in the order of ``times`` (n_frames,), s.
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
            again = solve(rows[at : at + 1], near[at - 1 : at])
            nearer = np.abs(again.q[0] - near[at - 1]).max() < np.abs(near[at] - near[at - 1]).max()
            if nearer and again.cost[0] <= _AS_GOOD * costs[at] + _TINY:
                near[at], costs[at] = again.q[0], again.cost[0]
        q[rows], cost[rows] = near, costs
    return replace(found, q=q, cost=cost)


def _find_jumps(q: Array, times: Array) -> NDArray[np.bool_]:
    """Whether a coordinate moves faster than joints do from each frame to the next, (n_frames - 1,)."""
    pace = np.abs(np.diff(q, axis=0)) / np.abs(np.diff(times))[:, None]
    return np.asarray((pace > _FASTEST).any(axis=1))
