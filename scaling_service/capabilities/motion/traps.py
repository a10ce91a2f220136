"""Frames that settled in a wrong minimum are freed by their neighbours."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from scaling_service.numerics.multibody.sweep import MotionSolution

_STUCK = 4.0  # chosen: times the cost of a good frame; artefact alone changes it less
_GOOD = 25  # per cent of the frames, taken in order of their cost, whose worst is still a good frame
_BETTER = 0.5  # chosen: a neighbour is worth starting from where it costs at most this share
_TINY = 1e-12  # m2: noise-free frames differ by more than any factor


def freed(
    found: MotionSolution, solve: Callable[[NDArray[np.intp], NDArray[np.float64]], MotionSolution]
) -> MotionSolution:
    """Solve outstanding frames again from neighbours that are not, until nothing improves.

    A good pose spreads through a whole stretch of wrong ones, one frame from each side at a time.

    ``found``: frames in the order of time. ``solve``: frames (rows) and starts (n_rows, n_coordinates) to
    their solution.
    """
    q, cost, steps = found.q.copy(), found.cost.copy(), found.steps.copy()
    limit = _STUCK * float(np.percentile(cost, _GOOD)) + _TINY if len(cost) else 0.0
    tried = np.zeros((2, len(cost)), dtype=bool)
    while True:
        rows, sources = _frontier(cost, limit, tried)
        if not len(rows):
            return MotionSolution(q, cost, steps, found.converged)
        again = solve(rows, q[sources])
        steps[rows] += again.steps
        better = again.cost < cost[rows]
        rows = rows[better]
        q[rows], cost[rows] = again.q[better], again.cost[better]
        tried[0, np.minimum(rows + 1, len(cost) - 1)] = False  # their neighbours have a new start
        tried[1, np.maximum(rows - 1, 0)] = False


def _frontier(
    cost: NDArray[np.float64], limit: float, tried: NDArray[np.bool_]
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
