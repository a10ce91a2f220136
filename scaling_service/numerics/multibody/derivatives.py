"""Velocities and accelerations of sampled signals: exact derivatives of one spline through the samples."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline
from scipy.sparse import csc_array, csr_array, diags_array, vstack
from scipy.sparse.linalg import splu

from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.signals.filters import runs

DEGREE = 5
"""Quintic: accelerations are then smooth cubics. OpenSim differentiates coordinates by such splines too."""

MIN_SAMPLES = DEGREE + 1
"""A spline of that degree needs as many points."""

_END_ORDERS = (3, 4)
"""Derivatives that vanish at both ends: the natural quintic spline (de Boor 2001, ch. V)."""


@dataclass(frozen=True, eq=False)
class SplineRates:
    """Natural quintic splines through samples at given times, set up once for many signals.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.linspace(0.0, 1.0, 101)
    >>> first, second = SplineRates(t).rates(np.sin(t)[:, None])
    >>> bool(np.allclose(second[20:-20, 0], -np.sin(t)[20:-20], atol=1e-8))
    True

    Near both ends the accelerations bend towards a vanishing third derivative.
    """

    times: Array  # (n,), s: strictly increasing, at least ``MIN_SAMPLES``

    def __post_init__(self) -> None:
        if len(self.times) < MIN_SAMPLES or not (np.diff(self.times) > 0).all():
            raise ValueError(f"a spline needs {MIN_SAMPLES} increasing times")

    @cached_property
    def _knots(self) -> Array:
        ends = np.repeat(self.times[[0, -1]], DEGREE)
        return np.concatenate([ends[:DEGREE], self.times, ends[DEGREE:]])

    @cached_property
    def _solver(self) -> object:
        size = len(self._knots) - DEGREE - 1
        inner = BSpline.design_matrix(self.times, self._knots, DEGREE)
        near = np.zeros((size, 2 * MIN_SAMPLES))
        near[:MIN_SAMPLES, :MIN_SAMPLES] = near[-MIN_SAMPLES:, MIN_SAMPLES:] = np.eye(MIN_SAMPLES)
        basis = BSpline(self._knots, near, DEGREE)
        rows = np.zeros((2 * len(_END_ORDERS), size))
        for k, order in enumerate(_END_ORDERS):
            rows[2 * k, :MIN_SAMPLES] = basis(self.times[0], nu=order)[:MIN_SAMPLES]
            rows[2 * k + 1, -MIN_SAMPLES:] = basis(self.times[-1], nu=order)[MIN_SAMPLES:]
        rows /= np.abs(rows).max(axis=1, keepdims=True)
        return splu(csc_array(vstack([csr_array(inner), csr_array(rows)])))

    @cached_property
    def _derivatives(self) -> tuple[csr_array, csr_array]:
        """Matrices from coefficients to first and second derivatives at the times."""
        result, chain, knots = [], None, self._knots
        for degree in (DEGREE, DEGREE - 1):
            width = degree / (knots[degree + 1 : -1] - knots[1 : -degree - 1])
            n = len(width)
            step = diags_array([-width, width], offsets=[0, 1], shape=(n, n + 1))
            chain = step if chain is None else step @ chain
            knots = knots[1:-1]
            result.append(csr_array(BSpline.design_matrix(self.times, knots, degree - 1) @ chain))
        return result[0], result[1]

    def rates(self, values: ArrayLike) -> tuple[Array, Array]:
        """First and second derivatives at the sample times.

        ``values``: (n, m), finite.
        Returns ``first``, ``second``: (n, m), per s and per s2.
        """
        samples = np.asarray(values, dtype=float)
        padded = np.concatenate([samples, np.zeros((2 * len(_END_ORDERS), samples.shape[1]))])
        coefficients = self._solver.solve(padded)  # type: ignore[attr-defined]  # scipy gives no types
        first, second = self._derivatives
        return np.asarray(first @ coefficients), np.asarray(second @ coefficients)


def spline_rates(times: ArrayLike, values: ArrayLike) -> tuple[Array, Array]:
    """First and second derivatives of signals that may have gaps.

    ``times`` (n,), s: strictly increasing.
    ``values`` (n, m): NaN where not known.
    Returns ``first``, ``second`` (n, m), per s and per s2: each run of known samples has a spline of its own,
        so a gap spoils nothing beyond itself. NaN where the signal is NaN and in runs shorter than
        ``MIN_SAMPLES``.
    """
    t, x = np.asarray(times, dtype=float), np.asarray(values, dtype=float)
    first, second = np.full(x.shape, np.nan), np.full(x.shape, np.nan)
    patterns, member = np.unique(np.isfinite(x), axis=1, return_inverse=True)
    for k in range(patterns.shape[1]):
        columns = np.flatnonzero(member.ravel() == k)
        for start, stop in runs(patterns[:, k]).tolist():
            if stop - start >= MIN_SAMPLES:
                part = np.ix_(np.arange(start, stop), columns)
                first[part], second[part] = SplineRates(t[start:stop]).rates(x[part])
    return first, second
