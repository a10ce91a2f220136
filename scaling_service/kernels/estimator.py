"""One bordered least squares for every kinematic problem.

Frames are coupled only through the shared parameters, so the normal equations are an arrowhead:
a small block of coordinates per frame and one border of parameters. The blocks are eliminated by a
Schur complement; the bounded step of the border is a small dense problem; the same factorisation
gives the covariance of the parameters and tells which of them the recording cannot determine.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, optimize

from scaling_service.kernels.laws import Array
from scaling_service.kernels.losses import SQUARED, Loss
from scaling_service.kernels.masks import seen
from scaling_service.kernels.tree import Tree, forward, jacobian, positions

_BLOCK = 256  # frames linearised together
_KEEP = 2**25  # doubles of eliminated blocks kept in memory (256 MiB); beyond it they are made again
_RIDGE = 1e-11  # share of the largest curvature that keeps undetermined directions where they started
_ROUNDING = 1e-26  # m2: a decrease that double precision cannot show on positions of 1 m
_BLOCK_RIDGE = 1e-14  # the same within a frame, small enough not to hide a free combination of parameters
_NULL = 1e-8  # curvature below this share of the largest means that nothing determines the direction


class Outcome(Enum):
    """How an iteration ended."""

    CONVERGED = "converged"
    MAX_STEPS = "max_steps"


@dataclass(frozen=True, eq=False)
class Problem:
    """Markers to be explained by coordinates per frame and parameters shared by all frames.

    Parameters
    ----------
    tree : Tree
    measured : ndarray, shape (n_frames, n_markers, 3), m
        NaN where a marker was not seen.
    weights : ndarray, shape (n_markers,)
    coordinates : ndarray of int, shape (n_free_coordinates,)
        The coordinates to estimate.
    parameters : ndarray of int, shape (n_free,)
        The parameters to estimate.
    scale, lower, upper : ndarray, shape (n_free,)
        Size of a typical change (for normalisation) and bounds.
    prior_weight : ndarray, shape (n_free,)
        Weight of ``(p - p0)**2`` beside the weighted squared distances; zero for none.
    coordinate_bounds : pair of ndarray, shape (n_coordinates,)
    signals : ndarray, shape (n_frames, n_signals), optional
    loss : Loss
    """

    tree: Tree
    measured: Array
    weights: Array
    coordinates: NDArray[np.intp]
    parameters: NDArray[np.intp]
    scale: Array
    lower: Array
    upper: Array
    prior_weight: Array
    coordinate_bounds: tuple[Array, Array]
    signals: Array | None = None
    loss: Loss = SQUARED

    @property
    def n_frames(self) -> int:
        """The number of frames."""
        return len(self.measured)

    @property
    def variables(self) -> NDArray[np.intp]:
        """Free coordinates, then free parameters, as the tree numbers them."""
        return np.concatenate([self.coordinates, self.tree.n_coordinates + self.parameters])

    def blocks(self) -> Iterator[slice]:
        """Frames to be linearised together."""
        return (slice(k, min(k + _BLOCK, self.n_frames)) for k in range(0, self.n_frames, _BLOCK))


@dataclass(frozen=True, slots=True)
class Settings:
    """When to stop: the step promises less than this share of the cost, or so many steps are done."""

    max_steps: int = 100
    relative_decrease: float = 1e-8
    damping: float = 1e-4


DEFAULT = Settings()


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Coordinates (n_frames, n_coordinates), parameters (n_parameters,), cost (m2) and how it ended."""

    q: Array
    p: Array
    cost: float
    steps: int
    outcome: Outcome


@dataclass(frozen=True, slots=True, eq=False)
class Uncertainty:
    """What the recording says about the free parameters, each (n_free,).

    ``sd`` is NaN for directions that nothing determines. ``undetermined`` is the share of each
    parameter's direction that lies where the recording has no curvature. ``noise`` (m) is the
    standard deviation of one marker coordinate that the residuals imply. ``covariance`` is
    (n_free, n_free), zero for parameters at a bound. ``free_directions`` counts the combinations
    of parameters that nothing determines.
    """

    sd: Array
    at_bound: NDArray[np.bool_]
    undetermined: Array
    noise: float
    covariance: Array
    free_directions: int


