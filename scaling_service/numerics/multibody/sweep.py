"""Inverse kinematics of all frames at once by sweeps over the tree.

Every marker is a unit point mass: the Gauss-Newton matrix of a marker problem then has the
structure of a composite rigid-body inertia, and its factorisation that of the articulated-body
algorithm (Featherstone 2008, ch. 7), by whose letters it stands in
:mod:`scaling_service.numerics.least_squares.elimination`. One sweep from the leaves to the root eliminates
one coordinate after the other, one sweep back gives the step; no Jacobian is formed, and the cost grows
linearly with the number of coordinates. What the markers of a link contribute is held in
sufficient statistics (weight, centroids, second and cross moments), so an iteration does not
depend on the number of markers.

Near the minimum the exact second derivatives are used. Moving a joint turns all that lies below it,
so a marker ``x`` with weighted residual ``r`` has ``d2x/dqi dqj = w_i x (dx/dqj)`` for a joint i above
j. Summed over the markers below j, this adds to the inertia a symmetric matrix of the same size and
to its product with a twist half the spatial cross product of twist and residual wrench. Without it,
the steps shrink slowly along directions that the markers hardly determine.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.arrays import Array
from scaling_service.numerics.least_squares import clusters as clustering
from scaling_service.numerics.least_squares import elimination
from scaling_service.numerics.least_squares.descent import Damping, Rows, Settings, descend
from scaling_service.numerics.least_squares.problem import find_seen
from scaling_service.numerics.multibody.laws import NONE
from scaling_service.numerics.multibody.tree import Poses, Tree, pose_links

_BLOCK = 256  # frames: the working set of a full-body model then fits the second-level cache
# Chosen: a damping below 1e-2 hardly changes a step that raised the cost, and so did half of it; at ``lost``
# steps no longer move anything
_DAMPING = Damping(ease=0.2, tighten=10.0, failed=1e-3, lost=1e8)
_TINY = 1e-10  # share of the total weight (1 m arm) below which a pivot means "not determined"


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SweepSettings(Settings):
    """When to stop, and how strongly to damp: a share of each pivot, and the length of a step."""

    max_steps: int = 60
    damping: float = 2e-7
    rule: Damping = _DAMPING
    left: float = 1e-8
    extrapolate: bool = True
    step_tolerance: float = 1e-9  # rad or m
    halvings: int = 1
    # The most by which any coordinate may move in a step (rad or m); beyond the default, chosen, a linearised
    # rotation means little
    longest: float = 0.8
    close: bool = False  # Whether the start is near enough for second derivatives from the first step on


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class MotionSolution:
    """Coordinates (n_frames, n_coordinates), weighted squared error per frame (m2), and how it ended."""

    q: Array
    cost: Array
    steps: NDArray[np.intp]
    converged: NDArray[np.bool_]

    def frames(self, rows: NDArray[np.intp] | NDArray[np.bool_]) -> MotionSolution:
        """Only these frames."""
        return MotionSolution(self.q[rows], self.cost[rows], self.steps[rows], self.converged[rows])


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Frames:
    """A block of frames: the statistics of every link, and what bounds and pulls the coordinates."""

    tree: Tree
    plan: elimination.Elimination
    p: Array
    clusters: clustering.Clusters  # by row of the plan
    ground: Array
    lower: Array  # (c, 1), as upper: bounds by column
    upper: Array
    prior: tuple[Array, Array] | None  # value and weight, each (n_coordinates, n)
    floor: Array  # (n,) added to every pivot
    longest: float

    def take(self, rows: NDArray[np.intp]) -> _Frames:
        return dataclasses.replace(
            self,
            clusters=self.clusters.take(rows),
            prior=None if self.prior is None else (self.prior[0][:, rows], self.prior[1][:, rows]),
            ground=self.ground[:, rows],
            floor=self.floor[rows],
        )

    def measure(self, x: Array) -> tuple[Array, Array, tuple[Poses, clustering.Misfit]]:
        """Coordinates, the cost with their own tasks, (n,), the poses, and the markers' misfit."""
        poses = pose_links(self.tree, np.ascontiguousarray(x.T), self.p, self.ground)
        frames = poses.frames[self.tree.plan.link_node[self.plan.link_of_row]]
        misfit = clustering.compute_misfit(self.clusters, frames[:, :3], frames[:, 3])
        if self.prior is None:
            return x, misfit.cost, (poses, misfit)
        value, weight = self.prior
        return x, misfit.cost + (weight * (x.T - value) ** 2).sum(axis=0), (poses, misfit)

    def step(self, x: Array, at: tuple[Poses, clustering.Misfit], rows: Rows) -> tuple[Array, Array]:
        """A damped Newton step within the bounds, and the decrease of the cost it promises, (n,).

        Near the minimum, coordinates that their carriers take past a bound are moved just to it, and the step
        of their frames is made again knowing so: cut off afterwards, it may raise the cost.
        """
        poses, misfit = at
        columns, S = self.plan.variables, elimination.compute_motion_subspaces(self.plan, poses)
        now = np.ascontiguousarray(x[:, columns].T)
        low, high = self.lower - now, self.upper - now
        delta, promised = self._eliminate(misfit, S, now, rows, (low, high))
        within = _clip(delta, low, high)
        over = within != delta
        again = np.flatnonzero(over.any(axis=0) & rows.near)
        if len(again):
            given = (np.where(over, within, low)[:, again], np.where(over, within, high)[:, again])
            delta[:, again], promised[again] = self.take(again)._eliminate(
                misfit.take(again), S[..., again], now[:, again], rows.take(again), given
            )
        longest = np.abs(delta).max(axis=0, initial=0.0)
        delta *= self.longest / np.maximum(longest, self.longest)
        trial = x.copy()
        trial[:, columns] = _clip(now + delta, self.lower, self.upper).T
        return trial, promised

    def _eliminate(
        self, misfit: clustering.Misfit, S: Array, now: Array, rows: Rows, limits: elimination.Limits
    ) -> tuple[Array, Array]:
        tasks, near = None, rows.near.astype(float)
        if self.prior is not None:
            value, weight = (part[self.plan.variables] for part in self.prior)
            tasks = (weight, weight * (value - now))
        return elimination.solve_articulated(
            self.plan,
            clustering.compute_curvature_and_wrench(self.clusters, misfit, near),
            S,
            (rows.damping, self.floor),
            second=near,
            tasks=tasks,
            limits=limits,
        )


