"""The Gaussian posterior of a kinematic problem: poses of all frames, and what the frames share.

``y = h(q, p) + e`` with errors that markers of one link share, and a Gaussian prior of the shared parameters,
of any covariance. Poses have none but where a joint's range holds what markers hardly show. They are
eliminated frame by frame (an arrowhead, as in :mod:`.border`), so the curvature that is left is the inverse
covariance of the parameters.

The iteration over all is its own, not :mod:`.descent`'s: after each step, poses are moved by further ones, so
that what a step promises does not tell how far the cost falls; it ends by the fall, in units of chi-squared.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.arrays import Array
from scaling_service.numerics.least_squares.descent import Damping, Rows, Settings, descend
from scaling_service.numerics.least_squares.problem import Outcome, find_seen
from scaling_service.numerics.least_squares.whitening import (
    ErrorGroup,
    PosteriorProblem,
    Whitening,
)
from scaling_service.numerics.multibody import laws
from scaling_service.numerics.multibody import tree as trees

MOST_STEPS = 30
"""Chosen: beyond it only directions move that nothing tells of."""

_INNER = 2  # chosen: steps of the poses alone after one of all, which bends less then
_FRAMES = 256  # linearised together
_AT_ONCE = 16  # frames of which all slopes meet all others
_ENOUGH = 0.05
"""Decrease of the cost, in units of one chi-squared, that ends the search: so small a one moves nothing by a
quarter of its deviation."""
_LEFT = 0.01  # of a frame's cost that its poses may leave: none moves by more than a tenth of its deviation
_FIRST, _EASE, _RAISE, _LEAST = 1e-3, 0.1, 10.0, 1e-9  # damping, as a share of the curvature
_LOST = 1.0  # damping of a frame's poses beyond which it stays where it is
_TINY = 1e-300
_MOST = 1e6  # damping beyond which rounding decides
_RIDGE = 1e-9  # of a frame's largest curvature: what its markers do not show stays where it started

_ALONE = Settings(
    max_steps=MOST_STEPS,
    damping=_FIRST,
    rule=Damping(ease=_EASE, tighten=_RAISE, least=_LEAST, lost=_LOST),
    left=0.0,
    left_over=_LEFT,
    extrapolate=True,
)
_BETWEEN = replace(_ALONE, max_steps=_INNER, left_over=0.0, checked=True)
"""Of poses where parameters are known, each frame by itself; and between two steps of all."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Posterior:
    """Mean and covariance.

    ``q`` (n_frames, n_coordinates) and ``p`` (n_parameters,) are the mean, ``covariance`` is that of the
    parameters. ``cost``: residuals and departure from the prior, each over its variance. ``misfit``:
    residuals alone, each as far as errors beside the instrument's rule it, and ``freedom`` what that is
    expected to be where errors are as large as assumed. ``squares`` (n_frames,): of each frame's residuals,
    by their variances, over how many there are.
    """

    q: Array
    p: Array
    covariance: Array
    cost: float
    misfit: float
    freedom: float
    squares: Array
    steps: int
    outcome: Outcome


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Normal:
    """Whitened residuals with the normal equations of frames and parameters, without the prior."""

    own: Array  # (n, nq, nq)
    cross: Array  # (n, nq, np)
    slope: Array  # (n, nq)
    shared: Array  # (np, np)
    shared_slope: Array  # (np,)


