"""What the residuals of a fit say about its noise: how large, and how often it is the same again."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scaling_service.numerics.least_squares.border import frame_slopes, linearise
from scaling_service.numerics.least_squares.masks import seen
from scaling_service.numerics.least_squares.problem import Problem, residuals
from scaling_service.numerics.multibody.laws import Array

_RESOLUTION_M = 1e-6  # chosen: no camera resolves less, so a perfect fit is not taken for certainty
_NULL = 1e-8  # curvature below this share of the largest means that nothing determines the direction


def residual_variance(problem: Problem, q: Array, p: Array) -> float:
    """Variance of one marker coordinate in one frame (m2), given the freedom that the fit used up.

    ``q``: (n_frames, n_coordinates).
    ``p``: (n_parameters,).
    """
    shown = seen(problem.measured)
    gaps = residuals(problem, q, p) * np.sqrt(problem.weights)[:, None]
    total = float((np.where(shown[:, :, None], gaps, 0.0) ** 2).sum())
    spent = problem.n_frames * len(problem.coordinates) + len(problem.parameters)
    left = max(3 * int(shown.sum()) - spent, 1)
    return max(total / left, _RESOLUTION_M**2)


def repetition(problem: Problem, q: Array, p: Array, blocks: NDArray[np.intp], variance: float) -> float:
    """How many frames say the same thing about the parameters, at least one.

    Soft tissue moves with the movement, so it pulls a parameter the same way in every frame of a
    trial. If frames were independent, the slopes of whole blocks (trials, or stretches of one) would
    differ as the curvature says; how much more they differ is the design effect of the blocks
    (the clustered form of Huber's sandwich; Liang & Zeger 1986).

    ``blocks`` int (n_frames,): which block each frame belongs to.
    ``variance`` m2: of one frame, as :func:`residual_variance` gives it.
    """
    names, sizes = np.unique(blocks, return_counts=True)
    if len(names) < 2 or not len(problem.parameters):
        return 1.0
    border = linearise(problem, q, p, p, np.zeros(problem.n_frames))
    curvature = border.curvature - np.diag(problem.prior_weight * problem.scale**2)
    values, vectors = np.linalg.eigh(0.5 * (curvature + curvature.T))
    known = values > _NULL * max(float(np.diag(curvature).max()), 1e-300)
    slopes = frame_slopes(problem, q, p) @ (vectors[:, known] / np.sqrt(values[known]))
    sums = np.array([slopes[blocks == name].sum(axis=0) for name in names])
    sums -= np.outer(sizes / len(blocks), sums.sum(axis=0))
    free = 1.0 - float(((sizes / len(blocks)) ** 2).sum())
    effect = float((sums**2).sum()) / (free * variance * max(int(known.sum()), 1))
    return max(effect, 1.0)
