"""What speaks against a pose that one start led to: limits, other frames, other limbs, and speed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.motion.solving import find_limit, solve_from
from scaling_service.capabilities.motion.task import Task
from scaling_service.capabilities.motion.uncertainty import find_determined
from scaling_service.core.arrays import Array
from scaling_service.numerics.multibody import tree as trees
from scaling_service.numerics.multibody.laws import NONE
from scaling_service.numerics.multibody.rigid import MIN_POINTS
from scaling_service.numerics.multibody.sweep import MotionSolution, SweepSettings

Index = NDArray[np.intp]

SPEED = 3.0
"""Standard deviation of a joint's angular velocity, rad/s (chosen: the RMS of a knee in walking, 2.5 to 3
rad/s by the curves of Winter 2009, app. A)."""

FASTEST = 5.0 * SPEED
"""A joint that turns faster is looked at again, not refused (chosen: five standard deviations; a kicking or
sprinting knee reaches that for moments)."""

CAMERA_M = 1e-3
"""Noise of a marker, m (chosen: what cameras leave); below it nothing is worth a better minimum."""

SKIN_M = 0.01
"""Standard deviation of a marker about its bone, m (5 to 20 mm; Leardini et al. 2005)."""

_RELEASE = SweepSettings(left=2e-2, max_steps=3)
"""Chosen: enough to see that limits hold a limb far off its markers."""

_WORSE = (
    4.0  # chosen: times its cost without limits, in most frames, or of the root, from which to doubt a limb
)
_SHARE = 0.01  # chosen: of a frame's cost; what limits add below it does not move the mean by 0.1 mm
_TINY = 1e-12  # of a weight
_TREES = 32  # kept; as many as trees are


@dataclass(frozen=True, slots=True, eq=False)
class Limb:
    """A link that moves, with all that hangs on it: its markers, and the free coordinates of its joints."""

    markers: Index
    own: Index  # coordinates of the link itself
    coordinates: Index
    parent: int  # among the limbs; NONE for one on the ground


def list_limbs(tree: trees.Tree, free: NDArray[np.bool_]) -> tuple[Limb, ...]:
    """The limbs of a tree that carry markers, parents first.

    ``free`` (n_coordinates,): the coordinates that are estimated.
    """
    return _list_limbs(tree, np.asarray(free, dtype=bool).tobytes())


@lru_cache(maxsize=_TREES)
def _list_limbs(tree: trees.Tree, chosen: bytes) -> tuple[Limb, ...]:
    free = np.frombuffer(chosen, dtype=bool)
    own = [{v for v in vs if v < tree.n_coordinates and free[v]} for vs in tree.variables]
    below = [set(each) for each in own]
    for k in reversed(range(len(own))):
        if tree.links[k].parent != NONE:
            below[tree.links[k].parent] |= below[k]
    number: dict[int, int] = {NONE: NONE}
    limbs: list[Limb] = []
    for k, link in enumerate(tree.links):
        number[k] = number[link.parent]
        markers = np.arange(tree.n_markers)[tree.carried[k]]
        if own[k] and len(markers):
            moved, all_moved = (np.array(sorted(part), dtype=np.intp) for part in (own[k], below[k]))
            limbs.append(Limb(markers, moved, all_moved, number[link.parent]))
            number[k] = len(limbs) - 1
    return tuple(limbs)


def _measure_markers(task: Task, rows: Index, q: Array) -> Array:
    """Weighted squared distances of the markers, (n_rows, n_markers), m2; zero where not seen."""
    placed = trees.place_tree_markers(
        task.tree, trees.pose_links(task.tree, np.ascontiguousarray(q.T), task.p)
    )
    squares = np.square(task.measured[rows] - np.moveaxis(placed, -1, 0)).sum(axis=2) * task.weights
    return np.asarray(np.where(np.isnan(squares), 0.0, squares))


def measure_limbs(task: Task, rows: Index, q: Array) -> Array:
    """Weighted squared distances of each limb's markers, (n_rows, n_limbs), m2."""
    squares = _measure_markers(task, rows, q)
    limbs = list_limbs(task.tree, task.free)
    return np.stack([squares[:, limb.markers].sum(axis=1) for limb in limbs], axis=1)


