"""Inverse kinematics from many starts, where one start may have ended in a wrong minimum.

A local search that starts in one pose can end with a joint at the wrong end of its range, a limb turned about
itself, or now in one and now in another of several minima. What ended so is started again from many poses, limb
by limb, in a few frames; each minimum found there is followed through the frames between; and of all poses that
a frame may then have, the sequence is taken that explains the markers and does not jump (Viterbi 1967).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.motion.branches import Bounds, find_rotations, find_triplets, find_turning, wrap, write_within
from scaling_service.capabilities.motion.task import Task
from scaling_service.numerics.multibody.laws import NONE, Array
from scaling_service.numerics.multibody.sweep import MotionSolution
from scaling_service.numerics.multibody.tree import Tree, place_tree_markers, pose_links

Index = NDArray[np.intp]
Solve = Callable[[Index, Array], MotionSolution]
"""Frames (rows), which may come again, and starts (n_rows, n_coordinates) to the minima reached from them."""

SPEED = 5.0
"""Standard deviation of a joint's angular velocity, rad/s (chosen: RMS of a knee in walking is 2.5 to 3 rad/s,
in running twice that; Winter 2009, Novacheck 1998)."""

_JUMP = 3.0  # chosen: standard deviations beyond which a step is looked at again, not refused
_SKIN_M = 0.01  # standard deviation of a marker about its bone: 5 to 20 mm (Leardini et al. 2005)
_CAMERA_M = 1e-3  # chosen: what cameras leave; below it a minimum is not made better by another
_RELEASED = 2.0  # chosen: times the cost of a limb that its limits may ask for before they are doubted
_DRAWS = 8  # chosen: starts of each limb; of three joints one start in three reaches the best minimum
_ROUNDS = 3  # chosen: limbs improve each other's frames; two rounds suffice for two arms
_KEPT = 4  # chosen: minima of a frame that are followed
_APART = 0.1  # rad or m: less is one minimum
_SPACING = 10  # chosen: frames (0.8 s of the coarse ones) between two that are started anew
_MOST = 16  # chosen: frames started anew, evenly spaced, and as many of the suspicious
_WIDE = 1.0  # rad: of starts of coordinates without a range


@dataclass(frozen=True, slots=True, eq=False)
class _Limb:
    """A link that moves, with all that hangs on it: its markers and the free coordinates of its joints."""

    markers: Index
    coordinates: Index
    parent: int  # among the limbs; NONE for one on the ground


def _list_limbs(tree: Tree, free: NDArray[np.bool_]) -> list[_Limb]:
    own = [sorted({v for v in vs if v < tree.n_coordinates and free[v]}) for vs in tree.variables]
    number: dict[int, int] = {}
    limbs = []
    for k, link in enumerate(tree.links):
        above = link.parent
        while above != NONE and above not in number:
            above = tree.links[above].parent
        markers = np.arange(tree.n_markers)[tree.carried[k]]
        if not own[k] or not len(markers):
            continue
        number[k] = len(limbs)
        below = [j for j in range(len(tree.links)) if _hangs_on(tree, j, k)]
        moved = np.array(sorted({v for j in below for v in own[j]}), dtype=np.intp)
        limbs.append(_Limb(markers, moved, number.get(above, NONE)))
    return limbs


def _hangs_on(tree: Tree, link: int, other: int) -> bool:
    while link not in (other, NONE):
        link = tree.links[link].parent
    return link == other


def _measure_markers(task: Task, rows: Index, q: Array) -> Array:
    """Weighted squared distance of every marker, (n_rows, n_markers), m2; zero where not seen."""
    placed = place_tree_markers(task.tree, pose_links(task.tree, np.ascontiguousarray(q.T), task.p))
    gap = task.measured[rows] - np.moveaxis(placed, -1, 0)
    return np.asarray(np.nan_to_num(np.square(gap).sum(axis=2)) * task.weights)


def find_held(task: Task, q: Array, bounds: Bounds, release: Solve) -> NDArray[np.bool_]:
    """Frames in which a limb stands far worse by its limits than it would without them.

    A joint may well stand at the end of its range; but where the limits cost a limb more than its markers
    leave unexplained anyway, another minimum within them is likely.

    ``q`` (n_frames, n_coordinates). ``release``: solves frames without limits.
    """
    held = np.zeros(len(q), dtype=bool)
    at_end = ((q <= bounds[0]) | (q >= bounds[1])) & task.free
    rows = np.flatnonzero(at_end.any(axis=1))
    if not len(rows):
        return held
    now = _measure_markers(task, rows, q[rows])
    released = _measure_markers(task, rows, release(rows, q[rows]).q)
    for limb in _list_limbs(task.tree, task.free):
        own = limb.markers
        least = task.weights[own].sum() * _CAMERA_M**2
        held[rows] |= now[:, own].sum(axis=1) > _RELEASED * (released[:, own].sum(axis=1) + least)
    return held


def find_jumps(tree: Tree, times: Array, q: Array, bounds: Bounds) -> NDArray[np.bool_]:
    """Frames before or after which a joint turns faster than people's joints do."""
    jumps = np.zeros(len(q), dtype=bool)
    if len(q) > 1:
        limit = _JUMP * SPEED * np.diff(times)
        over = np.sqrt(measure_steps(tree, q[:-1, None], q[1:, None], bounds)[:, :, 0, 0]).max(axis=0) > limit
        jumps[1:] |= over
        jumps[:-1] |= over
    return jumps