def solve_posterior(
    problem: PosteriorProblem,
    q0: Array,
    p0: Array,
    progress: Callable[[int, float], None] | None = None,
    most: int = MOST_STEPS,
) -> Posterior:
    """Mean and covariance of poses and parameters (Gauss-Newton with Levenberg's damping).

    ``q0`` (n_frames, n_coordinates), ``p0`` (n_parameters,): where to start; has no influence on what is
    determined. ``progress``: called with the step's number and the cost. ``most``: steps.
    """
    whitening, q, p = Whitening(problem), q0.copy(), p0.copy()
    gap = _whiten_gaps(problem, whitening, q, p)
    cost, normal = _compute_cost(problem, gap, q, p), _linearise(problem, whitening, q, p, gap)
    damping, outcome, steps = _FIRST, Outcome.MAX_STEPS, 0
    while steps < most and outcome is Outcome.MAX_STEPS:
        steps += 1
        curvature, slope, solved = _eliminate(problem, normal, p, damping)
        damped = curvature + damping * np.diag(np.diag(curvature))
        step: Array = np.asarray(np.linalg.solve(damped, slope), dtype=float)
        trial_q, trial_p = q.copy(), p + step
        trial_q[:, problem.coordinates] += solved[:, :, 0] - solved[:, :, 1:] @ step
        trial_q = descend(_Poses(problem, whitening, trial_p), trial_q, _BETWEEN).x
        trial_gap = _whiten_gaps(problem, whitening, trial_q, trial_p)
        trial_cost = _compute_cost(problem, trial_gap, trial_q, trial_p)
        if trial_cost > cost:
            damping *= _RAISE
            outcome = Outcome.CONVERGED if damping > _MOST else outcome
            continue
        if cost - trial_cost < _ENOUGH:
            outcome = Outcome.CONVERGED
        q, p, cost, damping = trial_q, trial_p, trial_cost, max(_EASE * damping, _LEAST)
        normal = _linearise(problem, whitening, q, p, trial_gap)
        if progress is not None:
            progress(steps, cost)
    problem = replace(problem, integrated=None)
    white = _whiten_gaps(problem, whitening, q, p)
    normal = _linearise(problem, whitening, q, p, white)
    curvature, _, _ = _eliminate(problem, normal, p, 0.0)
    covariance: Array = np.asarray(np.linalg.inv(curvature), dtype=float)
    told = len(p) - float(np.einsum("ij,ji->", covariance, problem.prior.precision))
    told += float(problem.shares.sum()) * len(problem.coordinates)
    misfit, weights, count = whitening.weigh_misfit(white)
    numbers = 3.0 * find_seen(problem.measured).sum(axis=1)
    return Posterior(
        q=q,
        p=p,
        covariance=covariance,
        cost=cost,
        misfit=misfit,
        freedom=weights * max(1.0 - told / max(count, 1.0), 0.0),
        squares=np.square(white).sum(axis=1) / np.maximum(problem.shares * numbers, _TINY),
        steps=steps,
        outcome=outcome,
    )


def _whiten_gaps(problem: PosteriorProblem, whitening: Whitening, q: Array, p: Array) -> Array:
    """Whitened residuals, (n, 3 n_markers)."""
    poses = trees.pose_links(problem.tree, np.ascontiguousarray(q.T), p)
    gap = np.moveaxis(problem.measured, 0, -1) - trees.place_tree_markers(problem.tree, poses)
    gap = np.where(np.isfinite(gap), gap, 0.0)
    return whitening.apply(poses.axes, problem.tree.marker_link, gap[None])[:, 0]


def _compute_cost(problem: PosteriorProblem, white: Array, q: Array, p: Array) -> float:
    """The cost of whitened residuals and of the prior, but for a constant."""
    cost = float((white**2).sum()) + float(_compute_held_costs(problem, q).sum())
    prior = problem.prior
    return cost + float(p @ prior.precision @ p - 2.0 * prior.pull @ p) if prior.names else cost