@dataclass(frozen=True, slots=True, eq=False)
class _Eliminated:
    """One block of frames after its coordinates are eliminated."""

    rows: slice
    free_step: Array  # (n, nq): the coordinates' step for unchanged parameters
    follow: Array  # (n, nq, np): how it follows the parameters
    gain: float  # decrease promised by free_step


@dataclass(slots=True, eq=False)
class _Border:
    """The reduced problem of the parameters, in normalised units."""

    curvature: Array
    slope: Array
    gain: float = 0.0
    kept: list[_Eliminated] = field(default_factory=list)


def residuals(problem: Problem, q: Array, p: Array, rows: slice = slice(None)) -> Array:
    """Measured minus model, (n, n_markers, 3), m; NaN where not seen."""
    known = None if problem.signals is None else problem.signals[rows].T
    poses = forward(problem.tree, np.ascontiguousarray(q[rows].T), p, known)
    return problem.measured[rows] - np.moveaxis(positions(problem.tree, poses), -1, 0)


def total_cost(problem: Problem, q: Array, p: Array, p0: Array) -> float:
    """The weighted (robust) sum of squared distances plus the priors' share (m2)."""
    change = (p - p0)[problem.parameters]
    total = float(problem.prior_weight @ change**2)
    for rows in problem.blocks():
        squared = np.einsum("nmc,nmc->nm", *[residuals(problem, q, p, rows)] * 2)
        shown = np.isfinite(squared)
        total += float((problem.loss.cost(np.where(shown, squared, 0.0)) * shown * problem.weights).sum())
    return total


def solve(
    problem: Problem,
    q0: Array,
    p0: Array,
    settings: Settings = DEFAULT,
    progress: Callable[[int, float], None] | None = None,
) -> Solution:
    """Estimate motion and parameters together (Levenberg-Marquardt on the arrowhead system).

    Parameters
    ----------
    q0 : ndarray, shape (n_frames, n_coordinates), rad or m
    p0 : ndarray, shape (n_parameters,)
        Start, and centre of the priors.
    progress : callable, optional
        Called with the step's number and the cost.
    """
    q, p = _clip(problem, q0.copy(), p0.copy())
    cost, damping, raise_by = total_cost(problem, q, p, p0), settings.damping, 2.0
    steps, outcome = 0, Outcome.MAX_STEPS
    while steps < settings.max_steps:
        border = _linearise(problem, q, p, p0, damping)
        while steps < settings.max_steps:
            steps += 1
            trial_q, trial_p, promised = _trial(problem, border, q, p, damping)
            if promised <= settings.relative_decrease * cost + _ROUNDING:
                outcome = Outcome.CONVERGED
                break
            trial_cost = total_cost(problem, trial_q, trial_p, p0)
            if trial_cost < cost:
                ratio = (cost - trial_cost) / promised
                damping = max(damping * max(0.1, 1.0 - (2.0 * min(ratio, 1.5) - 1.0) ** 3), 1e-12)
                q, p, cost, raise_by = trial_q, trial_p, trial_cost, 2.0
                break
            damping, raise_by = max(damping, 1e-8) * raise_by, raise_by * 2.0
            border = _linearise(problem, q, p, p0, damping)
        if progress is not None:
            progress(steps, cost)
        if outcome is Outcome.CONVERGED or damping > 1e12:
            break
    if damping > 1e12:  # rounding, not the model, now decides whether the cost falls
        outcome = Outcome.CONVERGED
    return Solution(q, p, cost, steps, outcome)


def solve_parameters(
    problem: Problem, q: Array, p0: Array, start: Array, settings: Settings = DEFAULT
) -> Solution:
    """Estimate the parameters alone, the motion held (the second half of the alternating loop)."""
    still = _without_coordinates(problem)
    p, cost, damping = start.copy(), total_cost(problem, q, start, p0), settings.damping
    outcome, steps = Outcome.MAX_STEPS, 0
    while steps < settings.max_steps:
        steps += 1
        border = _linearise(still, q, p, p0, damping)
        _, trial, promised = _trial(still, border, q, p, damping)
        if promised <= settings.relative_decrease * cost + _ROUNDING:
            outcome = Outcome.CONVERGED
            break
        trial_cost = total_cost(problem, q, trial, p0)
        if trial_cost < cost:
            p, cost, damping = trial, trial_cost, max(damping * 0.1, 1e-12)
        else:
            damping = max(damping, 1e-8) * 10.0
    return Solution(q, p, cost, steps, outcome)