def measure_steps(tree: Tree, before: Array, after: Array, bounds: Bounds) -> Array:
    """Squares of how far joints turn between poses, (n_turns, n, k, l), rad2.

    ``before`` (n, k, n_coordinates), ``after`` (n, l, n_coordinates): every pose of a frame with every pose of
    the next. A triplet counts as one turn, written in whichever way within the bounds is nearer.
    """
    loose = np.zeros(tree.n_coordinates, dtype=bool)
    loose[find_turning(tree)] = True
    loose &= np.isinf(bounds[0]) & np.isinf(bounds[1])
    triplets, found = find_triplets(tree), []
    for triplet in triplets:
        own = triplet.coordinates
        first, second = before[:, :, None, own], after[:, None, :, own]
        distance = _measure(first, second, loose[own]).sum(axis=-1)
        for a, b, changed in ((True, False, first), (False, True, second)):
            other, allowed = write_within(triplet, changed, bounds)
            one, two = (other, second) if a else (first, other)
            nearer = np.where(allowed, _measure(one, two, loose[own]).sum(axis=-1), np.inf)
            distance = np.minimum(distance, nearer)
        found.append(distance)
    rest = np.setdiff1d(find_rotations(tree), [c for t in triplets for c in t.coordinates])
    apart = _measure(before[:, :, None, rest], after[:, None, :, rest], loose[rest])
    return np.concatenate([np.moveaxis(apart, -1, 0), *(d[None] for d in found)])


def _measure(first: Array, second: Array, loose: NDArray[np.bool_]) -> Array:
    step = second - first
    return np.asarray(np.square(np.where(loose, wrap(step), step)))


def choose_minima(
    task: Task, times: Array, found: MotionSolution, doubted: NDArray[np.bool_], bounds: Bounds, solve: Solve
) -> MotionSolution:
    """The best sequence of minima that many starts find, instead of those that one start led to.

    ``found``: frames in the order of time. ``doubted`` (n_frames,): those that may be wrong. ``bounds``: what
    ``solve`` keeps to.
    """
    seeds = _choose_seeds(doubted)
    poses, costs = _find_minima(task, seeds, found, bounds, solve)
    return _follow(task, times, found, seeds, poses, costs, bounds, solve)


