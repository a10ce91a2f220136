"""B-splines of signals: values, velocities and accelerations that are exact derivatives of each other."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline, make_interp_spline
from scipy.linalg import solveh_banded

from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.signals.filters import runs

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
                    spline = BSpline(self.knots, one, DEGREE)
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
            result[:, columns] = self._fit(filled, patterns[:, k].astype(float))
        return result

    def _fit(self, samples: Array, seen: Array) -> Array:
        """Banded least squares; ``seen`` is 1 where a sample counts."""
        rows = self.weights[:, 0] * seen[:, None]
        band, right = (
            np.zeros((ORDER, self.n_coefficients)),
            np.zeros((self.n_coefficients, samples.shape[1])),
        )
        for i in range(ORDER):
            np.add.at(right, self.first + i, rows[:, i, None] * samples)
            for j in range(i + 1):
                np.add.at(band[i - j], self.first + j, rows[:, i] * rows[:, j])
        band[0] += _RIDGE * band[0].max()
        found: Array = solveh_banded(band, right, lower=True)
        return found


def spline_rates(times: ArrayLike, values: ArrayLike) -> tuple[Array, Array]:
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
    >>> first, second = spline_rates(t, np.sin(t)[:, None])
    >>> bool(np.allclose(second[20:-20, 0], -np.sin(t)[20:-20], atol=1e-8))
    True
    """
    t, x = np.asarray(times, dtype=float), np.asarray(values, dtype=float)
    first, second = np.full(x.shape, np.nan), np.full(x.shape, np.nan)
    patterns, member = np.unique(np.isfinite(x), axis=1, return_inverse=True)
    for k in range(patterns.shape[1]):
        columns = np.flatnonzero(member.ravel() == k)
        ends = [(order, np.zeros(len(columns))) for order in (3, 4)]  # natural (de Boor 2001, ch. V)
        for start, stop in runs(patterns[:, k]).tolist():
            if stop - start >= MIN_SAMPLES:
                rows, part = slice(start, stop), np.ix_(np.arange(start, stop), columns)
                spline = make_interp_spline(t[rows], x[part], k=DEGREE, bc_type=(ends, ends))
                first[part], second[part] = spline(t[rows], 1), spline(t[rows], 2)
    return first, second
