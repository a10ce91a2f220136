"""White noise that went through the reference's own filter, as fast as a matrix product allows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.signals.filters import butterworth

NEGLIGIBLE = 1e-6
"""Share of the impulse response's peak that is left out (chosen: residuals are compared to 1e-3)."""

_PERIODS = 20  # of the cutoff: the response has long died away


@dataclass(frozen=True, eq=False)
class LowPass:
    """The zero-phase Butterworth filter of inverse dynamics, as a band matrix.

    Away from both ends every output is the same weighted sum of its neighbours; near the ends the weights
    are those of the filter with its reflections. Long signals are filtered block by block with three small
    matrices.

    Parameters
    ----------
    rate_hz, cutoff_hz : float
    order : int
        See ``butterworth``.

    Examples
    --------
    >>> import numpy as np
    >>> signal = np.random.default_rng(0).normal(size=(2, 3000))
    >>> slow = butterworth(signal.T, rate_hz=100.0, cutoff_hz=5.0).values.T
    >>> bool(np.allclose(LowPass(100.0, 5.0, 4).apply(signal), slow, rtol=0, atol=1e-5))
    True
    """

    rate_hz: float
    cutoff_hz: float
    order: int

    @cached_property
    def response(self) -> Array:
        """The impulse response from its middle on, until it is negligible."""
        reach = int(np.ceil(_PERIODS * self.rate_hz / self.cutoff_hz))
        impulse = np.zeros(2 * reach + 1)
        impulse[reach] = 1.0
        half = self._filtered(impulse[:, None])[reach:, 0]
        last = int(np.flatnonzero(np.abs(half) > NEGLIGIBLE * half[0])[-1])
        return half[: last + 1]

    def autocovariance(self, lags: int) -> Array:
        """Of filtered white noise of unit variance, at lags 0 to ``lags``."""
        both = np.concatenate([self.response[:0:-1], self.response])
        padded = np.concatenate([both, np.zeros(lags)])
        return np.array([both @ padded[lag : lag + len(both)] for lag in range(lags + 1)])

    def apply(self, noise: Array) -> Array:
        """Filter along the last axis.

        Parameters
        ----------
        noise : ndarray, shape (m, n), finite
        """
        n, half = noise.shape[1], len(self.response)
        if n < 6 * half:
            return np.ascontiguousarray(self._filtered(noise.T).T)
        result = np.empty(noise.shape)
        first, middle, last = self._blocks
        for start in range(2 * half, n - 2 * half, 2 * half):
            at = min(start, n - 3 * half)
            np.matmul(noise[:, at - half : at + 3 * half], middle, out=result[:, at : at + 2 * half])
        np.matmul(noise[:, : 4 * half], first, out=result[:, : 2 * half])
        np.matmul(noise[:, n - 4 * half :], last, out=result[:, n - 2 * half :])
        return result

    @cached_property
    def _blocks(self) -> tuple[Array, Array, Array]:
        """Transposed weights of the first, an inner and the last block of outputs."""
        half = len(self.response)
        weights = self._filtered(np.eye(6 * half)).T
        first, middle, last = (
            weights[: 4 * half, : 2 * half],
            weights[half : 5 * half, 2 * half : 4 * half],
            weights[2 * half :, 4 * half :],
        )
        return np.ascontiguousarray(first), np.ascontiguousarray(middle), np.ascontiguousarray(last)

    def _filtered(self, columns: Array) -> Array:
        return butterworth(columns, rate_hz=self.rate_hz, cutoff_hz=self.cutoff_hz, order=self.order).values