def _choose_seeds(doubted: NDArray[np.bool_]) -> Index:
    """Frames to start anew: evenly over the recording, and evenly over the doubted."""
    n = len(doubted)
    even = np.linspace(0, n - 1, min(_MOST, -(-n // _SPACING) + 1)).round().astype(np.intp)
    rows = np.flatnonzero(doubted)
    some = rows[np.linspace(0, len(rows) - 1, min(len(rows), _MOST)).round().astype(np.intp)]
    return np.union1d(even, some)


def _find_minima(
    task: Task, seeds: Index, found: MotionSolution, bounds: Bounds, solve: Solve
) -> tuple[Array, Array]:
    """The distinct minima of some frames, best first: (n_seeds, k, n_coordinates), and cost (n_seeds, k)."""
    random = np.random.default_rng(0)
    limbs = _list_limbs(task.tree, task.free)
    best, cost = found.q[seeds], found.cost[seeds]
    poses, costs = best[:, None], cost[:, None]
    for _ in range(_ROUNDS):
        starts = np.concatenate(
            [_draw(random, task, best, limb, bounds) for limb in limbs], axis=1
        )  # (n_seeds, n_limbs * draws, n_coordinates)
        some = _solve_all(seeds, starts, solve)
        together = _solve_all(seeds, _combine(task, seeds, best, some[0], limbs)[:, None], solve)
        poses = np.concatenate([poses, some[0], together[0]], axis=1)
        costs = np.concatenate([costs, some[1], together[1]], axis=1)
        poses, costs = _keep_distinct(task.tree, poses, costs, bounds)
        improved = costs[:, 0] < (1.0 - 1e-3) * cost
        best, cost = poses[:, 0], costs[:, 0]
        if not improved.any():
            break
    return poses, costs


def _draw(random: np.random.Generator, task: Task, q: Array, limb: _Limb, bounds: Bounds) -> Array:
    """Poses (n, draws, n_coordinates) with the joints of a limb turned anyhow within their ranges."""
    starts = np.repeat(q[:, None], _DRAWS, axis=1)
    for k in np.intersect1d(limb.coordinates, find_rotations(task.tree)):
        lower, upper = bounds[0][k], bounds[1][k]
        if np.isfinite(upper - lower) and upper - lower < 2.0 * np.pi + 1e-6:
            starts[:, :, k] = random.uniform(lower, upper, starts.shape[:2])
        else:
            starts[:, :, k] += random.normal(0.0, _WIDE, starts.shape[:2])
    return np.clip(starts, *bounds)


def _solve_all(seeds: Index, starts: Array, solve: Solve) -> tuple[Array, Array]:
    """Minima reached from starts (n_seeds, k, n_coordinates), and their cost (n_seeds, k)."""
    n, k, _ = starts.shape
    solution = solve(np.repeat(seeds, k), starts.reshape(n * k, -1))
    return solution.q.reshape(starts.shape), solution.cost.reshape(n, k)


def _combine(task: Task, seeds: Index, best: Array, some: Array, limbs: list[_Limb]) -> Array:
    """One start for every frame: each limb as the start that suits its markers best has it.

    ``some``: (n_seeds, n_starts, n_coordinates), minima. A limb is taken whole where that gains more than its
    parts do.
    """
    n, k, _ = some.shape
    now = _measure_markers(task, seeds, best)
    apart = _measure_markers(task, np.repeat(seeds, k), some.reshape(n * k, -1)).reshape(n, k, -1)
    gains, taken = np.zeros((len(limbs), n)), np.zeros((len(limbs), n))
    pose = best.copy()
    every = np.arange(n)
    choice = np.zeros((len(limbs), n), dtype=np.intp)
    for number in reversed(range(len(limbs))):
        limb = limbs[number]
        costs = apart[:, :, limb.markers].sum(axis=2)
        choice[number] = costs.argmin(axis=1)
        whole = now[:, limb.markers].sum(axis=1) - costs[every, choice[number]]
        parts = gains[[j for j, other in enumerate(limbs) if other.parent == number]].sum(axis=0)
        gains[number], taken[number] = np.maximum(whole, parts), (whole > parts) & (whole > 0.0)
    for number, limb in enumerate(limbs):  # parents first, so that parts which gain more come after
        rows = np.flatnonzero(taken[number])
        pose[np.ix_(rows, limb.coordinates)] = some[rows, choice[number, rows]][:, limb.coordinates]
    return pose


def _keep_distinct(tree: Tree, poses: Array, costs: Array, bounds: Bounds) -> tuple[Array, Array]:
    """The best few minima of every frame, best first, each once; cost infinite where there are fewer."""
    every = np.arange(len(poses))
    left, kept, kept_costs = costs.copy(), [], []
    for _ in range(_KEPT):
        first = left.argmin(axis=1)
        kept.append(poses[every, first])
        kept_costs.append(left[every, first])
        apart = measure_steps(tree, kept[-1][:, None], poses, bounds)[:, :, 0].max(axis=0)
        left[apart < _APART**2] = np.inf
    return np.stack(kept, axis=1), np.stack(kept_costs, axis=1)


def _follow(
    task: Task,
    times: Array,
    found: MotionSolution,
    seeds: Index,
    poses: Array,
    costs: Array,
    bounds: Bounds,
    solve: Solve,
) -> MotionSolution:
    """Minima followed from each seed to the next, forwards and backwards; then the best sequence."""
    n, (count, k, _) = len(found.q), poses.shape
    q = np.repeat(found.q[:, None], 4 * k + 1, axis=1)
    cost = np.full((n, 4 * k + 1), np.inf)
    cost[:, -1] = found.cost
    # Two lanes a way: what starts at one seed goes on past the next, to where that of the one after starts.
    lanes = k * (np.arange(count) % 2)[:, None] + np.arange(k)
    for towards, ends in ((1, np.append(seeds[2:], (n, n))[-count:]), (-1, np.insert(seeds[:-2], 0, (-1, -1))[:count])):
        own = lanes + (0 if towards > 0 else 2 * k)
        rows, here, now, last = seeds, poses, costs, ends
        while len(rows):
            q[rows[:, None], own], cost[rows[:, None], own] = here, now
            going = np.flatnonzero(rows + towards != last)
            rows, own, last = rows[going] + towards, own[going], last[going]
            if len(rows):
                here, now = _solve_all(rows, here[going], solve)
    pull = cost / (2.0 * _SKIN_M**2)
    steps = measure_steps(task.tree, q[:-1], q[1:], bounds).sum(axis=0)
    steps /= 2.0 * np.square(SPEED * np.diff(times))[:, None, None]
    chosen = _find_cheapest_path(pull, steps)
    every = np.arange(n)
    return MotionSolution(q[every, chosen], cost[every, chosen], found.steps, found.converged)


def _find_cheapest_path(own: Array, between: Array) -> Index:
    """Which state (n, k) to take in every frame, with what each costs and each change (n - 1, k, k) to the next."""
    total, back = own[0], np.zeros(own.shape, dtype=np.intp)
    for row, change in enumerate(between, start=1):
        reached = total[:, None] + change
        back[row] = reached.argmin(axis=0)
        total = reached.min(axis=0) + own[row]
    path = np.zeros(len(own), dtype=np.intp)
    path[-1] = total.argmin()
    for row in reversed(range(1, len(own))):
        path[row - 1] = back[row, path[row]]
    return path