def _linearise(
    problem: PosteriorProblem,
    whitening: Whitening,
    q: Array,
    p: Array,
    gap: Array,
    *,
    shared: bool = True,
) -> _Normal:
    """``shared``: whether parameters are among the variables.

    A parameter of one marker alone meets no other group's residuals: their products are left out.
    """
    tree, nq, n = problem.tree, len(problem.coordinates), len(q)
    poses = trees.pose_links(tree, np.ascontiguousarray(q.T), p)
    count = len(p) if shared else 0
    alone = tree.marker_parameters if shared else {}
    common = np.array([k for k in range(count) if k not in alone], dtype=np.intp)
    numbers = np.array([*alone], dtype=np.intp)
    owners = np.array([marker for marker, _ in alone.values()], dtype=np.intp)
    variables = np.concatenate([problem.coordinates, tree.n_coordinates + common])
    rates = trees.compute_jacobian(tree, poses, trees.place_tree_markers(tree, poses), variables)
    white = whitening.apply(poses.axes, tree.marker_link, rates)
    own, wide = white[:, :nq], white[:, nq:]
    curvature, slope = own @ own.transpose(0, 2, 1), (own @ gap[:, :, None])[:, :, 0]
    cross, together, pull = np.zeros((n, nq, count)), np.zeros((count, count)), np.zeros(count)
    if shared:
        flat = _flatten(wide)
        cross[:, :, common] = own @ wide.transpose(0, 2, 1)
        together[np.ix_(common, common)] = flat @ flat.T
        pull[common] = flat @ gap.ravel()
    for part in whitening.parts:
        names = numbers[np.isin(owners, part.group.markers)]
        if len(names):
            narrow = whitening.apply_along(part, *_find_directions(tree, poses, names, part.group))
            flat = _flatten(narrow)
            cross[:, :, names] = own[:, :, part.columns] @ narrow.transpose(0, 2, 1)
            together[np.ix_(names, names)] = flat @ flat.T
            beside = flat @ _flatten(wide[:, :, part.columns]).T
            together[np.ix_(names, common)], together[np.ix_(common, names)] = beside, beside.T
            pull[names] = flat @ gap[:, part.columns].ravel()
    for precision, pull_of_q in _list_held(problem):
        curvature += precision
        slope += pull_of_q - (precision @ q[:, problem.coordinates, None])[:, :, 0]
    return _Normal(own=curvature, cross=cross, slope=slope, shared=together, shared_slope=pull)


def _flatten(white: Array) -> Array:
    """Numbers by frame (n, k, m) in one row each, (k, n m)."""
    n, count, m = white.shape
    return np.ascontiguousarray(white.transpose(1, 0, 2)).reshape(count, n * m)


def _find_directions(
    tree: trees.Tree, poses: trees.Poses, parameters: NDArray[np.intp], group: ErrorGroup
) -> tuple[Array, Array]:
    """The direction along which each parameter moves its one marker in the link, and how far per unit.

    Returns (k, 3 m) and (k, n).
    """
    gains = np.zeros((len(parameters), len(group.markers), 3))
    rates = np.empty((len(parameters), poses.frames.shape[-1]))
    row = {int(marker): k for k, marker in enumerate(group.markers)}
    for k, parameter in enumerate(parameters):
        marker, term = tree.marker_parameters[int(parameter)]
        gains[k, row[marker]] = term.gain
        rates[k] = poses.values.by_parameter(term)
    return gains.reshape(len(parameters), -1), rates


def _eliminate(
    problem: PosteriorProblem, normal: _Normal, p: Array, damping: float
) -> tuple[Array, Array, Array]:
    """Curvature and slope of the parameters, and how each frame's coordinates follow: (n, nq, 1 + np)."""
    own = normal.own.copy()
    diagonal = np.einsum("nii->ni", own)
    diagonal += damping * diagonal + _RIDGE * diagonal.max(axis=1, keepdims=True, initial=0.0) + 1e-300
    solved = np.linalg.solve(own, np.concatenate([normal.slope[:, :, None], normal.cross], axis=2))
    nq, count = normal.cross.shape[1:]
    crossed = normal.cross.reshape(-1, count).T @ solved.reshape(len(own) * nq, -1)
    prior = problem.prior
    curvature = normal.shared + prior.precision - crossed[:, 1:]
    slope = normal.shared_slope + prior.pull - prior.precision @ p - crossed[:, 0]
    return 0.5 * (curvature + curvature.T), slope, solved


