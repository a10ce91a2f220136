"""Which combinations of inertial parameters forces can tell: rank, and the base parameters.

Forces are linear in the parameters, so what a motion tells of them is the row space of its stacked
regressor. It is kept as a triangular factor with as many rows as columns, whatever the recording's length.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr, solve_triangular

from scaling_service.numerics.multibody.laws import Array

RANK = 1e-8
"""Singular value over the largest one, columns scaled to equal length, below which a combination counts as
without effect (chosen: rounding of stacked regressors stays near 1e-14, weak real effects near 1e-5)."""


@dataclass(frozen=True, slots=True, eq=False)
class BaseParameters:
    """The combinations of parameters that forces depend on.

    Parameters
    ----------
    independent : ndarray of int, shape (rank,)
        The columns that are kept, ascending.
    combinations : ndarray, shape (rank, n_columns)
        ``combinations @ parameters`` are the base parameters: every kept parameter plus what the others
        add to it. Forces are ``regressor[:, independent] @ combinations @ parameters``.
    singular_values : ndarray, shape (n_columns,)
        Of the scaled stacked regressor, largest first, relative to the largest.
    """

    independent: NDArray[np.intp]
    combinations: Array
    singular_values: Array

    @property
    def rank(self) -> int:
        """How many combinations are determined."""
        return len(self.independent)


def triangular_factor(regressors: Iterable[Array]) -> Array:
    """The upper triangular factor of regressors stacked on each other.

    Parameters
    ----------
    regressors : iterable of ndarray, shape (..., n_columns)
        Rows with a NaN are left out: they tell nothing.

    Returns
    -------
    ndarray, shape (at most n_columns, n_columns)
        ``R`` with ``R^T R`` the sum of all ``Y^T Y``.

    Raises
    ------
    ValueError
        If there is no complete row.
    """
    factor: Array | None = None
    for regressor in regressors:
        rows = regressor.reshape(-1, regressor.shape[-1])
        rows = rows[np.isfinite(rows).all(axis=1)]
        stacked = rows if factor is None else np.concatenate([factor, rows])
        factor = np.asarray(np.linalg.qr(stacked, mode="r"))
    if factor is None or not len(factor):
        raise ValueError("no complete row: nothing tells about the parameters")
    return factor


def base_parameters(factor: Array, *, rank_tolerance: float = RANK) -> BaseParameters:
    """Base parameters of what a triangular factor stands for.

    Parameters
    ----------
    factor : ndarray, shape (m, n_columns)
        See :func:`triangular_factor`; of random motions for what the model's structure allows, of a
        recording for what that recording shows.
    rank_tolerance : float
        Relative to the largest singular value of the scaled columns.

    Notes
    -----
    Gautier M. (1991) Numerical calculation of the base inertial parameters of robots. J Robotic Syst
    8:485-506: QR with column pivoting, ``base = x_1 + R_1^-1 R_2 x_2``.
    """
    lengths = np.linalg.norm(factor, axis=0)
    scale = np.where(lengths > 0, lengths, 1.0)
    scaled = factor / scale
    values = np.zeros(factor.shape[1])
    found = np.linalg.svd(scaled, compute_uv=False)
    values[: len(found)] = found / found[0]
    rank = int((values > rank_tolerance).sum())
    _, r, order = qr(scaled, mode="economic", pivoting=True)
    others = solve_triangular(r[:rank, :rank], r[:rank, rank:])
    kept = np.argsort(order[:rank])
    combinations = np.zeros((rank, factor.shape[1]))
    combinations[np.arange(rank), order[:rank]] = 1.0
    combinations[:, order[rank:]] = others * scale[order[rank:]] / scale[order[:rank], None]
    return BaseParameters(order[:rank][kept], combinations[kept], values)
