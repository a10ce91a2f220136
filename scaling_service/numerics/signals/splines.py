"""B-splines of signals: values, velocities and accelerations that are exact derivatives of each other.

What a frame says of their coefficients is quadratic in x = (q, qdot, qddot). A frame meets six basis
functions, so the matrix of all coefficients is zero beyond six blocks from the diagonal, however long the
recording.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from scaling_service.core.arrays import Array
from scaling_service.numerics.signals.filters import find_runs

DEGREE = 5
"""Quintic: accelerations are then smooth cubics. OpenSim differentiates coordinates by such splines too."""

ORDER = DEGREE + 1
"""Basis functions that a time meets."""

MIN_SAMPLES = ORDER
"""A spline of that degree needs as many samples."""

ORDERS = 3
"""Value, first and second derivative."""

_RIDGE = 1e-10
"""Share of the largest diagonal that holds coefficients that no sample meets at zero (chosen: far below what
a sample says, far above rounding)."""

_PAIRS = [(i, j) for j in range(ORDER) for i in range(j, ORDER)]
"""Lower half of the six by six blocks that a frame adds to."""


@dataclass(frozen=True, eq=False)
class SplineBasis:
    """Quintic B-splines on even knots, seen at some times.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.linspace(0.0, 2.0, 201)
    >>> basis = SplineBasis(t, 0.05)
    >>> position, velocity, acceleration = basis.evaluate(basis.fit(np.sin(t)[:, None]))
    >>> bool(np.allclose(acceleration[:, 0], -np.sin(t), atol=1e-4))
    True
    """

    times: Array  # (n,), s: strictly increasing
    spacing_s: float  # Between knots, about: the recording is divided evenly

    def __post_init__(self) -> None:
        if len(self.times) < ORDER or not (np.diff(self.times) > 0).all() or not self.spacing_s > 0:
            raise ValueError(f"a spline needs {ORDER} increasing times and a spacing above zero")

    @cached_property
    def n_intervals(self) -> int:
        """Into how many stretches the recording is divided."""
        length = float(self.times[-1] - self.times[0])
        return max(1, min(round(length / self.spacing_s), len(self.times) - ORDER + 1))

    @property
    def n_coefficients(self) -> int:
        """The number of basis functions."""
        return self.n_intervals + DEGREE

    @cached_property
    def knots(self) -> Array:
        """Even knots, those at the ends repeated, shape (n_coefficients + ORDER,), s."""
        inner = np.linspace(self.times[0], self.times[-1], self.n_intervals + 1)
        return np.concatenate([np.repeat(inner[0], DEGREE), inner, np.repeat(inner[-1], DEGREE)])

    @cached_property
    def first(self) -> NDArray[np.intp]:
        """The first of the ``ORDER`` basis functions that each time meets, shape (n,)."""
        inner = self.knots[DEGREE : DEGREE + self.n_intervals + 1]
        return np.clip(np.searchsorted(inner, self.times, side="right") - 1, 0, self.n_intervals - 1)

    @cached_property
    def weights(self) -> Array:
        """What each time's basis functions add per unit coefficient, shape (n, ORDERS, ORDER).

        Row 0 to the value, row 1 to the first, row 2 to the second derivative (per s and per s2).
        """
        found = np.empty((len(self.times), ORDERS, ORDER))
        for local in range(ORDER):
            # Every ORDER-th basis function at once: their supports meet at no time.
            for start in range(ORDER):
                one = np.zeros(self.n_coefficients)
                one[start::ORDER] = 1.0
                here = (self.first + local) % ORDER == start
                if here.any():
                    spline = scipy.interpolate.BSpline(self.knots, one, DEGREE)
                    for order in range(ORDERS):
                        found[here, order, local] = spline(self.times[here], nu=order)
        return found

    def evaluate(self, coefficients: Array) -> tuple[Array, Array, Array]:
        """Values, first and second derivatives at the times.

        ``coefficients``: (n_coefficients, m).
        Returns three ndarrays, shape (n, m).
        """
        taken = coefficients[self.first[:, None] + np.arange(ORDER)]
        value, first, second = np.moveaxis(self.weights @ taken, 1, 0)
        return value, first, second

    def fit(self, values: ArrayLike) -> Array:
        """Coefficients nearest to samples at the times, shape (n_coefficients, m).

        ``values`` (n, m): NaN where not known; elsewhere nothing is asked.
        """
        samples = np.asarray(values, dtype=float)
        known = np.isfinite(samples)
        result = np.empty((self.n_coefficients, samples.shape[1]))
        patterns, member = np.unique(known, axis=1, return_inverse=True)
        for k in range(patterns.shape[1]):
            columns = np.flatnonzero(member.ravel() == k)
            filled = np.where(patterns[:, k, None], samples[:, columns], 0.0)
            # Banded least squares; `seen` is 1 where a sample counts.
            rows = self.weights[:, 0] * patterns[:, k].astype(float)[:, None]
            band, right = (
                np.zeros((ORDER, self.n_coefficients)),
                np.zeros((self.n_coefficients, filled.shape[1])),
            )
            for i in range(ORDER):
                np.add.at(right, self.first + i, rows[:, i, None] * filled)
                for j in range(i + 1):
                    np.add.at(band[i - j], self.first + j, rows[:, i] * rows[:, j])
            band[0] += _RIDGE * band[0].max()
            found: Array = scipy.linalg.solveh_banded(band, right, lower=True)
            result[:, columns] = found
        return result


def differentiate_spline(times: ArrayLike, values: ArrayLike) -> tuple[Array, Array]:
    """First and second derivatives of sampled signals that may have gaps, by natural quintic splines.

    ``times`` (n,), s: strictly increasing.
    ``values`` (n, m): NaN where not known.
    Returns ``first``, ``second`` (n, m), per s and per s2: each run of known samples has a spline of its own,
        so a gap spoils nothing beyond itself. NaN where the signal is NaN and in runs shorter than
        ``MIN_SAMPLES``. Near both ends of a run the accelerations bend towards a vanishing third derivative.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.linspace(0.0, 1.0, 101)
    >>> first, second = differentiate_spline(t, np.sin(t)[:, None])
    >>> bool(np.allclose(second[20:-20, 0], -np.sin(t)[20:-20], atol=1e-8))
    True
    """
    t, x = np.asarray(times, dtype=float), np.asarray(values, dtype=float)
    first, second = np.full(x.shape, np.nan), np.full(x.shape, np.nan)
    patterns, member = np.unique(np.isfinite(x), axis=1, return_inverse=True)
    for k in range(patterns.shape[1]):
        columns = np.flatnonzero(member.ravel() == k)
        ends = [(order, np.zeros(len(columns))) for order in (3, 4)]  # natural (de Boor 2001, ch. V)
        for start, stop in find_runs(patterns[:, k]).tolist():
            if stop - start >= MIN_SAMPLES:
                rows, part = slice(start, stop), np.ix_(np.arange(start, stop), columns)
                spline = scipy.interpolate.make_interp_spline(
                    t[rows], x[part], k=DEGREE, bc_type=(ends, ends)
                )
                first[part], second[part] = spline(t[rows], 1), spline(t[rows], 2)
    return first, second


@dataclass(frozen=True, slots=True, eq=False)
class Unknowns:
    """Coefficients (n_coefficients, m) and shared numbers (k,), or a change of them."""

    coefficients: Array
    shared: Array


@dataclass(slots=True, eq=False, kw_only=True)
class Quadratic:
    """``value + 2 gradient . d + d . matrix d`` of coefficients and shared numbers moved by d."""

    value: float
    gradient: Array  # (n_coefficients, m)
    # (ORDER, n_coefficients, m, m): ``blocks[lag, a]`` stands at block row ``a + lag``, block column ``a``
    blocks: Array
    shared_gradient: Array  # (k,)
    border: Array  # (n_coefficients, m, k)
    corner: Array  # (k, k)

    @classmethod
    def empty(cls, count: int, m: int, k: int) -> Quadratic:
        """Nothing said yet of (count, m) coefficients and k shared numbers."""
        return cls(
            value=0.0,
            gradient=np.zeros((count, m)),
            blocks=np.zeros((ORDER, count, m, m)),
            shared_gradient=np.zeros(k),
            border=np.zeros((count, m, k)),
            corner=np.zeros((k, k)),
        )

    def at(self, step: Unknowns) -> float:
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


def add_to_blocks(basis: SplineBasis, rows: slice, blocks: Array, curvature: Array) -> None:
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


def add_to_rows(basis: SplineBasis, rows: slice, total: Array, values: Array) -> None:
    """Add what frames say, (n_rows, 3, ...), to rows of the coefficients (n_coefficients, ...), in place."""
    first, weights = basis.first[rows], basis.weights[rows]
    n, width = len(first), int(np.prod(values.shape[2:]))
    local = np.swapaxes(weights, 1, 2) @ values.reshape(n, 3, width)  # (n, ORDER, width)
    starts = np.flatnonzero(np.diff(first, prepend=first[0] - 1))
    summed = np.add.reduceat(local, starts, axis=0).reshape(len(starts), ORDER, *values.shape[2:])
    for i in range(ORDER):
        total[first[starts] + i] += summed[:, i]


def pack_band(blocks: Array) -> Array:
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
    factor = scipy.linalg.cholesky_banded(band, lower=True, check_finite=False)
    return np.asarray(scipy.linalg.cho_solve_banded((factor, True), right, check_finite=False))