def integrate_over(
    problem: PosteriorProblem, q: Array, p: Array, latent: NDArray[np.intp]
) -> PosteriorProblem:
    """The problem with what the likelihood's integral over some parameters adds to its cost.

    The mode of poses and parameters together is not where the poses are likeliest by themselves: markers that
    slide with an angle, by slopes that are not known, allow larger angles at no cost, the more of
    them there are. The likelihood of the rest, integrated over places and slopes (Laplace), holds half
    the logarithm of the determinant of their curvature G. With their covariance V, given the rest, that is
    trace(V G) / 2, where G, the poses eliminated, is quadratic in the angles which drive the slopes.

    ``latent``: parameters of one marker each, constant or in proportion to one coordinate. ``q``, ``p``: the
    mode.
    """
    tree, nq = problem.tree, len(problem.coordinates)
    column = {int(c): k for k, c in enumerate(problem.coordinates)}
    drives = np.zeros((len(latent), nq + 1))
    for k, parameter in enumerate(latent):
        factor = tree.marker_parameters[int(parameter)][1].factor
        if factor == laws.NONE:
            drives[k, nq] = 1.0
        elif tree.factors[factor].coordinate in column:
            drives[k, column[tree.factors[factor].coordinate]] = 1.0
    whitening = Whitening(problem)
    normal = _linearise(problem, whitening, q, p, _whiten_gaps(problem, whitening, q, p))
    covariance = np.linalg.inv(_eliminate(problem, normal, p, 0.0)[0][np.ix_(latent, latent)])
    found = np.zeros((len(q), nq + 1, nq + 1))
    for start in range(0, len(q), _AT_ONCE):
        rows = slice(start, start + _AT_ONCE)
        curvature = _eliminate_slopes(problem.in_frames(rows), q[rows], p, latent, normal.own[rows])
        found[rows] = drives.T @ (covariance * curvature) @ drives
    return replace(problem, integrated=(found[:, :nq, :nq], -found[:, :nq, nq]))


def _eliminate_slopes(
    problem: PosteriorProblem, q: Array, p: Array, latent: NDArray[np.intp], own: Array
) -> Array:
    """Each frame's curvature of latent parameters per unit of their drivers, the poses eliminated, (n, k, k).

    ``own`` (n, nq, nq): the poses' curvature. Parameters of different groups meet in the poses alone.
    """
    tree, whitening = problem.tree, Whitening(problem)
    poses = trees.pose_links(tree, np.ascontiguousarray(q.T), p)
    rates = trees.compute_jacobian(tree, poses, trees.place_tree_markers(tree, poses), problem.coordinates)
    white = whitening.apply(poses.axes, tree.marker_link, rates)
    crossed = np.zeros((*own.shape[:2], len(latent)))
    owners = np.array([tree.marker_parameters[int(k)][0] for k in latent])
    groups = []
    for part in whitening.parts:
        rows = np.flatnonzero(np.isin(owners, part.group.markers))
        gains, _ = _find_directions(tree, poses, latent[rows], part.group)
        unit = whitening.apply_along(part, gains, np.ones((len(rows), len(q))))
        crossed[:, :, rows] = white[:, :, part.columns] @ unit.transpose(0, 2, 1)
        groups.append((rows, unit @ unit.transpose(0, 2, 1)))
    curvature = -crossed.transpose(0, 2, 1) @ np.linalg.solve(_with_ridge(own), crossed)
    for rows, alone in groups:
        curvature[np.ix_(np.arange(len(q)), rows, rows)] += alone
    return np.asarray(curvature)


def solve_poses(problem: PosteriorProblem, q0: Array, p: Array) -> Array:
    """The mean of the poses (n_frames, n_coordinates) where the parameters are known.

    Frames share nothing then, so each has its own damping. ``q0``: where to start.
    """
    q = q0.copy()
    for rows in split_rows(len(q)):
        part = problem.in_frames(rows)
        q[rows] = descend(_Poses(part, Whitening(part), p), q[rows], _ALONE).x
    return q