def uncertainty(problem: Problem, solution: Solution, p0: Array) -> Uncertainty:
    """Standard deviations of the free parameters, from the curvature at the solution.

    The noise is estimated from the residuals, with the degrees of freedom that the fit left. A
    parameter at its bound is treated as known.
    """
    border = _linearise(problem, solution.q, solution.p, p0, 0.0)
    value = solution.p[problem.parameters]
    margin = 1e-6 * problem.scale
    at_bound = (value <= problem.lower + margin) | (value >= problem.upper - margin)
    inside = ~at_bound
    curvature = border.curvature[np.ix_(inside, inside)]
    eigenvalues, vectors = linalg.eigh(curvature) if inside.any() else (np.zeros(0), np.zeros((0, 0)))
    known = eigenvalues > _NULL * max(float(np.diag(border.curvature).max(initial=0.0)), 1e-300)
    numbers = 3 * int(seen(problem.measured).sum())
    left = numbers - problem.n_frames * len(problem.coordinates) - int(known.sum())
    noise = float(np.sqrt(solution.cost / left)) if left > 0 else float("nan")
    inverse = (vectors[:, known] / eigenvalues[known]) @ vectors[:, known].T
    undetermined = np.zeros(len(value))
    undetermined[inside] = (vectors[:, ~known] ** 2).sum(axis=1)
    covariance = np.zeros((len(value), len(value)))
    covariance[np.ix_(inside, inside)] = noise**2 * inverse
    covariance *= np.outer(problem.scale, problem.scale)
    sd = np.sqrt(np.diag(covariance).clip(0.0))
    sd[undetermined > _SHARE] = np.nan
    sd[at_bound] = np.nan
    return Uncertainty(sd, at_bound, undetermined, noise, covariance, int((~known).sum()))


_SHARE = 1e-4  # of a parameter's direction in the null space, beyond which it is not determined


def _without_coordinates(problem: Problem) -> Problem:
    return Problem(
        **{
            **{name: getattr(problem, name) for name in problem.__dataclass_fields__},
            "coordinates": np.zeros(0, dtype=np.intp),
        }
    )


def _clip(problem: Problem, q: Array, p: Array) -> tuple[Array, Array]:
    free = problem.coordinates
    q[:, free] = np.clip(q[:, free], problem.coordinate_bounds[0][free], problem.coordinate_bounds[1][free])
    p[problem.parameters] = np.clip(p[problem.parameters], problem.lower, problem.upper)
    return q, p


def _linearise(problem: Problem, q: Array, p: Array, p0: Array, damping: float) -> _Border:
    """The reduced curvature and slope of the parameters, the coordinates eliminated."""
    count = len(problem.parameters)
    change = (p - p0)[problem.parameters] * problem.scale
    border = _Border(np.diag(problem.prior_weight * problem.scale**2), -problem.prior_weight * change)
    keep = problem.n_frames * len(problem.coordinates) * (count + 1) <= _KEEP
    for rows in problem.blocks():
        eliminated = _eliminate(problem, q, p, rows, damping, border)
        border.gain += eliminated.gain
        if keep:
            border.kept.append(eliminated)
    return border


def _rows(problem: Problem, q: Array, p: Array, rows: slice) -> tuple[Array, Array]:
    """Whitened residuals (n, 3 m) and derivatives (n, 3 m, n_variables) of a block."""
    known = None if problem.signals is None else problem.signals[rows].T
    poses = forward(problem.tree, np.ascontiguousarray(q[rows].T), p, known)
    placed = positions(problem.tree, poses)
    gap = problem.measured[rows] - np.moveaxis(placed, -1, 0)
    squared = np.einsum("nmc,nmc->nm", gap, gap)
    shown = np.isfinite(squared)
    squared = np.where(shown, squared, 0.0)
    heavy = np.sqrt(np.where(shown, problem.weights * problem.loss.weight(squared), 0.0))
    gap = np.where(shown[:, :, None], gap, 0.0) * heavy[:, :, None]
    rates = np.moveaxis(jacobian(problem.tree, poses, placed, problem.variables), (0, 3), (3, 0))
    n = len(gap)
    rates = (rates * heavy[:, :, None, None]).reshape(n, gap[0].size, len(problem.variables))
    rates[:, :, len(problem.coordinates) :] *= problem.scale
    return gap.reshape(n, -1), rates


