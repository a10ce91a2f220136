"""Inverse kinematics of all frames at once by sweeps over the tree.

Every marker is a unit point mass: the Gauss-Newton matrix of a marker problem then has the
structure of a composite rigid-body inertia, and its factorisation that of the articulated-body
algorithm (Featherstone 2008, ch. 7). One sweep from the leaves to the root eliminates one
coordinate after the other, one sweep back gives the step; no Jacobian is formed, and the cost
grows linearly with the number of coordinates. What the markers of a link contribute is held in
sufficient statistics (weight, centroids, second and cross moments), so an iteration does not
depend on the number of markers.

Near the minimum the exact second derivatives are used. Moving a joint turns all that lies below it,
so a marker ``x`` with weighted residual ``r`` has ``d2x/dqi dqj = w_i x (dx/dqj)`` for a joint i above
j. Summed over the markers below j, this adds to the inertia a symmetric matrix of the same size and
to its product with a twist half the spatial cross product of twist and residual wrench. Without it,
the steps shrink slowly along directions that the markers hardly determine.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.kernels.clusters import Cluster, centre_of, cluster_of, curvature, wrench_of
from scaling_service.kernels.laws import NONE, Array
from scaling_service.kernels.masks import seen
from scaling_service.kernels.tree import Poses, Tree, columns, forward, positions

_BLOCK = 256  # frames: the working set of a full-body model then fits the second-level cache
_NEAR = 0.3  # share of the cost that a step may promise for the next one to use second derivatives
_LONGEST = 0.8  # chosen: rad or m; beyond it a linearised rotation means little
_TINY = 1e-10  # share of the total weight (1 m arm) below which a pivot means "not determined"


@dataclass(frozen=True, slots=True, eq=False)
class SweepSettings:
    """When to stop, and how strongly to damp.

    Parameters
    ----------
    max_steps : int
    relative_decrease : float
        Stop a frame when the step promises less than this share of its cost.
    step_tolerance : float
        Or when no coordinate moves by more than this (rad or m).
    damping : float
        First Levenberg-Marquardt damping, as a share of each pivot.
    """

    max_steps: int = 60
    relative_decrease: float = 1e-8
    step_tolerance: float = 1e-10
    damping: float = 1e-6


DEFAULT = SweepSettings()


@dataclass(frozen=True, slots=True, eq=False)
class MotionSolution:
    """Coordinates (n_frames, n_coordinates), weighted squared error per frame (m2), and how it ended."""

    q: Array
    cost: Array
    steps: NDArray[np.intp]
    converged: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class _Problem:
    """A block of frames: the statistics of every link, and what bounds and pulls the coordinates."""

    tree: Tree
    p: Array
    signals: Array | None
    clusters: tuple[Cluster | None, ...]
    ground: Array
    bounds: tuple[Array, Array]
    free: NDArray[np.bool_]
    prior: tuple[Array, Array]  # value (n_coordinates, n), weight (n_coordinates,)
    floor: Array  # (n,) added to every pivot

    def take(self, rows: NDArray[np.intp]) -> _Problem:
        clusters = tuple(None if c is None else c.take(rows) for c in self.clusters)
        signals = None if self.signals is None else self.signals[:, rows]
        prior = (self.prior[0][:, rows], self.prior[1])
        return _Problem(
            self.tree,
            self.p,
            signals,
            clusters,
            self.ground[:, rows],
            self.bounds,
            self.free,
            prior,
            self.floor[rows],
        )

    def poses(self, q: Array) -> Poses:
        return forward(self.tree, q, self.p, self.signals, self.ground)


def is_articulated(tree: Tree) -> bool:
    """Whether every coordinate enters one link only, which the sweeps need.

    Markers whose local position depends on a coordinate break it too.
    """
    entered = [v for link in tree.variables for v in link if v < tree.n_coordinates]
    moving = any(
        item.term.factor != NONE and tree.factors[item.term.factor].coordinate != NONE
        for item in tree.marker_terms
    )
    return len(entered) == len(set(entered)) and not moving


def solve_motion(
    tree: Tree,
    measured: Array,
    weights: Array,
    q0: Array,
    p: Array,
    *,
    free: NDArray[np.bool_] | None = None,
    bounds: tuple[Array, Array] | None = None,
    prior: tuple[Array, Array] | None = None,
    signals: Array | None = None,
    settings: SweepSettings = DEFAULT,
    progress: Callable[[int], None] | None = None,
) -> MotionSolution:
    """Coordinates that bring the model's markers nearest to the measured ones, frame by frame.

    Minimises ``sum_m w_m |measured_m - model_m(q)|^2 + sum_c v_c (q_c - prior_c)^2`` in every frame
    by damped Gauss-Newton steps with projection on the bounds.

    Parameters
    ----------
    measured : ndarray, shape (n_frames, n_markers, 3), m
        NaN where a marker was not seen.
    weights : ndarray, shape (n_markers,) or (n_frames, n_markers)
    q0 : ndarray, shape (n_frames, n_coordinates), rad or m
    p : ndarray, shape (n_parameters,)
    free : ndarray of bool, shape (n_coordinates,), optional
        Coordinates to estimate; the others stay at ``q0``.
    bounds : pair of ndarray, shape (n_coordinates,), optional
    prior : pair of ndarray (n_frames, n_coordinates) and (n_coordinates,), optional
        Values and weights of coordinate tasks.
    signals : ndarray, shape (n_frames, n_signals), optional
    progress : callable, optional
        Called with the number of frames done.

    Raises
    ------
    ValueError
        The tree is not articulated (see :func:`is_articulated`).
    """
    if not is_articulated(tree):
        raise ValueError("a coordinate enters several links: use the estimator")
    n, nq = q0.shape
    moving = np.ones(nq, dtype=bool) if free is None else np.asarray(free, dtype=bool)
    limits = (np.full(nq, -np.inf), np.full(nq, np.inf)) if bounds is None else bounds
    pull = (q0, np.zeros(nq)) if prior is None else prior
    q, cost = np.empty((n, nq)), np.empty(n)
    steps, converged = np.zeros(n, dtype=np.intp), np.zeros(n, dtype=bool)
    for start in range(0, n, _BLOCK):
        rows = slice(start, min(start + _BLOCK, n))
        known = None if signals is None else signals[rows].T
        some = weights[rows] if weights.ndim == 2 else weights
        block = _block(tree, p, measured[rows], some, known, limits, moving, (pull[0][rows], pull[1]))
        found = _solve_block(block, np.array(q0[rows].T, order="C"), settings)
        q[rows], cost[rows], steps[rows], converged[rows] = found[0].T, *found[1:]
        if progress is not None:
            progress(rows.stop)
    return MotionSolution(q, cost, steps, converged)


def _block(
    tree: Tree,
    p: Array,
    measured: Array,
    weights: Array,
    signals: Array | None,
    bounds: tuple[Array, Array],
    free: NDArray[np.bool_],
    prior: tuple[Array, Array],
) -> _Problem:
    shown = seen(measured)
    heavy = np.where(shown, weights, 0.0).T
    filled = np.where(shown[:, :, None], measured, 0.0)
    total = heavy.sum(axis=0)
    middle = np.einsum("mn,nmc->cn", heavy, filled) / np.where(total > 0.0, total, 1.0)
    placed = np.where(shown.T[:, None], np.moveaxis(filled, 0, -1) - middle, 0.0)
    local = _local_positions(tree, p, signals)
    clusters = tuple(
        cluster_of(local[rows], placed[rows], heavy[rows]) if len(rows) else None for rows in tree.marker_rows
    )
    return _Problem(
        tree,
        p,
        signals,
        clusters,
        -middle,
        bounds,
        free,
        (np.array(prior[0].T), prior[1]),
        _TINY * total + 1e-300,
    )


def _local_positions(tree: Tree, p: Array, signals: Array | None) -> Array:
    """Local marker positions (n_markers, 3, n_frames or 1): with all links at ground, positions are local."""
    still = Tree(
        tuple(type(link)(NONE, ()) for link in tree.links),
        tree.factors,
        tree.n_coordinates,
        tree.n_parameters,
        tree.marker_link,
        tree.marker_local,
        tree.marker_terms,
    )
    n = 1 if signals is None else signals.shape[1]
    return positions(still, forward(still, np.zeros((tree.n_coordinates, n)), p, signals))


def _solve_block(
    block: _Problem, q: Array, settings: SweepSettings
) -> tuple[Array, Array, NDArray[np.intp], NDArray[np.bool_]]:
    """Damped Gauss-Newton on one block; frames leave it as they converge."""
    n = q.shape[1]
    lower, upper = block.bounds[0][:, None], block.bounds[1][:, None]
    best = np.where(block.free[:, None], np.clip(q, lower, upper), q)
    cost, damping = np.full(n, np.inf), np.full(n, settings.damping)
    steps, converged = np.zeros(n, dtype=np.intp), np.zeros(n, dtype=bool)
    near = np.zeros(n)
    rows, part, trial = np.arange(n), block, best.copy()
    for _ in range(settings.max_steps):
        poses = part.poses(trial)
        now = _cost(part, poses, trial)
        worse: NDArray[np.bool_] = np.greater(now, cost[rows] * (1.0 + 1e-14))
        if worse.any():
            trial[:, worse] = best[:, rows[worse]]
            poses = part.poses(trial)
        better = ~worse
        best[:, rows[better]] = trial[:, better]
        cost[rows[better]] = now[better]
        damping[rows] = np.where(worse, np.maximum(damping[rows] * 10.0, 1e-4), damping[rows] * 0.2)
        near[rows] = np.where(worse, 0.0, near[rows])
        delta, promised = _step(part, poses, trial, damping[rows], near[rows])
        near[rows] = (promised < _NEAR * cost[rows]) & better
        delta *= np.minimum(1.0, _LONGEST / np.maximum(np.abs(delta).max(axis=0), _LONGEST))
        steps[rows] += 1
        done = (promised <= settings.relative_decrease * cost[rows]) | (
            np.abs(delta).max(axis=0) <= settings.step_tolerance
        )
        done |= damping[rows] > 1e8
        converged[rows[done]] = True
        trial = np.where(part.free[:, None], np.clip(trial + delta, lower, upper), trial)
        if done.any():
            keep = np.flatnonzero(~done)
            if not len(keep):
                break
            rows, trial, part = rows[keep], np.ascontiguousarray(trial[:, keep]), part.take(keep)
    return best, cost, steps, converged


def _cost(part: _Problem, poses: Poses, q: Array) -> Array:
    total = np.zeros(q.shape[1])
    for k, cluster in enumerate(part.clusters):
        if cluster is None:
            continue
        gap = cluster.seen - centre_of(cluster, poses, k)
        total += cluster.weight * np.einsum("cn,cn->n", gap, gap)
        total += cluster.spread - 2.0 * np.einsum("jan,jan->n", poses.axes[k], cluster.cross)
    value, weight = part.prior
    if weight.any():
        total += np.einsum("c,cn->n", weight, (q - value) ** 2)
    return np.maximum(total, 0.0)


def _step(part: _Problem, poses: Poses, q: Array, damping: Array, near: Array) -> tuple[Array, Array]:
    """One damped step (n_coordinates, n) and the decrease of the cost it promises (n,).

    ``near`` (n,) is one where the exact second derivatives are used, zero for Gauss-Newton.
    """
    inertia, wrench = _gather(part, poses, near)
    load = list(wrench)
    factors: list[list[tuple[int, Array, Array, Array, Array]]] = [[] for _ in part.tree.links]
    value, pull = part.prior
    lower, upper = part.bounds
    for k in range(len(part.tree.links) - 1, -1, -1):
        mass, force, below = inertia[k], wrench[k], load[k]
        if mass is None or force is None or below is None:
            continue
        bend = 0.5 * near * below
        moving = [v for v in part.tree.variables[k] if v < part.tree.n_coordinates and part.free[v]]
        for variable, turn, shift in reversed(columns(part.tree, poses, k, moving) if moving else []):
            twist = np.empty((6, q.shape[1]))
            twist[:3] = 0.0 if turn is None else turn
            twist[3:] = shift
            push = np.einsum("in,ijn->jn", twist, mass) - _wrench_rate(twist, bend)
            pivot = np.abs(np.einsum("jn,jn->n", twist, push)) + pull[variable]
            drive = np.einsum("jn,jn->n", twist, force) + pull[variable] * (value[variable] - q[variable])
            inverse = 1.0 / (pivot * (1.0 + damping) + part.floor)
            held = _held(q[variable], drive, lower[variable], upper[variable])
            if held is not None:
                inverse = np.where(held, 0.0, inverse)
            scaled = push * inverse
            mass = mass - push[:, None] * scaled
            force = force - scaled * drive
            factors[k].append((variable, twist, scaled, inverse, drive))
        parent = part.tree.links[k].parent
        if parent != NONE:
            inertia[parent] = _sum(inertia[parent], mass)
            wrench[parent] = _sum(wrench[parent], force)
            load[parent] = _sum(load[parent], below)
    return _descend(part, factors, q.shape)


def _sum(before: Array | None, more: Array) -> Array:
    return more if before is None else before + more


def _wrench_rate(twist: Array, wrench: Array) -> Array:
    """How a wrench (moment, force) turns with a twist, both (6, n): the spatial cross product."""
    result = np.empty(twist.shape)
    turn, shift, moment, force = twist[:3], twist[3:], wrench[:3], wrench[3:]
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        result[i] = turn[j] * moment[k] - turn[k] * moment[j] + shift[j] * force[k] - shift[k] * force[j]
        result[3 + i] = turn[j] * force[k] - turn[k] * force[j]
    return result


def _held(q: Array, drive: Array, lower: float, upper: float) -> NDArray[np.bool_] | None:
    """Frames in which the coordinate sits at a bound and is pushed beyond it."""
    if np.isinf(lower) and np.isinf(upper):
        return None
    return ((q <= lower) & (drive < 0.0)) | ((q >= upper) & (drive > 0.0))


def _descend(
    part: _Problem, factors: list[list[tuple[int, Array, Array, Array, Array]]], shape: tuple[int, ...]
) -> tuple[Array, Array]:
    delta, promised = np.zeros(shape), np.zeros(shape[1])
    motion: list[Array | None] = [None] * len(factors)
    for k, eliminated in enumerate(factors):
        parent = part.tree.links[k].parent
        velocity = motion[parent] if parent != NONE else None
        for variable, twist, scaled, inverse, drive in reversed(eliminated):
            step = inverse * drive
            promised += step * drive
            if velocity is not None:
                step = step - np.einsum("jn,jn->n", scaled, velocity)
            delta[variable] = step
            velocity = twist * step if velocity is None else velocity + twist * step
        motion[k] = velocity
    return delta, promised


def _gather(part: _Problem, poses: Poses, near: Array) -> tuple[list[Array | None], list[Array | None]]:
    """Curvature (6, 6, n) and residual wrench (6, n) of every link's own markers about the ground origin."""
    inertia: list[Array | None] = [None] * len(part.clusters)
    wrench: list[Array | None] = [None] * len(part.clusters)
    for k, cluster in enumerate(part.clusters):
        if cluster is not None:
            axes, centre = poses.axes[k], centre_of(cluster, poses, k)
            turned = np.einsum("jan,jbn->abn", axes, cluster.cross)
            force = cluster.weight * (cluster.seen - centre)
            inertia[k] = curvature(cluster, axes, centre, turned, force, near)
            wrench[k] = wrench_of(turned, centre, force)
    return inertia, wrench