def propagate(
    problem: PosteriorProblem,
    q: Array,
    p: Array,
    covariance: Array,
    known: NDArray[np.bool_],
    alike: float,
) -> tuple[Array, Array]:
    """Covariance of each frame's poses, (n_frames, n, n), from markers and from the parameters'.

    And the standard deviation of each coordinate's mean, (n,): what the parameters leave open is the same in
    all frames, and markers' errors last. NaN for a coordinate that is known in no frame.

    ``q``, ``p``: the mean. ``covariance`` (n_parameters, n_parameters). ``known`` (n_frames, n): which of the
    coordinates count in the means. ``alike``: over how many frames the markers' errors last.
    """
    n, nq = len(q), len(problem.coordinates)
    found, common, lasting = np.zeros((n, nq, nq)), np.zeros((nq, len(p))), np.zeros(nq)
    share = known / np.maximum(known.sum(axis=0), 1)
    for rows in split_rows(n):
        part = problem.in_frames(rows)
        whitening = Whitening(part)
        normal = _linearise(part, whitening, q[rows], p, _whiten_gaps(part, whitening, q[rows], p))
        inverse = np.linalg.inv(_with_ridge(normal.own))
        follow = inverse @ normal.cross
        found[rows] = inverse + follow @ covariance @ follow.transpose(0, 2, 1)
        common += np.einsum("ni,nip->ip", share[rows], follow)
        lasting += (share[rows] ** 2 * np.einsum("nii->ni", inverse)).sum(axis=0)
    counted = np.minimum(alike, known.sum(axis=0))
    mean = np.einsum("ip,pk,ik->i", common, covariance, common) + counted * lasting
    return found, np.where(known.any(axis=0), np.sqrt(mean), np.nan)


def split_rows(count: int) -> list[slice]:
    """All frames in blocks."""
    return [slice(start, min(start + _FRAMES, count)) for start in range(0, count, _FRAMES)]


def _with_ridge(own: Array) -> Array:
    own = own.copy()
    diagonal = np.einsum("nii->ni", own)
    diagonal += _RIDGE * diagonal.max(axis=1, keepdims=True, initial=0.0) + 1e-300
    return own


@dataclass(frozen=True, slots=True, eq=False)
class _Poses:
    """Frames whose parameters are known."""

    problem: PosteriorProblem
    whitening: Whitening
    p: Array

    def measure(self, q: Array) -> tuple[Array, Array, Array]:
        """Costs but for a constant, and the whitened residuals."""
        gap = _whiten_gaps(self.problem, self.whitening, q, self.p)
        return q, np.square(gap).sum(axis=1) + _compute_held_costs(self.problem, q), gap

    def step(self, q: Array, gap: Array, rows: Rows) -> tuple[Array, Array]:
        """All coordinates, of which those to estimate move."""
        normal = _linearise(self.problem, self.whitening, q, self.p, gap, shared=False)
        own = _with_ridge(normal.own)
        diagonal = np.einsum("nii->ni", own)
        diagonal += rows.damping[:, None] * diagonal
        step = np.linalg.solve(own, normal.slope[:, :, None])
        bent = (step.transpose(0, 2, 1) @ normal.own @ step)[:, 0, 0]
        trial = q.copy()
        trial[:, self.problem.coordinates] += step[:, :, 0]
        return trial, 2.0 * (step[:, :, 0] * normal.slope).sum(axis=1) - bent

    def take(self, rows: NDArray[np.intp]) -> _Poses:
        """The same of some rows."""
        return _Poses(self.problem.in_frames(rows), self.whitening.in_frames(rows), self.p)


def _compute_held_costs(problem: PosteriorProblem, q: Array) -> Array:
    """What rules each frame's coordinates beside the markers, (n,), but for a constant."""
    costs, own = np.zeros(len(q)), q[:, problem.coordinates]
    for precision, pull in _list_held(problem):
        costs += np.einsum("nij,ni,nj->n", precision, own, own) - 2.0 * (pull * own).sum(axis=1)
    return costs


def _list_held(problem: PosteriorProblem) -> list[tuple[Array, Array]]:
    return [part for part in (problem.held, problem.integrated) if part is not None]
