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

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.arrays import Array
from scaling_service.numerics.least_squares import clusters as clustering
from scaling_service.numerics.least_squares import elimination
from scaling_service.numerics.least_squares.problem import find_seen
from scaling_service.numerics.multibody.laws import NONE
from scaling_service.numerics.multibody.tree import Poses, Tree, pose_links

_BLOCK = 256  # frames: the working set of a full-body model then fits the second-level cache
_NEAR = 0.3  # share of the cost that a step may promise for the next one to use second derivatives
_LOST = 1e8  # chosen: a damping at which steps no longer move anything
_SHORTER = 0.5  # chosen: share of a step that is tried where the whole one raised the cost
_FAILED = 1e-2  # chosen: damping where the shorter one did, too; less hardly changes the next step
_TINY = 1e-10  # share of the total weight (1 m arm) below which a pivot means "not determined"


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SweepSettings:
    """When to stop, and how strongly to damp."""

    max_steps: int = 60
    # Stop a frame when its step leaves less than this share of its cost to be gained. That step is still
    # taken; if steps go on to promise less at the same rate, what it leaves is ``promise * rate / (1 -
    # rate)``.
    left: float = 1e-8
    step_tolerance: float = 1e-9  # Or when no coordinate moves by more than this (rad or m)
    # The most by which any coordinate may move in a step (rad or m); beyond the default, chosen, a linearised
    # rotation means little
    longest: float = 0.8
    damping: float = 1e-6  # First Levenberg-Marquardt damping, as a share of each pivot
    quorum: float = 1.0  # Share of the frames that must have converged; the others may then stay behind
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
class _Problem:
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

    def take(self, rows: NDArray[np.intp]) -> _Problem:
        return dataclasses.replace(
            self,
            clusters=self.clusters.take(rows),
            prior=None if self.prior is None else (self.prior[0][:, rows], self.prior[1][:, rows]),
            ground=self.ground[:, rows],
            floor=self.floor[rows],
        )

    def misfit(self, q: Array) -> tuple[Poses, clustering.Misfit, Array]:
        """Poses, the markers' misfit, and the cost with the coordinates' own tasks, (n,)."""
        poses = pose_links(self.tree, q, self.p, self.ground)
        frames = poses.frames[self.tree.plan.link_node[self.plan.link_of_row]]
        misfit = clustering.compute_misfit(self.clusters, frames[:, :3], frames[:, 3])
        if self.prior is None:
            return poses, misfit, misfit.cost
        value, weight = self.prior
        return poses, misfit, misfit.cost + (weight * (q - value) ** 2).sum(axis=0)


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
    for start in range(0, n, _BLOCK):
        rows = slice(start, min(start + _BLOCK, n))
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
        block = _Problem(
            tree=tree,
            plan=plan,
            p=p,
            clusters=clustering.gather_clusters(carrier, len(tree.links), local, moved, heavy, tree.placed),
            ground=-middle,
            lower=limits[0][plan.variables, None],
            upper=limits[1][plan.variables, None],
            prior=tasks,
            floor=_TINY * heavy.sum(axis=0) + 1e-300,
        )
        found = _solve_block(block, np.array(q0[rows].T, order="C"), settings)
        q[rows], cost[rows], steps[rows], converged[rows] = found[0].T, *found[1:]
        if progress is not None:
            progress(rows.stop)
    return MotionSolution(q, cost, steps, converged)


@dataclasses.dataclass(slots=True, eq=False, kw_only=True)
class _State:
    """The frames still being solved: each array's last axis."""

    rows: NDArray[np.intp]  # their numbers in the block
    best: Array  # (n_coordinates, n) the best pose so far, of this cost
    cost: Array
    damping: Array
    near: Array  # 1.0 where second derivatives are used
    promised: Array  # decrease that the step before promised

    def take(self, rows: NDArray[np.intp]) -> _State:
        return _State(**{f.name: getattr(self, f.name)[..., rows] for f in dataclasses.fields(self)})


