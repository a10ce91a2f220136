"""The arrowhead system of a kinematic problem: a block per frame, one border of shared parameters.

The blocks are eliminated by a Schur complement, which leaves a small dense problem in the
parameters. Damping is a share of each curvature (Levenberg-Marquardt); every frame has its own, and
the parameters have theirs, so that one unruly frame does not slow the others.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import scipy
from scipy import linalg

from scaling_service.core.arrays import Array
from scaling_service.numerics.least_squares.blocks import (
    Block,
    Eliminated,
    clip_to_bounds,
    eliminate,
    make_block,
    pin_to_bounds,
)
from scaling_service.numerics.least_squares.problem import Problem

_KEEP = (
    2**24
)  # doubles of blocks kept in memory (256 MiB with what is eliminated); beyond, they are made again
_RIDGE = 1e-11  # share of the largest curvature that keeps undetermined directions where they started


@dataclasses.dataclass(slots=True, eq=False, kw_only=True)
class Border:
    """What is left for the parameters, in normalised units: curvature (np, np) and slope (np,).

    ``gains`` (n_frames,) is what the coordinates alone promise of each frame's cost. ``blocks`` and ``kept``:
    what it was made from; empty where that takes too much memory.
    """

    curvature: Array
    slope: Array
    gains: Array
    blocks: list[Block] = dataclasses.field(default_factory=list)
    kept: list[Eliminated] = dataclasses.field(default_factory=list)


def linearise(
    problem: Problem,
    q: Array,
    p: Array,
    p0: Array,
    damping: Array,
    pins: Array | None = None,
    made: Sequence[Block] = (),
) -> Border:
    """Eliminate the coordinates of all frames around a motion and parameters.

    ``q``: (n_frames, n_coordinates).
    ``p``, ``p0`` (n_parameters,): where the parameters are, and the centre of the priors.
    ``damping`` (n_frames,): share of the coordinates' curvature in each frame.
    ``pins`` (n_frames, n_free_coordinates): steps that are given; NaN where a coordinate is free. Coordinates
        that the residuals push beyond a bound at which they are do not move in any case.
    ``made``: the blocks of an earlier border around the same; none if they were not kept.
    """
    count = len(problem.parameters)
    change = (p - p0)[problem.parameters] * problem.scale
    prior = np.diag(problem.prior_weight * problem.scale**2)
    slope, gains = -problem.prior_weight * change, np.zeros(problem.n_frames)
    border = Border(curvature=prior, slope=slope, gains=gains)
    keep = problem.n_frames * len(problem.coordinates) * (count + 1) <= _KEEP
    for k, rows in enumerate(problem.blocks()):
        block = made[k] if made else make_block(problem, q, p, rows)
        eliminated = eliminate(problem, block, q, rows, damping[rows], _take(pins, rows))
        # Sum over frames of `left^T right`, both (n, nq, np)
        n, nq, count = block.cross.shape
        total: Array = block.cross.reshape(n * nq, count).T @ eliminated.follow.reshape(n * nq, count)
        border.curvature += block.shared_curvature - total
        border.slope += block.frame_slopes.sum(axis=0)
        border.slope -= np.einsum("nqp,nq->p", block.cross, eliminated.free_step)
        border.gains[rows] = eliminated.gain
        if keep:
            border.blocks.append(block)
            border.kept.append(eliminated)
    return border


def compute_frame_slopes(problem: Problem, q: Array, p: Array) -> Array:
    """Slope of the parameters frame by frame, the coordinates eliminated, without the priors' pull.

    Returns (n_frames, n_free): in normalised units.
    """
    slopes = np.empty((problem.n_frames, len(problem.parameters)))
    for rows in problem.blocks():
        block = make_block(problem, q, p, rows)
        eliminated = eliminate(problem, block, q, rows, np.zeros(len(q[rows])))
        slopes[rows] = block.frame_slopes - np.einsum("nqp,nq->np", block.cross, eliminated.free_step)
    return slopes


def compute_step(
    problem: Problem, q: Array, p: Array, p0: Array, damping: Array, shared: float
) -> tuple[Array, Array, float]:
    """The damped, bounded step: new coordinates, new parameters and the decrease that it promises.

    ``damping`` (n_frames,), ``shared``: shares of the curvature of every frame's coordinates, and of the
    parameters'.

    Coordinates that it would carry past a bound are moved just to it, and the step is made again
    knowing so; otherwise all the others would have moved as if they had gone on.
    """
    border = linearise(problem, q, p, p0, damping)
    trial_q, trial_p, promised = _solve_step(problem, border, q, p, damping, shared, None)
    pins = pin_to_bounds(problem, q, trial_q)
    if pins is not None:
        border = linearise(problem, q, p, p0, damping, pins, border.blocks)
        trial_q, trial_p, promised = _solve_step(problem, border, q, p, damping, shared, pins)
    return (*clip_to_bounds(problem, trial_q, trial_p), promised)


def _solve_step(
    problem: Problem, border: Border, q: Array, p: Array, damping: Array, shared: float, pins: Array | None
) -> tuple[Array, Array, float]:
    step, curvature = _bound_step(problem, border, p, shared)
    trial_p, trial_q = p.copy(), q.copy()
    trial_p[problem.parameters] += step * problem.scale
    made_again = (
        eliminate(problem, make_block(problem, q, p, rows), q, rows, damping[rows], _take(pins, rows))
        for rows in problem.blocks()
    )
    for block in border.kept or made_again:
        trial_q[block.rows, problem.coordinates] += block.free_step - block.follow @ step
    promised = float(border.gains.sum() + 2.0 * border.slope @ step - step @ curvature @ step)
    return trial_q, trial_p, promised


def _take(pins: Array | None, rows: slice) -> Array | None:
    return None if pins is None else pins[rows]


def _bound_step(problem: Problem, border: Border, p: Array, damping: float) -> tuple[Array, Array]:
    """The parameters' step in normalised units, within their bounds, and the curvature it was made with."""
    if not len(problem.parameters):
        return np.zeros(0), border.curvature
    curvature = 0.5 * (border.curvature + border.curvature.T)
    diagonal = np.diag(curvature).clip(0.0)
    top = max(float(diagonal.max()), 1e-300)
    values, vectors = linalg.eigh(curvature + np.diag(damping * diagonal + _RIDGE * top))
    values = np.maximum(values, 0.5 * _RIDGE * top)
    upward = vectors.T @ border.slope
    step: Array = vectors @ (upward / values)
    used = (vectors * values) @ vectors.T
    low = (problem.lower - p[problem.parameters]) / problem.scale
    high = (problem.upper - p[problem.parameters]) / problem.scale
    if ((step >= low) & (step <= high)).all():
        return step, used
    return minimise_within(values, vectors, upward, low, high), used


def minimise_within(values: Array, vectors: Array, slope: Array, low: Array, high: Array) -> Array:
    """The x (n,) between ``low`` and ``high`` that minimises ``x' V diag(values) V' x / 2 - slope' V' x``.

    ``values`` (n,), positive, and ``vectors`` V (n, n): the curvature's.
    ``slope`` (n,): along the vectors.
    """
    root = np.sqrt(values)
    room = np.maximum(high, low + 1e-12)  # lsq_linear wants room, also for a parameter held at one value
    found = scipy.optimize.lsq_linear(root[:, None] * vectors.T, slope / root, (low, room), method="bvls")
    return np.asarray(np.clip(found.x, low, high))
