"""What recordings say about inertial parameters, in as many numbers whatever their length."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.kinetics.inverse_dynamics import InverseDynamics
from scaling_service.core.arrays import Array
from scaling_service.model.body import BodyModel
from scaling_service.model.compile import list_parameter_values
from scaling_service.model.inertia import compile_mechanism
from scaling_service.numerics import wrench

N_COMPONENTS = 6

QUIET_N = 0.07
"""Least error of a force: what a plate cannot resolve. 0.22 N at three standard deviations (AMTI's data
sheet as Muller et al. 2017 cite it)."""

_STEPS = 400  # of a grid over the logarithm of the noise: 2 % apart over three decades


@dataclass(frozen=True, slots=True, eq=False)
class ForceRecording:
    """A motion with its external loads, and which frames to use."""

    dynamics: InverseDynamics  # of the model whose inertia is asked for
    # (n,): frames whose forces are all known (``FootContacts.supported``). All by default; frames without
    # motion or forces are left out anyhow.
    frames: NDArray[np.bool_] | None = None

    @property
    def used(self) -> NDArray[np.bool_]:
        """Which frames count, (n,); TrialUnusable where none does."""
        return self.dynamics.find_used(self.frames)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WrenchEquations:
    """Normal equations of the ground wrench about the root's origin, for each component by itself."""

    trial: str
    frames: int
    curvature: Array  # (6, p, p): sum over frames of the products of the regressor's rows
    # (6, p): sum of row times error, where the error is the measured wrench minus the prior model's
    slope: Array
    squares: Array  # (6,): sum of squared errors
    repeats: Array  # (6,): how many frames say the same thing

    def rms(self, change: Array) -> Array:
        """RMS error of each component (6,), N and N m, after a change (p,) of the parameters."""
        left = self.squares - 2.0 * self.slope @ change + (self.curvature @ change) @ change
        return np.asarray(np.sqrt(np.clip(left, 0.0, None) / self.frames))


def gather_evidence(model: BodyModel, recording: ForceRecording) -> WrenchEquations:
    """Normal equations of one recording, over the frames that have a motion and all their forces."""
    dynamics, used = recording.dynamics, recording.used
    mechanism = compile_mechanism(model)
    prior = mechanism.inertias.parameters().ravel()
    measured = wrench.move_moment(dynamics.external.T, dynamics.root.T).T
    curvature, slope = np.zeros((N_COMPONENTS, prior.size, prior.size)), np.zeros((N_COMPONENTS, prior.size))
    errors = np.full(measured.shape, np.nan)
    for frames, regressor in wrench.compute_regressor_blocks(
        mechanism, dynamics.motion.rates, list_parameter_values(model)
    ):
        kept = used[frames]
        rows = regressor[kept]
        error = measured[frames][kept] - rows @ prior
        errors[np.flatnonzero(kept) + frames.start] = error
        by_component = np.ascontiguousarray(rows.transpose(1, 0, 2))
        curvature += by_component.transpose(0, 2, 1) @ by_component
        slope += np.einsum("cnp,nc->cp", by_component, error)
    repeats = np.array([count_repeats(errors[:, c]) for c in range(N_COMPONENTS)])
    squares = np.nansum(errors**2, axis=0)
    return WrenchEquations(
        trial=dynamics.trial,
        frames=int(used.sum()),
        curvature=curvature,
        slope=slope,
        squares=squares,
        repeats=repeats,
    )


def count_repeats(errors: Array) -> float:
    """How many frames in a row say the same thing: the integrated autocorrelation time, in frames.

    ``errors`` (n,) are NaN where not known. ``1 + 2 sum rho_k`` with pairs of lags summed while they are
    positive (Geyer C. J. (1992) Practical Markov chain Monte Carlo. Stat Sci 7:473-483), about the mean: a
    mean is what masses and their centres explain.
    """
    known = np.isfinite(errors)
    if not known.any():
        return 1.0
    values = np.where(known, errors - errors[known].mean(), 0.0)
    n = len(values)
    spectrum, mask = np.fft.rfft(values, 2 * n), np.fft.rfft(known.astype(float), 2 * n)
    products = np.fft.irfft(np.abs(spectrum) ** 2)[:n]
    counts = np.round(np.fft.irfft(np.abs(mask) ** 2)[:n])
    if products[0] <= 0.0:
        return 1.0
    # Sums, not means, of the products: the shrinking overlap then tapers lags that few frames show.
    rho = products / products[0] * (counts > 0)
    pairs = rho[: 2 * (n // 2)].reshape(-1, 2).sum(axis=1)
    stop = np.flatnonzero(pairs <= 0.0)
    positive = pairs[: stop[0] if len(stop) else len(pairs)]
    return float(np.clip(2.0 * positive.sum() - 1.0, 1.0, n))


def gather(
    evidence: Sequence[WrenchEquations], noise: Array, components: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Information (p, p) and slope (p,) of recordings together, over the components (6,) that count."""
    weights = [components / (noise**2 * e.repeats) for e in evidence]
    information = sum(np.einsum("c,cpq->pq", w, e.curvature) for w, e in zip(weights, evidence, strict=True))
    slope = sum(w @ e.slope for w, e in zip(weights, evidence, strict=True))
    return np.asarray(information), np.asarray(slope)


def estimate_noise(gains: Array, slopes: Array, squares: float, count: float) -> float:
    """The noise that makes the recorded errors most likely, whatever the parameters are.

    ``gains`` (k,) are eigenvalues of the whitened information at a noise of one, ``slopes`` (k,) those at the
    prior along their vectors, ``squares`` the sum of the prior's squared errors, of which ``count`` are
    independent. The result lies between ``QUIET_N`` and the errors of the prior themselves.

    The marginal likelihood of a linear model with a Gaussian prior (MacKay D. J. C. (1992) Bayesian
    interpolation. Neural Comput 4:415-447): a fit that takes up freedom is not mistaken for small errors.
    """
    largest = max(np.sqrt(squares / count), QUIET_N)
    sizes = np.geomspace(QUIET_N, largest, _STEPS)
    ratio = np.clip(gains, 0.0, None) / sizes[:, None] ** 2
    explained = (slopes**2 / sizes[:, None] ** 4 / (1.0 + ratio)).sum(axis=1)
    cost = count * np.log(sizes) + 0.5 * np.log1p(ratio).sum(axis=1) + 0.5 * (squares / sizes**2 - explained)
    return float(sizes[np.argmin(cost)])