def _solve_block(
    part: _Problem, q: Array, settings: SweepSettings
) -> tuple[Array, Array, NDArray[np.intp], NDArray[np.bool_]]:
    """Damped Newton steps on one block; frames leave it as they converge."""
    n, columns = q.shape[1], part.plan.variables
    q[columns] = _clip(q[columns], part.lower, part.upper)
    cost, steps, converged = np.empty(n), np.zeros(n, dtype=np.intp), np.zeros(n, dtype=bool)
    state = _State(
        rows=np.arange(n),
        best=q,
        cost=np.full(n, np.inf),
        damping=np.full(n, settings.damping),
        near=np.full(n, float(settings.close)),
        promised=np.full(n, np.inf if settings.close else 0.0),  # a close start counts as a step made
    )
    trial = q.copy()
    for number in range(1, settings.max_steps + 1):
        poses, misfit, now, worse = _evaluate(part, trial, state)
        state.best, state.cost = trial, now
        state.damping = np.where(worse, np.maximum(state.damping * 10.0, _FAILED), state.damping * 0.2)
        state.near *= ~worse
        delta, promised = _solve_step(part, poses, misfit, state)
        longest = np.abs(delta).max(axis=0, initial=0.0)
        delta *= settings.longest / np.maximum(longest, settings.longest)
        trial = trial.copy()
        trial[columns] = _clip(trial[columns] + delta, part.lower, part.upper)
        before = np.minimum(np.where(worse, 0.0, state.promised), now)
        done = promised**2 <= settings.left * now * np.maximum(before - promised, promised)
        done |= (longest <= settings.step_tolerance) | (state.damping > _LOST)
        state.near, state.promised = ((promised < _NEAR * now) & ~worse).astype(float), promised
        if done.any() or number == settings.max_steps:
            # A last step is too small to be worth a check; a frame that just failed keeps its best pose.
            taken = done & ~worse
            q[:, state.rows] = np.where(taken, trial, state.best)
            cost[state.rows] = np.where(taken, np.maximum(now - promised, 0.0), now)
            steps[state.rows], converged[state.rows] = number, done
            keep = np.flatnonzero(~done)
            if len(keep) <= (1.0 - settings.quorum) * n:
                break
            state, trial, part = state.take(keep), trial[:, keep], part.take(keep)
    return q, cost, steps, converged


def _evaluate(
    part: _Problem, trial: Array, state: _State
) -> tuple[Poses, clustering.Misfit, Array, NDArray[np.bool_]]:
    """Poses, misfit and cost of a trial, which is drawn back (in place) in frames where it is worse.

    First to a part of the way; where that is worse, too, to the best pose so far. Such frames come last.
    """
    poses, misfit, now = part.misfit(trial)
    for share in (_SHORTER, 0.0):
        worse: NDArray[np.bool_] = np.greater(now, state.cost * (1.0 + 1e-14))
        if not worse.any():
            break
        best = state.best[:, worse]
        trial[:, worse] = best + share * (trial[:, worse] - best)
        poses, misfit, now = part.misfit(trial)
    return poses, misfit, now, worse


def _clip(value: Array, lower: Array, upper: Array) -> Array:
    """Values brought between their bounds (as np.clip, which is slow on small arrays)."""
    return np.asarray(np.minimum(np.maximum(value, lower), upper))


def _solve_step(
    part: _Problem, poses: Poses, misfit: clustering.Misfit, state: _State
) -> tuple[Array, Array]:
    """One damped step by column, (c, n), and the decrease of the cost it promises, (n,).

    Near the minimum, coordinates that their carriers take past a bound are moved just to it, and the step of
    their frames is made again knowing so: cut off afterwards, it may raise the cost.
    """
    twist, now = elimination.compute_twists(part.plan, poses), state.best[part.plan.variables]
    low, high = part.lower - now, part.upper - now
    delta, promised = _eliminate(part, misfit, twist, state, (low, high))
    within = _clip(delta, low, high)
    over = within != delta
    rows = np.flatnonzero(over.any(axis=0) & (state.near > 0.0))
    if len(rows):
        given = (np.where(over, within, low)[:, rows], np.where(over, within, high)[:, rows])
        again = _eliminate(part.take(rows), misfit.take(rows), twist[..., rows], state.take(rows), given)
        delta[:, rows], promised[rows] = again
    return delta, promised


def _eliminate(
    part: _Problem,
    misfit: clustering.Misfit,
    twist: Array,
    state: _State,
    limits: elimination.Limits,
) -> tuple[Array, Array]:
    tasks, columns = None, part.plan.variables
    if part.prior is not None:
        value, weight = part.prior[0][columns], part.prior[1][columns]
        tasks = (weight, weight * (value - state.best[columns]))
    return elimination.solve_step(
        part.plan,
        clustering.compute_curvature_and_wrench(part.clusters, misfit, state.near),
        twist,
        (state.damping, part.floor),
        second=state.near,
        tasks=tasks,
        limits=limits,
    )
