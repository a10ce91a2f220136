"""Sizes of a person: a Gaussian distribution of their logarithms, and what measuring some tells of others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from scaling_service.core.errors import InputError
from scaling_service.numerics.multibody.laws import Array


@dataclass(frozen=True, slots=True, eq=False)
class DimensionPrior:
    """Gaussian distribution of the logarithms of a person's dimensions.

    Parameters
    ----------
    names : tuple of str, length n
    mean : ndarray, shape (n,)
        Of log(m); of log(kg) for ``mass``.
    covariance : ndarray, shape (n, n)
        Of the logarithms; positive definite.

    Examples
    --------
    >>> alike = np.array([[0.0025, 0.0024], [0.0024, 0.0025]])
    >>> legs = DimensionPrior(("shank_r", "shank_l"), np.log([0.40, 0.40]), alike)
    >>> known = legs.condition({"shank_r": (0.42, 0.002)})
    >>> f"{legs.sd('shank_l'):.3f} {known.value('shank_l'):.3f} {known.sd('shank_l'):.3f}"
    '0.020 0.419 0.006'
    """

    names: tuple[str, ...]
    mean: Array
    covariance: Array

    def value(self, name: str) -> float:
        """Median of a dimension, m (kg for ``mass``)."""
        return float(np.exp(self.mean[self._index(name)]))

    def sd(self, name: str) -> float:
        """Standard deviation of a dimension to first order, m (kg for ``mass``)."""
        i = self._index(name)
        return self.value(name) * float(np.sqrt(self.covariance[i, i]))

    def interval(self, name: str, sds: float = 1.96) -> tuple[float, float]:
        """The range of so many standard deviations of the logarithm, m (kg for ``mass``)."""
        factor = float(np.exp(sds * np.sqrt(self.covariance[self._index(name), self._index(name)])))
        return self.value(name) / factor, self.value(name) * factor

    def select(self, names: tuple[str, ...]) -> DimensionPrior:
        """The joint distribution of some of the dimensions, in the order given."""
        rows = [self._index(name) for name in names]
        return DimensionPrior(names, self.mean[rows], self.covariance[np.ix_(rows, rows)])

    def condition(self, measured: Mapping[str, tuple[float, float]]) -> DimensionPrior:
        """What is known once some dimensions were measured; exact for Gaussian logarithms.

        Parameters
        ----------
        measured : mapping
            Dimension to (value, standard deviation), m (kg for ``mass``); independent errors.

        Raises
        ------
        InputError
            There is no such dimension, or value or standard deviation is not a positive number.
        """
        return self.weigh(measured)[0]

    def weigh(self, measured: Mapping[str, tuple[float, float]]) -> tuple[DimensionPrior, float]:
        """Condition, and say how well the distribution had foreseen what was measured.

        Returns
        -------
        DimensionPrior
            As :meth:`condition`.
        float
            Logarithm of the probability density of the measured logarithms.
        """
        if not measured:
            return self, 0.0
        for name, pair in measured.items():
            if not all(0.0 < number < np.inf for number in pair):
                raise InputError(
                    f"{pair[0]:g} with standard deviation {pair[1]:g} is no size",
                    field=name,
                    remedy="Give both in m (mass in kg), above zero",
                )
        rows = [self._index(name) for name in measured]
        values, sds = np.array(list(measured.values())).T
        innovation = self.covariance[np.ix_(rows, rows)] + np.diag((sds / values) ** 2)
        surprise = np.log(values) - self.mean[rows]
        gain = np.linalg.solve(innovation, self.covariance[rows]).T
        kept = np.eye(len(self.names))
        kept[:, rows] -= gain
        noise = gain * (sds / values)
        covariance = (
            kept @ self.covariance @ kept.T + noise @ noise.T
        )  # Joseph's form: stays positive definite
        evidence = -0.5 * (
            surprise @ np.linalg.solve(innovation, surprise) + np.linalg.slogdet(2.0 * np.pi * innovation)[1]
        )
        return DimensionPrior(self.names, self.mean + gain @ surprise, covariance), float(evidence)

    def _index(self, name: str) -> int:
        if name not in self.names:
            raise InputError(
                f"there is no dimension '{name}'", field=name, remedy=f"There are {', '.join(self.names)}"
            )
        return self.names.index(name)
