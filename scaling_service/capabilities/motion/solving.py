"""How the frames of a task are solved: from a guess, from any start, and again from their neighbours.

Frames are solved by themselves, so that some may settle otherwise than those beside them: in a wrong minimum;
or, where a loop of joints that markers do not show can be closed in several ways (a knee bent this way or
that) that follow the markers equally well, in another of these.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from scaling_service.capabilities.motion.task import Task
from scaling_service.core.arrays import Array
from scaling_service.numerics.least_squares import blocks, problem
from scaling_service.numerics.multibody import laws, rigid, sweep
from scaling_service.numerics.multibody import tree as trees
from scaling_service.numerics.multibody.plan import is_plain

ROUGH = sweep.SweepSettings(left=2e-2)
"""Enough to tell one minimum from another."""

_OPEN = 1e-2  # m or rad; chosen: from so near a loop closes without a detour
_LOOSE = problem.Settings(left=1e-3)

_STUCK = 4.0  # chosen: times the cost of a good frame; artefact alone changes it less
_GOOD = 25  # per cent of the frames, taken in order of their cost, whose worst is still a good frame
_BETTER = 0.5  # chosen: a neighbour is worth starting from where it costs at most this share
_NOISE_FREE = 1e-12  # m2: such frames differ by more than any factor

_FASTEST = 20.0  # rad/s, chosen: faster than joints turn in walking, running and cycling
_AS_GOOD = 1.01  # chosen: times its cost that a frame may have where it follows its neighbour
_TINY = 1e-9  # m2; chosen: far below what a camera resolves


def guess_start(task: Task, neutral: Array) -> Array:
    """Coordinates with the root link where its markers are, in every frame.

    The root is the first link with free translations and rotations; it is placed by a rigid fit of
    its own markers or, where fewer than three are seen, of all markers of the neutral body. Frames
    in which neither works take the nearest frame's guess.

    ``neutral``: (n_coordinates,). Returns (n_frames, n_coordinates).
    """
    tree, q = task.tree, np.tile(neutral, (len(task.measured), 1))
    free = [[v for v in own if v < tree.n_coordinates and task.free[v]] for own in tree.variables]
    roots = (k for k, link in enumerate(tree.links) if link.parent == laws.NONE and len(free[k]) >= 3)
    if (root := next(roots, None)) is None:
        return q
    rotation, position = _place_root(task, neutral, root)
    known = problem.find_seen(position)
    if not known.any():
        return q
    angles = _solve_root_turns(tree, root, rotation[known])
    for coordinate, values in angles.items():
        q[known, coordinate] = values
    # The root's translations set so that its origin lies at `position`
    moved = q[known]
    poses = trees.pose_links(tree, np.ascontiguousarray(moved.T), task.p)
    shifts = [
        e for e in tree.plan.entries if e.link == root and not e.is_turn and is_plain(e.term, tree.factors)
    ]
    if len(shifts) == 3:
        rates = poses.directions(shifts).transpose(2, 1, 0)
        gap = position[known] - poses.origins[root].T
        own = [tree.factors[e.term.factor].coordinate for e in shifts]
        moved[:, own] += np.linalg.solve(rates, gap[:, :, None])[:, :, 0]
    q[known] = moved
    # Frames that could not be placed take the nearest one that could.
    rows = np.flatnonzero(known)
    nearest = rows[np.rint(np.interp(np.arange(len(q)), rows, np.arange(len(rows)))).astype(np.intp)]
    return np.asarray(np.where(known[:, None], q, q[nearest]))


def _place_root(task: Task, neutral: Array, root: int) -> tuple[Array, Array]:
    """Rotation (n, 3, 3) and origin (n, 3) of the root link; NaN where it cannot be placed."""
    tree, measured = task.tree, task.measured
    poses = trees.pose_links(tree, neutral[:, None], task.p)
    placed = trees.place_tree_markers(tree, poses)[:, :, 0]
    axes, origin = poses.axes[root][:, :, 0], poses.origins[root][:, 0]
    if tree.placed is not None:
        # By directions: all of the neutral body turned as one, its points' middle kept
        seen, is_point = task.shown, np.asarray(tree.placed > 0.0)
        ahead, point = seen & ~is_point, seen & is_point
        filled = np.where(seen[..., None], measured, 0.0)
        turn = rigid.find_nearest_rotation(np.einsum("nm,nmi,mj->nij", ahead.astype(float), filled, placed))
        turn[~ahead.any(axis=1)] = np.nan
        count = np.maximum(point.sum(axis=1), 1)[:, None]
        middle = np.einsum("nm,nmi->ni", point.astype(float), filled) / count
        before = point @ (placed - origin) / count
        reached = middle - np.einsum("nij,nj->ni", turn, before)
        known = np.asarray(np.isfinite(turn).all(axis=(1, 2)))
        some = np.asarray(point.any(axis=1))
        middles = np.where(some[:, None], reached, origin)
        return turn @ axes.T, np.where(known[:, None], middles, np.nan)
    local = (placed - origin) @ axes.T
    own = tree.marker_rows[root]
    rotation, position = rigid.fit_rigid(local[own], measured[:, own])
    lost = ~problem.find_seen(position)
    if lost.any():
        rotation[lost], position[lost] = rigid.fit_rigid(local, measured[lost])
    return rotation, position


def _solve_root_turns(tree: trees.Tree, root: int, rotation: Array) -> dict[int, Array]:
    """Angles of the root's turns that give these rotations; none if the turns are not three in a row."""
    axes, coordinates, offsets, gains = [], [], [], []
    prefix = np.eye(3)
    for move in tree.links[root].moves:
        if isinstance(move, laws.Fixed):
            prefix = prefix @ move.rotation
        elif isinstance(move, laws.Turn):
            term = move.terms[0]
            if len(move.terms) != 1 or not is_plain(term, tree.factors):
                return {}
            axes.append(prefix[:, move.axis])
            coordinates.append(tree.factors[term.factor].coordinate)
            offsets.append(move.constant)
            gains.append(term.gain[0])
    if len(axes) != 3 or abs(axes[0] @ axes[1]) > 1e-9 or abs(axes[1] @ axes[2]) > 1e-9:
        return {}
    target = Rotation.from_matrix(rotation @ prefix.T)
    angles = target.as_davenport(np.array(axes), "intrinsic", suppress_warnings=True)
    return {c: (angles[:, k] - offsets[k]) / gains[k] for k, c in enumerate(coordinates)}


