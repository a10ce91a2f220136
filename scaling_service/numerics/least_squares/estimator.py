"""One bordered least squares for every kinematic problem.

Frames are coupled only through the shared parameters, so the normal equations are an arrowhead:
a small block of coordinates per frame and one border of parameters. The blocks are eliminated by a
Schur complement; the bounded step of the border is a small dense problem; the same factorisation
gives the covariance of the parameters and tells which of them the recording cannot determine.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from scaling_service.core.arrays import Array
from scaling_service.numerics.least_squares import border as borders
from scaling_service.numerics.least_squares.blocks import (
    clip_to_bounds,
    compute_frame_costs,
    compute_residuals,
)
from scaling_service.numerics.least_squares.descent import Damping, Rows, descend
from scaling_service.numerics.least_squares.problem import Outcome, Problem, Settings, Solution, find_seen

_NULL = 1e-8  # curvature below this share of the largest means that nothing determines the direction
_RESOLUTION_M = 1e-6  # chosen: no camera resolves less, so a perfect fit is not taken for certainty
_SHARED = Damping(ease=0.1, tighten=2.0, least=1e-12, failed=1e-8, lost=1e12, by_gain=True)  # the parameters'
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
    damping = np.full(problem.n_frames, settings.damping)
    task = _Bordered(problem=problem, p0=p0, rule=settings.rule, damping=damping)
    how = replace(settings, rule=_SHARED, checked=True)
    found = descend(task, np.concatenate([q.ravel(), p])[None], how, progress=progress)
    q, p = task.part(found.x)
    return Solution(
        q=q,
        p=p,
        cost=float(found.cost[0]),
        steps=int(found.steps[0]),
        outcome=Outcome.CONVERGED if found.converged[0] else Outcome.MAX_STEPS,
    )


@dataclass(slots=True, eq=False, kw_only=True)
class _Bordered:
    """All frames and what they share: one row of unknowns, coordinates frame by frame, then parameters."""

    problem: Problem
    p0: Array
    rule: Damping
    damping: Array  # (n_frames,): of each frame's coordinates; the row's own damps the parameters
    before: Array | None = None  # coordinates that the last step started from

    def part(self, x: Array) -> tuple[Array, Array]:
        """Coordinates (n_frames, n_coordinates) and parameters (n_parameters,)."""
        size = self.problem.n_frames * self.problem.tree.n_coordinates
        return x[0, :size].reshape(self.problem.n_frames, -1), x[0, size:]

    def measure(self, x: Array) -> tuple[Array, Array, None]:
        """Frames share only the parameters: in each the coordinates are kept that suit the trial's."""
        q, p = self.part(x)
        costs = compute_frame_costs(self.problem, q, p)
        if self.before is not None:
            stayed = compute_frame_costs(self.problem, self.before, p)
            worse = np.greater(costs, stayed)
            q, costs = np.where(worse[:, None], self.before, q), np.minimum(costs, stayed)
            self.damping = self.rule.adapt(self.damping, worse.astype(np.intp))
        total = float(costs.sum()) + compute_prior_cost(self.problem, p, self.p0)
        return np.concatenate([q.ravel(), p])[None], np.array([total]), None

    def step(self, x: Array, _: None, row: Rows) -> tuple[Array, Array]:
        """By the arrowhead system; see :mod:`.border`."""
        self.before, p = self.part(x)
        q, p, promised = borders.compute_step(
            self.problem, self.before, p, self.p0, self.damping, float(row.damping[0])
        )
        return np.concatenate([q.ravel(), p])[None], np.array([promised])

    def take(self, _: NDArray[np.intp]) -> _Bordered:
        return self


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