def _clip(value: Array, lower: Array, upper: Array) -> Array:
    """Values brought between their bounds (as np.clip, which is slow on small arrays)."""
    return np.asarray(np.minimum(np.maximum(value, lower), upper))


def is_articulated(tree: Tree) -> bool:
    """Whether every coordinate enters one link only, which the sweeps need.

    Markers whose local position depends on a coordinate break it too.
    """
    entered = [v for link in tree.variables for v in link if v < tree.n_coordinates]
    moving = any(item.term.factor != NONE for item in tree.marker_terms)
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
    settings: SweepSettings = SweepSettings(),
    progress: Callable[[int], None] | None = None,
) -> MotionSolution:
    """Coordinates that bring the model's markers nearest to the measured ones, frame by frame.

    Minimises ``sum_m w_m |measured_m - model_m(q)|^2 + sum_c v_c (q_c - prior_c)^2`` in every frame
    by damped Gauss-Newton steps with projection on the bounds.

    ``measured`` (n_frames, n_markers, 3), m: NaN where a marker was not seen.
    ``weights``: (n_markers,) or (n_frames, n_markers).
    ``q0``: (n_frames, n_coordinates), rad or m.
    ``p``: (n_parameters,).
    ``free`` bool (n_coordinates,): coordinates to estimate; the others stay at ``q0``.
    ``bounds``: each (n_coordinates,).
    ``prior``: values (n_frames, n_coordinates) and weights (n_coordinates,) or (n_frames, n_coordinates) of
    coordinate tasks.
    ``progress``: called with the number of frames done.
    Raises ValueError: the tree is not articulated (see :func:`is_articulated`).
    """
    if not is_articulated(tree):
        raise ValueError("a coordinate enters several links: use the estimator")
    n, nq = q0.shape
    moving = np.ones(nq, dtype=bool) if free is None else np.asarray(free, dtype=bool)
    limits = (np.full(nq, -np.inf), np.full(nq, np.inf)) if bounds is None else bounds
    q, cost = np.empty((n, nq)), np.empty(n)
    steps, converged = np.zeros(n, dtype=np.intp), np.zeros(n, dtype=bool)
    plan = elimination.plan_elimination(tree, moving.tobytes())
    carrier = plan.row_of_link[tree.marker_link]
    local = (tree.marker_local + tree.marker_shifts @ p)[:, :, None]
    for first in range(0, n, _BLOCK):
        rows = slice(first, min(first + _BLOCK, n))
        some = weights[rows] if weights.ndim == 2 else weights
        heavy = np.where(find_seen(measured[rows]), some, 0.0).T
        filled = np.where((heavy > 0.0).T[:, :, None], measured[rows], 0.0)
        of_points = heavy if tree.placed is None else tree.placed[:, None] * heavy
        count = of_points.sum(axis=0)
        middle = np.einsum("mn,nmc->cn", of_points, filled) / np.where(count > 0.0, count, 1.0)
        moved = np.moveaxis(filled, 0, -1)
        moved = moved - (middle if tree.placed is None else tree.placed[:, None, None] * middle)
        tasks = None
        if prior is not None:
            aims = (prior[0][rows], np.broadcast_to(prior[1], q0.shape)[rows])
            tasks = (np.ascontiguousarray(aims[0].T), np.ascontiguousarray(aims[1].T))
        block = _Frames(
            tree=tree,
            plan=plan,
            p=p,
            clusters=clustering.gather_clusters(carrier, len(tree.links), local, moved, heavy, tree.placed),
            ground=-middle,
            lower=limits[0][plan.variables, None],
            upper=limits[1][plan.variables, None],
            prior=tasks,
            floor=_TINY * heavy.sum(axis=0) + 1e-300,
            longest=settings.longest,
        )
        start = np.array(q0[rows])
        start[:, plan.variables] = _clip(start[:, plan.variables], block.lower.T, block.upper.T)
        found = descend(block, start, settings, close=settings.close)
        q[rows], cost[rows] = found.x, np.maximum(found.cost, 0.0)
        steps[rows], converged[rows] = found.steps, found.converged
        if progress is not None:
            progress(rows.stop)
    return MotionSolution(q, cost, steps, converged)
