"""The blocks of a kinematic problem, one a frame: what each costs, its normal equations, and its step.

Where the parameters are known, frames share nothing, and this is all that it takes to solve them.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.arrays import Array
from scaling_service.numerics.least_squares.descent import Rows, descend
from scaling_service.numerics.least_squares.problem import Outcome, Problem, Settings, Solution
from scaling_service.numerics.multibody import tree

_RIDGE = 1e-14  # share of the largest curvature, small enough not to hide a free combination of parameters


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Block:
    """The normal equations of some frames, parameters in normalised units."""

    curvature: Array  # (n, nq, nq)
    diagonal: Array  # (n, nq): its diagonal, a closure's equations as one more marker, which is damped
    cross: Array  # (n, nq, np)
    slope: Array  # (n, nq)
    shared_curvature: Array  # (np, np), summed over the frames
    frame_slopes: Array  # (n, np)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Eliminated:
    """How the coordinates of some frames move: ``free_step - follow @ step of the parameters``."""

    rows: slice
    free_step: Array  # (n, nq)
    follow: Array  # (n, nq, np)
    gain: Array  # (n,), decrease of each frame's cost that free_step promises


def solve_motion_alone(problem: Problem, q0: Array, p: Array, settings: Settings = Settings()) -> Solution:
    """Estimate the coordinates, the parameters known: frames share nothing, so each ends by itself.

    A frame ends with the step that promises too little to be worth another look at the cost.

    ``problem``: without parameters to estimate.
    ``q0``: (n_frames, n_coordinates).
    ``p``: (n_parameters,).
    """
    q, p = clip_to_bounds(problem, q0.copy(), p.copy())
    found = descend(_Frames(problem, p), q, settings)
    return Solution(
        q=found.x,
        p=p,
        cost=float(compute_frame_costs(problem, found.x, p).sum()),
        steps=int(found.steps.max(initial=0)),
        outcome=Outcome.CONVERGED if found.converged.all() else Outcome.MAX_STEPS,
    )


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Frames:
    """Frames of a problem whose parameters are known."""

    problem: Problem
    p: Array

    def measure(self, q: Array) -> tuple[Array, Array, None]:
        return q, compute_frame_costs(self.problem, q, self.p), None

    def step(self, q: Array, _: None, state: Rows) -> tuple[Array, Array]:
        problem, moved, promised = self.problem, q.copy(), np.empty(len(q))
        for rows in problem.blocks():
            block = make_block(problem, q, self.p, rows)
            found = eliminate(problem, block, q, rows, state.damping[rows])
            moved[rows, problem.coordinates] += found.free_step
            pins = pin_to_bounds(problem, q[rows], moved[rows])
            if pins is not None:
                found = eliminate(problem, block, q, rows, state.damping[rows], pins)
                moved[rows, problem.coordinates] = q[rows, problem.coordinates] + found.free_step
            promised[rows] = found.gain
        return clip_to_bounds(problem, moved, self.p)[0], promised

    def take(self, rows: NDArray[np.intp]) -> _Frames:
        return _Frames(self.problem.of_frames(rows), self.p)


def clip_to_bounds(problem: Problem, q: Array, p: Array) -> tuple[Array, Array]:
    """Coordinates (n_frames, n_coordinates) and parameters brought within their bounds, in place.

    And to where the closure is obeyed.
    """
    lower, upper = problem.coordinate_bounds
    free = problem.coordinates
    q[:, free] = np.clip(q[:, free], lower[free], upper[free])
    p[problem.parameters] = np.clip(p[problem.parameters], problem.lower, problem.upper)
    if problem.closure is not None and problem.closed:
        problem.closure.close(q, p, free, lower[free], upper[free])
    return q, p


def compute_residuals(problem: Problem, q: Array, p: Array, rows: slice = slice(None)) -> Array:
    """Measured minus model, (n, n_markers, 3), m; NaN where not seen."""
    poses = tree.pose_links(problem.tree, np.ascontiguousarray(q[rows].T), p)
    return problem.measured[rows] - np.moveaxis(tree.place_tree_markers(problem.tree, poses), -1, 0)


def compute_frame_costs(problem: Problem, q: Array, p: Array) -> Array:
    """The weighted (robust) sum of squared distances of each frame, (n_frames,), m2."""
    costs = np.empty(problem.n_frames)
    for rows in problem.blocks():
        gaps = compute_residuals(problem, q, p, rows)
        squared = np.einsum("nmc,nmc->nm", gaps, gaps)
        shown = np.isfinite(squared)
        costs[rows] = (problem.loss.cost(np.where(shown, squared, 0.0)) * shown) @ problem.weights
        if problem.coordinate_prior is not None:
            value, weight = (part[rows] for part in problem.coordinate_prior)
            costs[rows] += (weight * np.square(q[rows] - value)).sum(axis=1)
        if problem.closure is not None:
            costs[rows] += problem.closing * np.square(problem.closure.evaluate(q[rows], p)).sum(axis=1)
    return costs


def pin_to_bounds(problem: Problem, q: Array, moved: Array) -> Array | None:
    """The way to the bound for coordinates that a step carries past it, NaN for the others; None if none is.

    The step is to be made again knowing so; otherwise all the others would move as if these had gone on.

    ``q``, ``moved`` (n, n_coordinates): before and after it. Returns (n, n_free_coordinates).
    """
    free = problem.coordinates
    lower, upper = (bound[free] for bound in problem.coordinate_bounds)
    reached = moved[:, free]
    beyond = (reached < lower) | (reached > upper)
    return np.where(beyond, np.clip(reached, lower, upper) - q[:, free], np.nan) if beyond.any() else None


def make_block(problem: Problem, q: Array, p: Array, rows: slice) -> Block:
    """The normal equations of some frames at coordinates (n_frames, n_coordinates) and parameters."""
    poses = tree.pose_links(problem.tree, np.ascontiguousarray(q[rows].T), p)
    placed = tree.place_tree_markers(problem.tree, poses)
    gap = problem.measured[rows] - np.moveaxis(placed, -1, 0)
    squared = np.einsum("nmc,nmc->nm", gap, gap)
    shown = np.isfinite(squared)
    squared = np.where(shown, squared, 0.0)
    weight = np.where(shown, problem.weights * problem.loss.weight(squared), 0.0)
    gap = np.where(shown[:, :, None], gap, 0.0)
    rates = tree.compute_jacobian(problem.tree, poses, placed, problem.variables)
    white = tree.order_by_frame(rates)
    white *= np.repeat(np.sqrt(weight), 3, axis=1)[:, None]
    gap = gap.reshape(len(gap), -1) * np.repeat(np.sqrt(weight), 3, axis=1)
    stiff = np.square(white[:, : len(problem.coordinates)]).sum(axis=2)
    if problem.closure is not None:
        missed, following = problem.closure.linearise(q[rows], p, problem.variables)
        stiff += problem.weights.sum() * np.square(following[:, : len(problem.coordinates)]).sum(axis=2)
        root = np.sqrt(problem.closing)
        white, gap = np.concatenate([white, root * following], axis=2), np.hstack([gap, -root * missed])
    # Normal equations from derivatives (n, n_variables, m) and residuals (n, m), times root weights.
    nq = len(problem.coordinates)
    own, shared = white[:, :nq], white[:, nq:] * problem.scale[:, None]
    flat = np.ascontiguousarray(shared.transpose(1, 0, 2)).reshape(shared.shape[1], gap.size)
    block = Block(
        curvature=np.matmul(own, own.transpose(0, 2, 1)),
        diagonal=stiff,
        cross=np.matmul(own, shared.transpose(0, 2, 1)),
        slope=np.matmul(own, gap[:, :, None])[:, :, 0],
        shared_curvature=flat @ flat.T,
        frame_slopes=np.matmul(shared, gap[:, :, None])[:, :, 0],
    )
    if problem.coordinate_prior is not None:
        value, held = (part[rows][:, problem.coordinates] for part in problem.coordinate_prior)
        np.einsum("nii->ni", block.curvature)[...] += held
        block.diagonal[...] += held
        block.slope[...] += held * (value - q[rows][:, problem.coordinates])
    return block


def eliminate(
    problem: Problem, block: Block, q: Array, rows: slice, damping: Array, pins: Array | None = None
) -> Eliminated:
    """Solve a block for its coordinates, those pinned or held at a bound excepted.

    ``damping`` (n,) and ``pins`` (n, n_free_coordinates) of its frames: share of the coordinates' curvature,
    and steps that are given, NaN where a coordinate is free. Coordinates that the residuals push beyond a
    bound at which they are do not move in any case.
    """
    if not len(problem.coordinates):
        return Eliminated(rows, block.slope, block.cross, np.zeros(len(q[rows])))
    lower, upper = (bound[problem.coordinates] for bound in problem.coordinate_bounds)
    value, slope = q[rows, problem.coordinates], block.slope
    held = ((value <= lower) & (slope < 0.0)) | ((value >= upper) & (slope > 0.0))
    given = np.where(held, 0.0, np.nan)
    if pins is not None:
        given = np.where(np.isnan(pins), given, pins)
    fixed = ~np.isnan(given)
    moved = np.where(fixed, given, 0.0)
    pulled = np.einsum("nij,nj->ni", block.curvature, moved)
    gain: Array = (moved * (2.0 * block.slope - pulled)).sum(axis=1)
    slope = np.where(fixed, moved, block.slope - pulled)
    cross = np.where(fixed[:, :, None], 0.0, block.cross)
    curvature = np.where(fixed[:, :, None] | fixed[:, None, :], 0.0, block.curvature)
    diagonal = np.einsum("nii->ni", curvature)
    ridge = _RIDGE * diagonal.max(axis=1, initial=0.0, keepdims=True) + 1e-300
    diagonal += np.where(fixed, 1.0, damping[:, None] * block.diagonal + ridge)
    solved = np.linalg.solve(curvature, np.concatenate([slope[:, :, None], cross], axis=2))
    free_step, follow = solved[:, :, 0], np.ascontiguousarray(solved[:, :, 1:])
    gain += np.where(fixed, 0.0, slope * free_step).sum(axis=1)
    return Eliminated(rows, free_step, follow, gain)