def solve_from(
    task: Task,
    start: Array,
    *,
    settings: sweep.SweepSettings = sweep.SweepSettings(),
    prior: tuple[Array, Array] | None = None,
    progress: Callable[[int], None] | None = None,
) -> sweep.MotionSolution:
    """All frames of a task from a start (n_frames, n_coordinates), each to the minimum nearest to it.

    ``prior``: values and weights of the coordinates beside the markers, in place of the joints' ranges.
    ``progress``: called with the number of frames done.
    """
    prior = task.ranges.prior if prior is None else prior
    if not task.is_swept:
        return _solve_densely(task, start, prior)
    return sweep.solve_motion(
        task.tree,
        task.measured,
        task.weights,
        start,
        task.p,
        free=task.free,
        bounds=task.bounds,
        prior=prior,
        settings=settings,
        progress=progress,
    )


def _solve_densely(task: Task, start: Array, prior: tuple[Array, Array] | None) -> sweep.MotionSolution:
    """By the general estimator: coordinates that enter several links, closed loops, and robust losses.

    Where a loop is open at the start, it first counts as one more marker: to close it at once would forget
    the markers.
    """
    none, nothing = np.zeros(0), np.zeros(0, dtype=np.intp)
    dense = problem.Problem(
        tree=task.tree,
        measured=task.measured,
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
        and (np.broadcast_to(prior[0], start.shape), np.broadcast_to(prior[1], start.shape)),
        closure=task.closure,
    )
    if task.closure is not None and np.abs(task.closure.evaluate(start, task.p)).max(initial=0.0) > _OPEN:
        start = blocks.solve_motion_alone(replace(dense, closed=False), start, task.p, _LOOSE).q
    found = blocks.solve_motion_alone(dense, start, task.p, problem.Settings(left=1e-7))
    gap = task.measured - trees.pose_markers(task.tree, found.q, task.p)
    cost = np.nansum(task.weights[:, None] * gap**2, axis=(1, 2))
    return sweep.MotionSolution(
        found.q, cost, np.full(len(cost), found.steps), np.ones(len(cost), dtype=bool)
    )


def free_trapped(
    found: sweep.MotionSolution, task: Task, settings: sweep.SweepSettings = sweep.SweepSettings()
) -> sweep.MotionSolution:
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
            return sweep.MotionSolution(q, cost, steps, found.converged)
        again = solve_from(task.in_frames(rows), q[sources], settings=settings)
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


def follow_neighbours(found: sweep.MotionSolution, task: Task, times: Array) -> sweep.MotionSolution:
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
        near, costs, moments, at = q[rows], cost[rows], times[rows], 0
        while len(jumps := np.flatnonzero(_find_jumps(near[at:], moments[at:]))):
            at += int(jumps[0]) + 1
            again = solve_from(task.in_frames(rows[at : at + 1]), near[at - 1 : at])
            nearer = np.abs(again.q[0] - near[at - 1]).max() < np.abs(near[at] - near[at - 1]).max()
            if nearer and again.cost[0] <= _AS_GOOD * costs[at] + _TINY:
                near[at], costs[at] = again.q[0], again.cost[0]
        q[rows], cost[rows] = near, costs
    return replace(found, q=q, cost=cost)


def _find_jumps(q: Array, times: Array) -> NDArray[np.bool_]:
    """Whether a coordinate moves faster than joints do from each frame to the next, (n_frames - 1,)."""
    pace = np.abs(np.diff(q, axis=0)) / np.abs(np.diff(times))[:, None]
    return np.asarray((pace > _FASTEST).any(axis=1))
