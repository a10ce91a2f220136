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
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from scaling_service.kernels.clusters import (
    Clusters,
    Misfit,
    clusters_of,
    curvature_and_wrench,
    marker_weights,
    misfit_of,
)
from scaling_service.kernels.elimination import Elimination, Pull, elimination_of, step, twists
from scaling_service.kernels.laws import NONE, Array
from scaling_service.kernels.moves import Link
from scaling_service.kernels.tree import Poses, Tree, forward, positions

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
        Stop a frame when the step promises less than this share of its cost. That step is still
        taken; near the minimum steps converge quadratically, so it leaves far less.
    step_tolerance : float
        Or when no coordinate moves by more than this (rad or m).
    damping : float
        First Levenberg-Marquardt damping, as a share of each pivot.
    close : bool
        Whether the start is near enough for second derivatives from the first step on.
    """

    max_steps: int = 60
    relative_decrease: float = 1e-5
    step_tolerance: float = 1e-9
    damping: float = 1e-6
    close: bool = False


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
    plan: Elimination
    p: Array
    signals: Array | None
    clusters: Clusters
    cluster_links: NDArray[np.intp]
    ground: Array
    bounds: tuple[Array, Array]
    prior: tuple[Array, Array]  # value (n_coordinates, n), weight (n_coordinates,)
    floor: Array  # (n,) added to every pivot

    def take(self, rows: NDArray[np.intp]) -> _Problem:
        return replace(
            self,
            clusters=self.clusters.take(rows),
            signals=None if self.signals is None else self.signals[:, rows],
            prior=(self.prior[0][:, rows], self.prior[1]),
            ground=self.ground[:, rows],
            floor=self.floor[rows],
        )

    @property
    def free_to_roam(self) -> bool:
        """Whether neither bounds nor coordinate tasks are there."""
        lower, upper = self.bounds
        columns = self.plan.variables
        unbounded = np.isinf(lower[columns]).all() and np.isinf(upper[columns]).all()
        return bool(unbounded and not self.prior[1].any())

    def misfit(self, q: Array) -> tuple[Poses, Misfit, Array]:
        """Poses, the markers' misfit, and the cost with the coordinates' own tasks, (n,)."""
        poses = forward(self.tree, q, self.p, self.signals, self.ground)
        nodes = self.tree.plan.link_node[self.cluster_links]
        misfit = misfit_of(self.clusters, poses.node_axes[nodes], poses.node_origins[nodes])
        value, weight = self.prior
        tasks = np.einsum("c,cn->n", weight, (q - value) ** 2) if weight.any() else 0.0
        return poses, misfit, misfit.cost + tasks

    def pull(self, q: Array) -> Pull | None:
        """Bounds and tasks by column."""
        if self.free_to_roam:
            return None
        columns = self.plan.variables
        lower, upper = (bound[columns, None] for bound in self.bounds)
        weight = self.prior[1][columns, None]
        return Pull(
            weight, weight * (self.prior[0][columns] - q[columns]), lower - q[columns], upper - q[columns]
        )


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
    plan = elimination_of(tree, moving)
    for start in range(0, n, _BLOCK):
        rows = slice(start, min(start + _BLOCK, n))
        known = None if signals is None else signals[rows].T
        some = weights[rows] if weights.ndim == 2 else weights
        block = _block(tree, plan, p, measured[rows], some, known, limits, (pull[0][rows], pull[1]))
        found = _solve_block(block, np.array(q0[rows].T, order="C"), settings)
        q[rows], cost[rows], steps[rows], converged[rows] = found[0].T, *found[1:]
        if progress is not None:
            progress(rows.stop)
    return MotionSolution(q, cost, steps, converged)


def _block(
    tree: Tree,
    plan: Elimination,
    p: Array,
    measured: Array,
    weights: Array,
    signals: Array | None,
    bounds: tuple[Array, Array],
    prior: tuple[Array, Array],
) -> _Problem:
    heavy = marker_weights(measured, weights)
    filled = np.where((heavy > 0.0).T[:, :, None], measured, 0.0)
    total = heavy.sum(axis=0)
    middle = np.einsum("mn,nmc->cn", heavy, filled) / np.where(total > 0.0, total, 1.0)
    placed = np.moveaxis(filled, 0, -1) - middle
    links = np.array([k for k, rows in enumerate(tree.marker_rows) if len(rows)], dtype=np.intp)
    clusters = clusters_of(
        [tree.marker_rows[k] for k in links], _local_positions(tree, p, signals), placed, heavy
    )
    value = np.ascontiguousarray(prior[0].T)
    floor = _TINY * total + 1e-300
    return _Problem(tree, plan, p, signals, clusters, links, -middle, bounds, (value, prior[1]), floor)


def _local_positions(tree: Tree, p: Array, signals: Array | None) -> Array:
    """Local marker positions (n_markers, 3, n_frames or 1): with all links at ground, positions are local."""
    still = replace(tree, links=tuple(Link(NONE, ()) for _ in tree.links))
    n = 1 if signals is None else signals.shape[1]
    return positions(still, forward(still, np.zeros((tree.n_coordinates, n)), p, signals))


def _solve_block(
    block: _Problem, q: Array, settings: SweepSettings
) -> tuple[Array, Array, NDArray[np.intp], NDArray[np.bool_]]:
    """Damped Newton steps on one block; frames leave it as they converge."""
    n, columns = q.shape[1], block.plan.variables
    lower, upper = block.bounds[0][columns, None], block.bounds[1][columns, None]
    best = q.copy()
    best[columns] = np.clip(q[columns], lower, upper)
    cost, damping = np.full(n, np.inf), np.full(n, settings.damping)
    steps, converged = np.zeros(n, dtype=np.intp), np.zeros(n, dtype=bool)
    near = np.full(n, float(settings.close))
    rows, part, trial = np.arange(n), block, best.copy()
    for _ in range(settings.max_steps):
        poses, misfit, now = part.misfit(trial)
        worse: NDArray[np.bool_] = np.greater(now, cost[rows] * (1.0 + 1e-14))
        if worse.any():
            trial[:, worse] = best[:, rows[worse]]
            poses, misfit, now = part.misfit(trial)
        best[:, rows], cost[rows] = trial, now
        damping[rows] = np.where(worse, np.maximum(damping[rows] * 10.0, 1e-4), damping[rows] * 0.2)
        near[rows] *= ~worse
        delta, promised = _step(part, poses, misfit, trial, damping[rows], near[rows])
        near[rows] = (promised < _NEAR * now) & ~worse
        delta *= np.minimum(1.0, _LONGEST / np.maximum(np.abs(delta).max(axis=0, initial=0.0), _LONGEST))
        trial[columns] = np.clip(trial[columns] + delta, lower, upper)
        steps[rows] += 1
        done = (promised <= settings.relative_decrease * now) | (damping[rows] > 1e8)
        done |= np.abs(delta).max(axis=0, initial=0.0) <= settings.step_tolerance
        if done.any():
            last = rows[done & ~worse]
            best[:, last] = trial[:, done & ~worse]  # too small a step to be checked, but a better pose
            converged[rows[done]] = True
            keep = np.flatnonzero(~done)
            if not len(keep):
                break
            rows, trial, part = rows[keep], np.ascontiguousarray(trial[:, keep]), part.take(keep)
    return best, cost, steps, converged


def _step(
    part: _Problem, poses: Poses, misfit: Misfit, q: Array, damping: Array, near: Array
) -> tuple[Array, Array]:
    """One damped step by column, (c, n), and the decrease of the cost it promises, (n,)."""
    plan = part.plan
    mass = np.zeros((len(plan.parent_row), 6, 7, q.shape[1]))
    mass[plan.row_of_link[part.cluster_links]] = curvature_and_wrench(part.clusters, misfit, near)
    return step(plan, mass, twists(plan, part.tree, poses), part.pull(q), damping, part.floor, near)
