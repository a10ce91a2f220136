"""What inverse kinematics solves: one model, one recording, the markers to follow; and how it is solved."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from scaling_service.capabilities.motion.ranges import Ranges, weigh_ranges
from scaling_service.core.arrays import Array
from scaling_service.core.errors import TrialUnusable
from scaling_service.model import compile as compiling
from scaling_service.model.body import BodyModel
from scaling_service.model.trial import Trial
from scaling_service.numerics.least_squares import estimator, problem
from scaling_service.numerics.multibody import laws, rigid, sweep
from scaling_service.numerics.multibody import tree as trees
from scaling_service.numerics.multibody.closure import Closure
from scaling_service.numerics.multibody.plan import is_plain

ROUGH = sweep.SweepSettings(left=2e-2)
"""Enough to tell one minimum from another."""

_OPEN = 1e-2  # m or rad; chosen: from so near a loop closes without a detour
_LOOSE = estimator.Settings(relative_decrease=1e-3)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Task:
    """What inverse kinematics solves: a compiled model, the markers to follow and how."""

    model: BodyModel
    tree: trees.Tree
    markers: tuple[str, ...]
    measured: Array
    weights: Array
    free: NDArray[np.bool_]
    bounds: tuple[Array, Array]
    p: Array
    ranges: Ranges  # what holds the coordinates that the markers do not show
    loss: problem.Loss = problem.SQUARED
    closure: Closure | None = None

    @classmethod
    def of(
        cls,
        model: BodyModel,
        trial: Trial,
        *,
        weights: Mapping[str, float] | None = None,
        loss: problem.Loss = problem.SQUARED,
        bounded: bool = True,
    ) -> Task:
        """Pair the model's markers with the trial's labels.

        Markers of weight zero and markers that the trial never shows are left out.

        Raises TrialUnusable: the model has no markers, or none of them is seen in the trial.
        """
        if not model.markers:
            raise TrialUnusable(
                f"model '{model.name}' has no markers",
                field="marker_set",
                remedy="Say where your markers sit on it: an OpenSim MarkerSet file under `marker_set:`",
            )
        weighted = weights or {}
        shown = trial.shown_labels
        found = {m.name: float(weighted.get(m.name, m.weight)) for m in model.markers if m.name in shown}
        chosen = {name: weight for name, weight in found.items() if weight > 0.0}
        if not chosen:
            raise TrialUnusable(
                f"none of the markers of model '{model.name}' is seen in trial '{trial.name}'",
                file=trial.name,
                field="markers",
                remedy="Map the labels under `markers:` in the subject file",
            )
        names = tuple(chosen)
        count = len(model.coordinates)
        open_ended = (np.full(count, -np.inf), np.full(count, np.inf))
        tree, measured, free = (
            compiling.compile_model(model, names),
            trial.select(names).markers,
            compiling.free_coordinates(model),
        )
        heavy, p = np.array([chosen[name] for name in names]), compiling.list_parameter_values(model)
        return cls(
            model=model,
            tree=tree,
            markers=names,
            measured=measured,
            weights=heavy,
            free=free,
            bounds=compiling.list_coordinate_bounds(model) if bounded else open_ended,
            p=p,
            ranges=weigh_ranges(model, tree, measured, heavy, free, p),
            loss=loss,
            closure=compiling.compile_constraints(model),
        )

    @property
    def is_swept(self) -> bool:
        """Whether sweeps over the tree solve it: coordinates in one link each, plain squares, no loops."""
        return sweep.is_articulated(self.tree) and self.loss is problem.SQUARED and self.closure is None

    def at(self, p: Array) -> Task:
        """The same task at other parameter values, shape (n_parameters,)."""
        return replace(self, p=p)

    def in_frames(self, rows: NDArray[np.intp] | NDArray[np.bool_]) -> Task:
        """The same task in some frames, which may come again."""
        return replace(self, measured=self.measured[rows], ranges=self.ranges.in_frames(rows))

    def solve(
        self,
        start: Array,
        *,
        settings: sweep.SweepSettings = sweep.SweepSettings(),
        prior: tuple[Array, Array] | None = None,
        progress: Callable[[int], None] | None = None,
    ) -> sweep.MotionSolution:
        """All frames from a start (n_frames, n_coordinates), each to the minimum nearest to it.

        ``prior``: values and weights of the coordinates beside the markers, in place of the joints' ranges.
        ``progress``: called with the number of frames done.
        """
        prior = self.ranges.prior if prior is None else prior
        if not self.is_swept:
            return _solve_densely(self, start, prior)
        return sweep.solve_motion(
            self.tree,
            self.measured,
            self.weights,
            start,
            self.p,
            free=self.free,
            bounds=self.bounds,
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
        and (
            np.broadcast_to(prior[0], start.shape),
            np.broadcast_to(prior[1], start.shape),
        ),
        closure=task.closure,
    )
    if task.closure is not None and np.abs(task.closure.evaluate(start, task.p)).max(initial=0.0) > _OPEN:
        start = estimator.solve_motion_alone(replace(dense, closed=False), start, task.p, _LOOSE).q
    found = estimator.solve_motion_alone(dense, start, task.p, estimator.Settings(relative_decrease=1e-7))
    gap = task.measured - trees.pose_markers(task.tree, found.q, task.p)
    cost = np.nansum(task.weights[:, None] * gap**2, axis=(1, 2))
    return sweep.MotionSolution(
        found.q, cost, np.full(len(cost), found.steps), np.ones(len(cost), dtype=bool)
    )


def guess_start(
    tree: trees.Tree, measured: Array, neutral: Array, p: Array, free: NDArray[np.bool_]
) -> Array:
    """Coordinates with the root link where its markers are, in every frame.

    The root is the first link with free translations and rotations; it is placed by a rigid fit of
    its own markers or, where fewer than three are seen, of all markers of the neutral body. Frames
    in which neither works take the nearest frame's guess.

    ``measured``: (n_frames, n_markers, 3), m.
    ``neutral``: (n_coordinates,).
    ``p``: (n_parameters,).
    ``free``: bool (n_coordinates,).
    Returns (n_frames, n_coordinates).
    """
    q = np.tile(neutral, (len(measured), 1))
    root = _free_root(tree, free)
    if root is None:
        return q
    rotation, position = _place_root(tree, measured, neutral, p, root)
    known = problem.find_seen(position)
    if not known.any():
        return q
    angles = _solve_root_turns(tree, root, rotation[known])
    for coordinate, values in angles.items():
        q[known, coordinate] = values
    # The root's translations set so that its origin lies at `position`
    moved = q[known]
    target = position[known]
    poses = trees.pose_links(tree, np.ascontiguousarray(moved.T), p)
    shifts = [
        e for e in tree.plan.entries if e.link == root and not e.is_turn and is_plain(e.term, tree.factors)
    ]
    if len(shifts) == 3:
        rates = poses.directions(shifts).transpose(2, 1, 0)
        gap = target - poses.origins[root].T
        own = [tree.factors[e.term.factor].coordinate for e in shifts]
        moved[:, own] += np.linalg.solve(rates, gap[:, :, None])[:, :, 0]
    q[known] = moved
    # Frames that could not be placed take the nearest one that could.
    rows = np.flatnonzero(known)
    nearest = rows[np.rint(np.interp(np.arange(len(q)), rows, np.arange(len(rows)))).astype(np.intp)]
    return np.asarray(np.where(known[:, None], q, q[nearest]))


def _free_root(tree: trees.Tree, free: NDArray[np.bool_]) -> int | None:
    for k, link in enumerate(tree.links):
        own = [v for v in tree.variables[k] if v < tree.n_coordinates and free[v]]
        if link.parent == laws.NONE and len(own) >= 3:
            return k
    return None


def _place_root(
    tree: trees.Tree, measured: Array, neutral: Array, p: Array, root: int
) -> tuple[Array, Array]:
    """Rotation (n, 3, 3) and origin (n, 3) of the root link; NaN where it cannot be placed."""
    poses = trees.pose_links(tree, neutral[:, None], p)
    placed = trees.place_tree_markers(tree, poses)[:, :, 0]
    axes, origin = poses.axes[root][:, :, 0], poses.origins[root][:, 0]
    if tree.placed is not None:
        # As :func:`_place_root` by directions: all of the neutral body turned as one, its points' middle
        # kept. `placed` (n_markers, 3), `axes` (3, 3): rows, and `origin` (3,): of the neutral body.
        assert tree.placed is not None
        seen = problem.find_seen(measured)
        is_point = np.asarray(tree.placed > 0.0)
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
