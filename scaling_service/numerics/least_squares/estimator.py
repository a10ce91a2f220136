"""One bordered least squares for every kinematic problem.

Frames are coupled only through the shared parameters, so the normal equations are an arrowhead:
a small block of coordinates per frame and one border of parameters. The blocks are eliminated by a
Schur complement; the bounded step of the border is a small dense problem; the same factorisation
gives the covariance of the parameters and tells which of them the recording cannot determine.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from scaling_service.core.arrays import Array
from scaling_service.numerics.least_squares import border as borders
from scaling_service.numerics.least_squares.blocks import (
    EASE,
    LEAST,
    ROUNDING,
    STUCK,
    TIGHTEN,
    clip_to_bounds,
    compute_frame_costs,
    compute_residuals,
)
from scaling_service.numerics.least_squares.problem import Outcome, Problem, Settings, Solution, find_seen

_NULL = 1e-8  # curvature below this share of the largest means that nothing determines the direction
_RESOLUTION_M = 1e-6  # chosen: no camera resolves less, so a perfect fit is not taken for certainty
_SHARE = 1e-4  # of a parameter's direction where nothing is determined, beyond which it is not either


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Uncertainty:
    """What the recording says about the free parameters, each (n_free,).

    ``sd`` is NaN for what neither the recording nor a prior determines, and at bounds.
    ``undetermined`` is the share of each parameter's direction that lies where the recording alone
    has no curvature; ``free_directions`` counts such directions. ``noise`` (m) is the standard
    deviation of one marker coordinate. ``covariance`` is (n_free, n_free), zero at bounds.
    """

    sd: Array
    at_bound: NDArray[np.bool_]
    undetermined: Array
    noise: float
    covariance: Array
    free_directions: int


def solve(
    problem: Problem,
    q0: Array,
    p0: Array,
    settings: Settings = Settings(),
    progress: Callable[[int, float], None] | None = None,
    start: Array | None = None,
) -> Solution:
    """Estimate motion and parameters together (Levenberg-Marquardt on the arrowhead system).

    ``q0``: (n_frames, n_coordinates), rad or m.
    ``p0`` (n_parameters,): centre of the priors, and the parameters' first guess unless ``start`` is given.
    ``progress``: called with the step's number and the cost.
    ``start``: (n_parameters,).
    """
    q, p = clip_to_bounds(problem, q0.copy(), (p0 if start is None else start).copy())
    cost, raise_by = compute_total_cost(problem, q, p, p0), 2.0
    damping, shared = np.full(problem.n_frames, settings.damping), settings.damping
    for steps in range(1, settings.max_steps + 1):
        trial_q, trial_p, promised = borders.compute_step(problem, q, p, p0, damping, shared)
        if promised <= settings.relative_decrease * cost + ROUNDING or shared > STUCK:
            return Solution(q=q, p=p, cost=cost, steps=steps, outcome=Outcome.CONVERGED)
        # Frames share only the parameters: in each the coordinates are chosen that suit the trial's.
        moved, stayed = (compute_frame_costs(problem, each, trial_p) for each in (trial_q, q))
        improved = np.less_equal(moved, stayed)
        trial_q = np.where(improved[:, None], trial_q, q)
        trial_cost = float(np.minimum(moved, stayed).sum()) + compute_prior_cost(problem, trial_p, p0)
        damping = np.clip(damping * np.where(improved, EASE, TIGHTEN), LEAST, STUCK)
        if trial_cost < cost:
            # How much of the damping stays after a step that kept this share of its promise (Nielsen 1999)
            kept = (cost - trial_cost) / promised
            shared = max(shared * max(0.1, 1.0 - (2.0 * min(kept, 1.5) - 1.0) ** 3), LEAST)
            q, p, cost, raise_by = trial_q, trial_p, trial_cost, 2.0
            if progress is not None:
                progress(steps, cost)
        else:
            shared = max(shared, 1e-8) * raise_by
            raise_by *= 2.0
    return Solution(q=q, p=p, cost=cost, steps=settings.max_steps, outcome=Outcome.MAX_STEPS)


def compute_prior_cost(problem: Problem, p: Array, p0: Array) -> float:
    """The priors' share of the cost (m2)."""
    change = (p - p0)[problem.parameters]
    return float(problem.prior_weight @ change**2)


def compute_total_cost(problem: Problem, q: Array, p: Array, p0: Array) -> float:
    """The weighted (robust) sum of squared distances plus the priors' share (m2)."""
    return compute_prior_cost(problem, p, p0) + float(compute_frame_costs(problem, q, p).sum())


