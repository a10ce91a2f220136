"""Least squares for spline coefficients: normal equations in a band of blocks.

What a frame says is quadratic in x = (q, qdot, qddot). A frame meets six basis functions, so the matrix of
all coefficients is zero beyond six blocks from the diagonal, however long the recording.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve_banded, cholesky_banded

from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.signals.splines import ORDER, SplineBasis

_PAIRS = [(i, j) for j in range(ORDER) for i in range(j, ORDER)]
"""Lower half of the six by six blocks that a frame adds to."""


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """A change of the coefficients (n_coefficients, m) and of the shared numbers (k,)."""

    coefficients: Array
    shared: Array


@dataclass(frozen=True, slots=True, eq=False)
class Quadratic:
    """``value + 2 gradient . d + d . matrix d`` of coefficients and shared numbers moved by d."""

    value: float
    gradient: Array  # (n_coefficients, m)
    # (ORDER, n_coefficients, m, m): ``blocks[lag, a]`` stands at block row ``a + lag``, block column ``a``
    blocks: Array
    shared_gradient: Array  # (k,)
    border: Array  # (n_coefficients, m, k)
    corner: Array  # (k, k)

    def at(self, step: Step) -> float:
        """The value after a step."""
        d, x = step.coefficients, step.shared
        own = 2.0 * float((self.gradient * d).sum()) + float((d * self.times(d)).sum())
        rest = 2.0 * self.shared_gradient + self.corner @ x + 2.0 * np.einsum("amk,am->k", self.border, d)
        return self.value + own + float(x @ rest)

    def times(self, coefficients: Array) -> Array:
        """The matrix of the coefficients times a change of them, (n_coefficients, m)."""
        result: Array = np.einsum("aij,aj->ai", self.blocks[0], coefficients)
        for lag in range(1, ORDER):
            below = self.blocks[lag, :-lag]
            result[lag:] += np.einsum("aij,aj->ai", below, coefficients[:-lag])
            result[:-lag] += np.einsum("aji,aj->ai", below, coefficients[lag:])
        return result


def gathered(basis: SplineBasis, rows: slice, blocks: Array, curvature: Array) -> None:
    """Add what frames say to blocks of the coefficients.

    ``rows``: which frames.
    ``blocks`` (ORDER, n_coefficients, m, m): changed in place.
    ``curvature`` (n_rows, 3, 3, m, m): ``[:, i, j]`` couples the i-th derivative of q to the j-th.
    """
    first, weights = basis.first[rows], basis.weights[rows]
    start, last = int(first[0]), int(first[-1])
    count = np.bincount(first - start, minlength=last - start + 1)
    width, m = int(count.max()), curvature.shape[-1]
    place = (
        first - start,
        np.arange(len(first)) - np.concatenate([[0], np.cumsum(count)[:-1]])[first - start],
    )
    left = np.zeros((len(count), len(_PAIRS), width, 9))
    left[place[0], :, place[1]] = np.stack(
        [weights[:, :, None, i] * weights[:, None, :, j] for i, j in _PAIRS], axis=1
    ).reshape(len(first), len(_PAIRS), 9)
    right = np.zeros((len(count), width, 9, m * m))
    right[place] = curvature.reshape(len(first), 9, m * m)
    summed = left.reshape(len(count), len(_PAIRS), -1) @ right.reshape(len(count), -1, m * m)
    whole = summed.reshape(len(count), len(_PAIRS), m, m)
    for k, (i, j) in enumerate(_PAIRS):
        blocks[i - j, start + j : last + 1 + j] += whole[:, k]


def gathered_rows(basis: SplineBasis, rows: slice, total: Array, values: Array) -> None:
    """Add what frames say, (n_rows, 3, ...), to rows of the coefficients (n_coefficients, ...), in place."""
    first, weights = basis.first[rows], basis.weights[rows]
    n, width = len(first), int(np.prod(values.shape[2:]))
    local = np.swapaxes(weights, 1, 2) @ values.reshape(n, 3, width)  # (n, ORDER, width)
    starts = np.flatnonzero(np.diff(first, prepend=first[0] - 1))
    summed = np.add.reduceat(local, starts, axis=0).reshape(len(starts), ORDER, *values.shape[2:])
    for i in range(ORDER):
        total[first[starts] + i] += summed[:, i]


def banded(blocks: Array) -> Array:
    """Blocks as the lower band that LAPACK takes, shape (ORDER m, n_coefficients m)."""
    count, m = blocks.shape[1], blocks.shape[2]
    band = np.zeros((ORDER * m, count, m))
    for lag in range(ORDER):
        for column in range(m):
            top = max(0, column - lag * m)
            rows = slice(lag * m - column + top, lag * m - column + m)
            band[rows, :, column] = blocks[lag, :, top:, column].T
    return band.reshape(ORDER * m, count * m)


def solve_band(band: Array, right: Array, held: NDArray[np.bool_]) -> Array:
    """Solve for the coefficients that are not held; held ones are zero.

    ``band`` (u + 1, size): lower band of a symmetric matrix; not changed.
    ``right``: (size, columns).
    ``held``: bool (size,).
    Returns (size, columns).
    Raises scipy.linalg.LinAlgError: the matrix is not positive definite.
    """
    if held.any():
        band, right = band.copy(), np.where(held[:, None], 0.0, right)
        fixed = np.flatnonzero(held)
        band[:, fixed] = 0.0
        for below in range(1, len(band)):
            reached = fixed[fixed >= below]
            band[below, reached - below] = 0.0
        band[0, fixed] = 1.0
    factor = cholesky_banded(band, lower=True, check_finite=False)
    found: Array = cho_solve_banded((factor, True), right, check_finite=False)
    return found
