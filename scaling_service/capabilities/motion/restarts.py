"""Inverse kinematics from many starts, where one start may have ended in a wrong minimum.

A local search that starts in one pose can end with a joint at the wrong end of its range, a limb turned
about itself, or now in one and now in another of several minima. What ended so is started again from many
poses, limb by limb, in a few frames; each minimum found there is followed through the frames between; and of
all poses that a frame may then have, the sequence is taken that explains the markers and does not jump
(Viterbi 1967).
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.motion import branches
from scaling_service.capabilities.motion import doubts as motion_doubts
from scaling_service.capabilities.motion.solving import ROUGH, solve_from
from scaling_service.capabilities.motion.task import Task
from scaling_service.core.arrays import Array
from scaling_service.numerics.multibody.laws import NONE
from scaling_service.numerics.multibody.sweep import MotionSolution, SweepSettings

_BETTER = 0.05  # chosen: share of the cost by which another minimum must be better to count
_DRAWS = 8  # chosen: starts of each limb; of three joints one start in three reaches the best minimum
_PROBED = 4  # chosen: limbs that are tried, in two frames each, before all are
_ROUNDS = 3  # chosen: limbs improve each other's frames; two rounds suffice for two arms
_KEPT = 4  # chosen: minima of a frame that are followed
_APART = 0.1  # chosen, rad: what is nearer is one minimum
_SPACING = 10  # chosen: frames (0.8 s of the coarse ones) between two that are started anew
_MOST = 16  # chosen: frames started anew, evenly spaced, and as many of the doubted
_WIDE = 1.0  # chosen, rad: how far starts of a coordinate without a range lie from what was found
_PROBE = SweepSettings(left=2e-2, max_steps=12, quorum=0.5)  # chosen: one better pose is enough to know
_BLOCK = 128  # steps measured together; all of a long recording would take gigabytes


def _measure_turns(task: Task, before: Array, after: Array, *, any_way: bool) -> Iterator[Array]:
    """How far joints turn between poses, each (n, k, l), rad.

    ``before`` (n, k, n_coordinates), ``after`` (n, l, n_coordinates): every pose of a frame with every pose
    of the next. A triplet counts as one turn; with ``any_way``, and without bounds, in whichever way it is
    nearer.
    """
    loose = branches.find_loose(task.tree, task.bounds)
    triplets = branches.find_triplets(task.tree)
    for k in np.setdiff1d(task.tree.rotations, [c for t in triplets for c in t.coordinates]):
        way = after[:, None, :, k, None] - before[:, :, None, k, None]
        yield np.sqrt(branches.measure_step(way, loose[[k]]))
    for triplet in triplets:
        own = triplet.coordinates
        first, second = before[:, :, None, own], after[:, None, :, own]
        distance = branches.measure_step(second - first, loose[own])
        if any_way or loose[own].all():
            other, allowed = branches.write_within(triplet, first, task.bounds)
            again = np.where(allowed, branches.measure_step(second - other, loose[own]), np.inf)
            distance = np.minimum(distance, again)
        yield np.sqrt(distance)


def confirm_doubts(task: Task, found: MotionSolution, doubts: NDArray[np.bool_]) -> bool:
    """Whether other starts of the doubted limbs lead to better poses in a few of the frames.

    ``doubts`` (n_frames, n_limbs).
    """
    limbs = motion_doubts.list_limbs(task.tree, task.free)
    random = np.random.default_rng(0)
    rows, starts = [], []
    for number in _choose_limbs(limbs, doubts)[:_PROBED]:
        own = np.flatnonzero(doubts[:, _list_parts(limbs, number)].any(axis=1))
        few = np.unique(own[[len(own) // 3, 2 * len(own) // 3]])
        rows.append(few)
        drawn = _draw(random, task, found.q[few], limbs[number])
        starts.append(np.concatenate([found.q[few, None], drawn], axis=1))
    cost = _solve_all(task, np.concatenate(rows), np.concatenate(starts), _PROBE)[1]
    return bool((cost[:, 1:].min(axis=1) < (1.0 - _BETTER) * cost[:, 0]).any())


def _list_parts(limbs: tuple[motion_doubts.Limb, ...], number: int) -> list[int]:
    return [number, *(k for k, limb in enumerate(limbs) if limb.parent == number)]


def _choose_limbs(limbs: tuple[motion_doubts.Limb, ...], doubts: NDArray[np.bool_]) -> list[int]:
    """The limbs to turn anyhow, the oftenest doubted first.

    Those on which the smallest of the doubted hang, or these where they hang on nothing, and all larger ones
    that are doubted, too.
    """
    often = doubts.sum(axis=0)
    doubted = set(np.flatnonzero(often).tolist())
    smallest = doubted - {limbs[k].parent for k in doubted}
    chosen = {k: int(often[k]) for k in doubted - smallest}
    for k in smallest:
        above = k if limbs[k].parent == NONE else limbs[k].parent
        chosen[above] = max(chosen.get(above, 0), int(often[k]))
    return sorted(chosen, key=lambda k: (-chosen[k], k))


def choose_minima(
    task: Task, times: Array, found: MotionSolution, doubts: NDArray[np.bool_]
) -> MotionSolution:
    """The best sequence of minima that many starts find, instead of those that one start led to.

    ``found``: frames in the order of time. ``doubts`` (n_frames, n_limbs): what may be wrong.
    """
    # Frames to start anew: evenly over the recording, and evenly over the doubted.
    doubted = np.asarray(doubts.any(axis=1))
    n = len(doubted)
    even = np.linspace(0, n - 1, min(_MOST, -(-n // _SPACING) + 1)).round().astype(np.intp)
    rows = np.flatnonzero(doubted)
    some = rows[np.linspace(0, len(rows) - 1, min(len(rows), _MOST)).round().astype(np.intp)]
    seeds = np.union1d(even, some)
    limbs = motion_doubts.list_limbs(task.tree, task.free)
    chosen = _choose_limbs(limbs, doubts)
    turned = sorted({k for number in chosen for k in _list_parts(limbs, number)})
    poses, costs = _find_minima(task, seeds, found, [limbs[k] for k in turned])
    return _follow(task, times, found, seeds, poses, costs)


def _find_minima(
    task: Task,
    seeds: motion_doubts.Index,
    found: MotionSolution,
    limbs: list[motion_doubts.Limb],
) -> tuple[Array, Array]:
    """The distinct minima of some frames, best first: (n_seeds, k, n_coordinates), and cost (n_seeds, k)."""
    random = np.random.default_rng(0)
    best, cost = found.q[seeds], found.cost[seeds]
    poses, costs = best[:, None], cost[:, None]
    for _ in range(_ROUNDS):
        starts = np.concatenate([_draw(random, task, best, limb) for limb in limbs], axis=1)
        some = _solve_all(task, seeds, starts)
        together = _solve_all(task, seeds, _combine(task, seeds, best, some[0])[:, None])
        poses = np.concatenate([poses, some[0], together[0]], axis=1)
        costs = np.concatenate([costs, some[1], together[1]], axis=1)
        poses, costs = _keep_distinct(task, poses, costs)
        improved = costs[:, 0] < (1.0 - _BETTER) * cost
        best, cost = poses[:, 0], costs[:, 0]
        if not improved.any():
            break
    return poses, costs


def _draw(random: np.random.Generator, task: Task, q: Array, limb: motion_doubts.Limb) -> Array:
    """Poses (n, draws, n_coordinates) with the joints of a limb turned anyhow within their ranges."""
    starts = np.repeat(q[:, None], _DRAWS, axis=1)
    for k in np.intersect1d(limb.coordinates, task.tree.rotations):
        lower, upper = task.bounds[0][k], task.bounds[1][k]
        if np.isfinite(upper - lower) and upper - lower < 2.0 * np.pi + 1e-6:
            starts[:, :, k] = random.uniform(lower, upper, starts.shape[:2])
        else:
            starts[:, :, k] += random.normal(0.0, _WIDE, starts.shape[:2])
    return np.clip(starts, *task.bounds)


def _solve_all(
    task: Task, seeds: motion_doubts.Index, starts: Array, settings: SweepSettings = ROUGH
) -> tuple[Array, Array]:
    """Minima reached from starts (n_seeds, k, n_coordinates), and their cost (n_seeds, k)."""
    n, k, _ = starts.shape
    solution = solve_from(task.in_frames(np.repeat(seeds, k)), starts.reshape(n * k, -1), settings=settings)
    return solution.q.reshape(starts.shape), solution.cost.reshape(n, k)


def _combine(task: Task, seeds: motion_doubts.Index, best: Array, some: Array) -> Array:
    """One start for every frame: each limb as the start that suits its markers best has it.

    ``some``: (n_seeds, n_starts, n_coordinates), minima. A limb is taken whole where that gains more than its
    parts do.
    """
    n, k, _ = some.shape
    limbs, every = motion_doubts.list_limbs(task.tree, task.free), np.arange(n)
    apart = motion_doubts.measure_limbs(task, np.repeat(seeds, k), some.reshape(n * k, -1)).reshape(n, k, -1)
    choice = apart.argmin(axis=1)
    whole = motion_doubts.measure_limbs(task, seeds, best) - apart.min(axis=1)
    gains = np.zeros(whole.shape)
    for number in reversed(range(len(limbs))):
        gains[:, number] += np.maximum(whole[:, number] - gains[:, number], 0.0)
        if limbs[number].parent != NONE:
            gains[:, limbs[number].parent] += gains[:, number]
    pose = best.copy()
    for number, limb in enumerate(limbs):  # parents first, so that parts which gain more come after
        parts = gains[:, [j for j, other in enumerate(limbs) if other.parent == number]].sum(axis=1)
        rows = np.flatnonzero((whole[:, number] > parts) & (whole[:, number] > 0.0))
        taken = some[every, choice[:, number]][rows]
        pose[np.ix_(rows, limb.coordinates)] = taken[:, limb.coordinates]
    return pose


def _keep_distinct(task: Task, poses: Array, costs: Array) -> tuple[Array, Array]:
    """The best few minima of every frame, best first, each once; cost infinite where there are fewer."""
    every = np.arange(len(poses))
    left, kept, kept_costs = costs.copy(), [], []
    for _ in range(_KEPT):
        first = left.argmin(axis=1)
        kept.append(poses[every, first])
        kept_costs.append(left[every, first])
        turns = _measure_turns(task, kept[-1][:, None], poses, any_way=True)
        left[reduce(np.maximum, turns)[:, 0] < _APART] = np.inf
    return np.stack(kept, axis=1), np.stack(kept_costs, axis=1)


def _follow(
    task: Task,
    times: Array,
    found: MotionSolution,
    seeds: motion_doubts.Index,
    poses: Array,
    costs: Array,
) -> MotionSolution:
    """Minima followed from each seed to the next, forwards and backwards; then the best sequence."""
    n, (count, k, _) = len(found.q), poses.shape
    q = np.repeat(found.q[:, None], 4 * k + 1, axis=1)
    cost = np.full((n, 4 * k + 1), np.inf)
    cost[:, -1] = found.cost
    # Two lanes a way: what starts at one seed goes on past the next, to where that of the one after starts.
    lanes = k * (np.arange(count) % 2)[:, None] + np.arange(k)
    for towards, ends in (
        (1, np.append(seeds[2:], (n, n))[-count:]),
        (-1, np.insert(seeds[:-2], 0, (-1, -1))[:count]),
    ):
        own = lanes + (0 if towards > 0 else 2 * k)
        rows, here, now, last = seeds, poses, costs, ends
        while len(rows):
            q[rows[:, None], own], cost[rows[:, None], own] = here, now
            going = np.flatnonzero(rows + towards != last)
            rows, own, last = rows[going] + towards, own[going], last[going]
            if len(rows):
                here, now = _solve_all(task, rows, here[going])
    # Beside all poses those whose bounded triplets can be rewritten; others are written without jumps later.
    for triplet in branches.find_triplets(task.tree):
        if branches.find_loose(task.tree, task.bounds)[triplet.coordinates].all():
            continue
        other, allowed = branches.write_within(triplet, q[:, :, triplet.coordinates], task.bounds)
        some = np.flatnonzero((allowed & np.isfinite(cost)).any(axis=0))
        if len(some):
            again = q[:, some].copy()
            again[:, :, triplet.coordinates] = other[:, some]
            q = np.concatenate([q, again], axis=1)
            cost = np.concatenate([cost, np.where(allowed, cost, np.inf)[:, some]], axis=1)
    chosen = _find_cheapest_path(cost / motion_doubts.SKIN_M**2, _measure_hurry(task, times, q))
    every = np.arange(n)
    return MotionSolution(q[every, chosen], cost[every, chosen], found.steps, found.converged)


def _measure_hurry(task: Task, times: Array, q: Array) -> Iterator[Array]:
    """How much faster than joints turn poses (n, k, n_coordinates) follow each other, (k, k) for each step.

    In squares of the standard deviation of their speed.
    """
    for start in range(0, len(q) - 1, _BLOCK):
        some = q[start : start + _BLOCK + 1]
        steps = np.diff(times[start : start + _BLOCK + 1])[:, None, None]
        hurry = np.zeros((len(steps), q.shape[1], q.shape[1]))
        for turn in _measure_turns(task, some[:-1], some[1:], any_way=False):
            hurry += np.square(np.maximum(turn / steps - motion_doubts.FASTEST, 0.0) / motion_doubts.SPEED)
        yield from hurry


def _find_cheapest_path(own: Array, between: Iterator[Array]) -> motion_doubts.Index:
    """Which state to take in every frame, by what states (n, k) and each change (k, k) cost, (n,)."""
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