def estimate_uncertainty(
    problem: Problem, solution: Solution, p0: Array, variance: float | None = None
) -> Uncertainty:
    """Standard deviations of the free parameters, from the curvature at the solution.

    A parameter at its bound is treated as known. Priors count as far as their weights say.

    ``p0`` (n_parameters,): centre of the priors.
    ``variance`` m2: of one marker coordinate in one independent frame; from the residuals if not given.
    """
    border = borders.linearise(problem, solution.q, solution.p, p0, np.zeros(problem.n_frames))
    value = solution.p[problem.parameters]
    margin = 1e-6 * problem.scale
    at_bound = (value <= problem.lower + margin) | (value >= problem.upper - margin)
    inside = np.ix_(~at_bound, ~at_bound)
    prior = np.diag(problem.prior_weight * problem.scale**2)
    _, loose = _invert_curvature((border.curvature - prior)[inside])
    inverse, open_still = _invert_curvature(border.curvature[inside])
    noise = estimate_residual_variance(problem, solution.q, solution.p) if variance is None else variance
    covariance, undetermined, lost = np.zeros(prior.shape), np.zeros(len(value)), np.zeros(len(value))
    covariance[inside] = noise * inverse
    covariance *= np.outer(problem.scale, problem.scale)
    undetermined[~at_bound] = (loose**2).sum(axis=1)
    lost[~at_bound] = (open_still**2).sum(axis=1)
    sd = np.sqrt(np.diag(covariance).clip(0.0))
    sd[(lost > _SHARE) | at_bound] = np.nan
    return Uncertainty(
        sd=sd,
        at_bound=at_bound,
        undetermined=undetermined,
        noise=float(np.sqrt(noise)),
        covariance=covariance,
        free_directions=loose.shape[1],
    )


def _invert_curvature(curvature: Array) -> tuple[Array, Array]:
    """Pseudo-inverse of a curvature, and the directions (columns) in which there is none."""
    if not len(curvature):
        return curvature, curvature
    values, vectors = linalg.eigh(0.5 * (curvature + curvature.T))
    known = values > _NULL * max(float(np.diag(curvature).max()), 1e-300)
    return (vectors[:, known] / values[known]) @ vectors[:, known].T, vectors[:, ~known]


def estimate_residual_variance(problem: Problem, q: Array, p: Array) -> float:
    """Variance of one marker coordinate in one frame (m2), given the freedom that the fit used up.

    ``q``: (n_frames, n_coordinates).
    ``p``: (n_parameters,).
    """
    shown = find_seen(problem.measured)
    gaps = compute_residuals(problem, q, p) * np.sqrt(problem.weights)[:, None]
    total = float((np.where(shown[:, :, None], gaps, 0.0) ** 2).sum())
    spent = problem.n_frames * len(problem.coordinates) + len(problem.parameters)
    left = max(3 * int(shown.sum()) - spent, 1)
    return max(total / left, _RESOLUTION_M**2)


def estimate_repetition(
    problem: Problem, q: Array, p: Array, blocks: NDArray[np.intp], variance: float
) -> float:
    """How many frames say the same thing about the parameters, at least one.

    Soft tissue moves with the movement, so it pulls a parameter the same way in every frame of a
    trial. If frames were independent, the slopes of whole blocks (trials, or stretches of one) would
    differ as the curvature says; how much more they differ is the design effect of the blocks
    (the clustered form of Huber's sandwich; Liang & Zeger 1986).

    ``blocks`` int (n_frames,): which block each frame belongs to.
    ``variance`` m2: of one frame, as :func:`estimate_residual_variance` gives it.
    """
    names, sizes = np.unique(blocks, return_counts=True)
    if len(names) < 2 or not len(problem.parameters):
        return 1.0
    border = borders.linearise(problem, q, p, p, np.zeros(problem.n_frames))
    curvature = border.curvature - np.diag(problem.prior_weight * problem.scale**2)
    values, vectors = np.linalg.eigh(0.5 * (curvature + curvature.T))
    known = values > _NULL * max(float(np.diag(curvature).max()), 1e-300)
    slopes = borders.compute_frame_slopes(problem, q, p) @ (vectors[:, known] / np.sqrt(values[known]))
    sums = np.array([slopes[blocks == name].sum(axis=0) for name in names])
    sums -= np.outer(sizes / len(blocks), sums.sum(axis=0))
    free = 1.0 - float(((sizes / len(blocks)) ** 2).sum())
    effect = float((sums**2).sum()) / (free * variance * max(int(known.sum()), 1))
    return max(effect, 1.0)