def find_held(task: Task, q: Array) -> NDArray[np.bool_]:
    """Where a limb stands far worse by its limits than it would without them, (n_frames, n_limbs).

    A joint may well stand at the end of its range; but where the limits cost a limb more than its markers
    leave unexplained anyway, another minimum within them is likely.

    ``q`` (n_frames, n_coordinates).
    """
    limbs = list_limbs(task.tree, task.free)
    held = np.zeros((len(q), len(limbs)), dtype=bool)
    at_end = ((q <= task.bounds[0]) | (q >= task.bounds[1])) & task.free
    rows = np.flatnonzero(at_end.any(axis=1))
    if len(rows):
        without = (np.full(len(task.free), -np.inf), np.full(len(task.free), np.inf))
        free = replace(task.in_frames(rows), bounds=without)
        released = measure_limbs(task, rows, solve_from(free, q[rows], settings=_RELEASE).q)
        least = np.array([task.weights[limb.markers].sum() for limb in limbs]) * CAMERA_M**2
        now = measure_limbs(task, rows, q[rows])
        whole = now.max(axis=1, keepdims=True)
        held[rows] = (now > _WORSE * (released + least)) & (now > _SHARE * whole)
    return held


def find_outlying(task: Task, found: MotionSolution) -> NDArray[np.bool_]:
    """Where, in frames that stand out, a limb is much farther from its markers than mostly.

    Returns (n_frames, n_limbs).
    """
    limbs = list_limbs(task.tree, task.free)
    outlying = np.zeros((len(found.q), len(limbs)), dtype=bool)
    rows = np.flatnonzero(found.cost > find_limit(found.cost))
    if len(rows):
        costs = measure_limbs(task, np.arange(len(found.q)), found.q)
        outlying[rows] = costs[rows] > _WORSE * np.median(costs, axis=0)
    return outlying


def find_far(task: Task, q: Array) -> NDArray[np.bool_]:
    """Which limbs are farther from their markers than skin moves and than the root is, (n_frames, n_limbs).

    All limbs where the root has too few markers of its own to be placed by: where it starts is then a guess;
    not where rotations are measured, which turn the whole body.
    """
    limbs = list_limbs(task.tree, task.free)
    squares = _measure_markers(task, np.arange(len(q)), q)
    heavy = np.where(task.shown, task.weights, 0.0)
    root = task.tree.marker_rows[0]
    limit = 3.0 * SKIN_M**2 + _WORSE * squares[:, root].sum(axis=1) / (heavy[:, root].sum(axis=1) + _TINY)
    groups = [limb.markers for limb in limbs]
    far = [squares[:, own].sum(axis=1) > heavy[:, own].sum(axis=1) * limit for own in groups]
    guessed = (heavy[:, root] > 0.0).sum(axis=1) < (MIN_POINTS if task.tree.placed is None else 0)
    return np.asarray(np.stack(far, axis=1) | guessed[:, None])


def find_jumps(task: Task, times: Array, q: Array) -> NDArray[np.bool_]:
    """Where a limb's own joint turns faster than people's joints do, (n_frames, n_limbs).

    ``q`` (n_frames, n_coordinates), written without full turns. Coordinates that the markers do not determine
    do not count.
    """
    limbs = list_limbs(task.tree, task.free)
    jumps = np.zeros((len(q), len(limbs)), dtype=bool)
    turning = task.tree.rotations
    fast = np.zeros(q[1:].shape, dtype=bool)
    fast[:, turning] = np.abs(np.diff(q[:, turning], axis=0)) > FASTEST * np.diff(times)[:, None]
    rows = np.flatnonzero(fast.any(axis=1))
    if len(rows):
        both = np.union1d(rows, rows + 1)
        known = np.zeros(q.shape, dtype=bool)
        known[both] = find_determined(task.in_frames(both), q[both])
        fast &= known[1:] & known[:-1] & task.free
        own = np.stack([fast[:, limb.own].any(axis=1) for limb in limbs], axis=1)
        jumps[1:] |= own
        jumps[:-1] |= own
    return jumps