def _eliminate(
    problem: Problem, q: Array, p: Array, rows: slice, damping: float, border: _Border | None
) -> _Eliminated:
    """Eliminate the coordinates of a block; add what remains to the border if one is given."""
    gap, rates = _rows(problem, q, p, rows)
    nq = len(problem.coordinates)
    per_frame, shared = rates[:, :, :nq], rates[:, :, nq:]
    slope = np.einsum("nrv,nr->nv", per_frame, gap)
    block = np.matmul(per_frame.transpose(0, 2, 1), per_frame)
    cross = np.matmul(per_frame.transpose(0, 2, 1), shared)
    held = _held(problem, q[rows], slope)
    slope, cross = np.where(held, 0.0, slope), np.where(held[:, :, None], 0.0, cross)
    block = np.where(held[:, :, None] | held[:, None, :], 0.0, block)
    diagonal = np.einsum("nii->ni", block)
    ridge = _BLOCK_RIDGE * diagonal.max(axis=1, initial=0.0, keepdims=True) + 1e-300
    diagonal += np.where(held, 1.0, damping * diagonal + ridge)
    solved = np.linalg.solve(block, np.concatenate([slope[:, :, None], cross], axis=2)) if nq else cross
    free_step, follow = (solved[:, :, 0], solved[:, :, 1:]) if nq else (slope, cross)
    if border is not None:
        flat = shared.reshape(gap.size, shared.shape[2])
        border.curvature += flat.T @ flat - np.einsum("nqp,nqr->pr", cross, follow, optimize=True)
        border.slope += flat.T @ gap.ravel() - np.einsum("nqp,nq->p", cross, free_step)
    return _Eliminated(rows, free_step, follow, float((slope * free_step).sum()))


def _held(problem: Problem, q: Array, slope: Array) -> NDArray[np.bool_]:
    """Coordinates at a bound that the residuals push beyond it, (n, nq)."""
    lower, upper = (bound[problem.coordinates] for bound in problem.coordinate_bounds)
    value = q[:, problem.coordinates]
    held: NDArray[np.bool_] = ((value <= lower) & (slope < 0.0)) | ((value >= upper) & (slope > 0.0))
    return held


def _trial(
    problem: Problem, border: _Border, q: Array, p: Array, damping: float
) -> tuple[Array, Array, float]:
    """The damped, bounded step: new coordinates, new parameters and the decrease that it promises."""
    step = _bounded(problem, border, p, damping)
    trial_p = p.copy()
    trial_p[problem.parameters] += step * problem.scale
    trial_q = q.copy()
    kept = border.kept or (_eliminate(problem, q, p, rows, damping, None) for rows in problem.blocks())
    for block in kept:
        move = block.free_step - np.einsum("nqp,p->nq", block.follow, step)
        trial_q[block.rows, problem.coordinates] += move
    promised = border.gain + float(2.0 * border.slope @ step - step @ border.curvature @ step)
    return (*_clip(problem, trial_q, trial_p), promised)


def _bounded(problem: Problem, border: _Border, p: Array, damping: float) -> Array:
    """The parameters' step in normalised units, within their bounds."""
    if not len(problem.parameters):
        return np.zeros(0)
    curvature = 0.5 * (border.curvature + border.curvature.T)
    diagonal = np.diag(curvature).clip(0.0)
    top = max(float(diagonal.max()), 1e-300)
    curvature = curvature + np.diag(damping * diagonal + _RIDGE * top)
    low = (problem.lower - p[problem.parameters]) / problem.scale
    high = (problem.upper - p[problem.parameters]) / problem.scale
    values, vectors = linalg.eigh(curvature)
    values = np.maximum(values, 0.5 * _RIDGE * top)
    step: Array = vectors @ ((vectors.T @ border.slope) / values)
    if ((step >= low) & (step <= high)).all():
        return step
    root = np.sqrt(values)[:, None] * vectors.T
    target = (vectors.T @ border.slope) / np.sqrt(values)
    gap = high - low
    low = np.where(gap > 0.0, low, low - 1e-12)
    bounded = optimize.lsq_linear(root, target, (low, np.maximum(high, low + 1e-12)), method="bvls")
    within: Array = np.clip(bounded.x, low, high)
    return within
