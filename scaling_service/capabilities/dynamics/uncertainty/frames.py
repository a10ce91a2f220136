"""Frames worth calibrating inertial parameters with: small uncertainty, good excitation.

Muller et al. 2017 (sec. 3.3) propose to select sequences of either kind, and to combine both. Here a window
of frames is worth the information that it adds about the inertial parameters, its frames weighted by the
inverse covariance of their residual wrench; windows are taken one by one, the best first (greedy
D-optimality).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.dynamics.uncertainty.markers import MarkerUncertainty
from scaling_service.capabilities.dynamics.uncertainty.reference import Recording, Reference
from scaling_service.core.errors import InputError
from scaling_service.model.inertia import inertias_of, mechanism_of
from scaling_service.numerics.multibody.derivatives import spline_rates
from scaling_service.numerics.multibody.law_rates import Motion as Rates
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.mechanism import N_PARAMETERS
from scaling_service.numerics.wrench.regressor import regressor_blocks

MASS_SHARE, PLACE_M, TENSOR_SHARE = 0.1, 0.02, 0.2
"""How far parameters of a table may be off (standard deviations; chosen: regressions miss a segment's mass by
about 10 % and its centre of mass by 1 to 3 cm, Dumas et al. 2007 and the tables among each other)."""

INDEPENDENT = 2.0
"""Samples per period of the cutoff that are independent after the filter (Nyquist)."""


@dataclass(frozen=True, slots=True)
class Window:
    """A piece of a recording.

    Parameters
    ----------
    start, stop : int
        Frames.
    gain : float
        Information that it adds to the windows before it, nats.
    uncertainty : float
        Mean standard deviation of the residual force over body weight, the three directions' mean.
    """

    start: int
    stop: int
    gain: float
    uncertainty: float


@dataclass(frozen=True, slots=True, eq=False)
class FrameChoice:
    """Windows in the order in which they are worth taking.

    Parameters
    ----------
    windows : tuple of Window
    total : float
        Information of the whole recording, nats.
    frames : ndarray of bool, shape (n,)
        Those of the chosen windows that are used.
    """

    windows: tuple[Window, ...]
    total: float
    frames: NDArray[np.bool_]

    @property
    def share(self) -> float:
        """Information of the chosen windows over that of all frames."""
        return sum(w.gain for w in self.windows) / self.total


def choose_frames(
    recording: Recording, uncertainty: MarkerUncertainty, *, window_s: float = 1.0, count: int = 10
) -> FrameChoice:
    """The windows that tell most of the inertial parameters, given how uncertain each frame is.

    Parameters
    ----------
    recording : Recording
    uncertainty : MarkerUncertainty
        Of this recording.
    window_s : float
    count : int
        How many windows to take, or all that there are.

    Raises
    ------
    InputError
        The window is shorter than one independent sample, or no window is asked for.
    """
    if count < 1 or window_s * recording.cutoff_hz * INDEPENDENT < 1.0:
        raise InputError(
            f"{count} windows of {window_s:g} s cannot be chosen",
            field="window_s",
            remedy="Take one window at least, of 1 s",
        )
    reference = Reference.of(recording, "all")
    length = round(window_s / reference.step_s)
    thin = max(1, round(reference.low_pass.rate_hz / (INDEPENDENT * recording.cutoff_hz)))
    picked = np.arange(0, len(uncertainty.frames), thin)
    place = uncertainty.frames[picked] // length
    pieces = _information(recording, reference, uncertainty, picked, place)
    order, gains = _greedy(list(pieces.values()), min(count, len(pieces)))
    numbers = np.array(list(pieces))[order]
    weight = reference.scale[0]
    windows, frames = [], np.zeros(reference.n_frames, dtype=bool)
    for number, gain in zip(numbers.tolist(), gains, strict=True):
        start, stop = number * length, min((number + 1) * length, reference.n_frames)
        frames[start:stop] = reference.used[start:stop]
        inside = (uncertainty.frames >= start) & (uncertainty.frames < stop)
        windows.append(Window(start, stop, gain, float(uncertainty.sd[inside, :3].mean() / weight)))
    whole = np.eye(len(next(iter(pieces.values())))) + sum(pieces.values())
    return FrameChoice(tuple(windows), float(np.linalg.slogdet(whole)[1]), frames)


def _information(
    recording: Recording,
    reference: Reference,
    uncertainty: MarkerUncertainty,
    picked: NDArray[np.intp],
    place: NDArray[np.intp],
) -> dict[int, Array]:
    """Window number to its information in units of what a table leaves open."""
    times = recording.motion.times
    q = reference.q.T
    first, second = spline_rates(times, q)
    rows = uncertainty.frames[picked]
    rates = Rates.of_frames(q[rows], first[rows], second[rows])
    mechanism = mechanism_of(recording.model)
    scale = _open(recording)
    regressor = np.concatenate(
        [block.ground for block in regressor_blocks(mechanism, rates, reference.body.p)]
    )
    root = np.linalg.inv(np.linalg.cholesky(uncertainty.covariance[picked]))
    whitened = root @ (regressor * scale)
    pieces = {}
    for number in np.unique(place).tolist():
        own = whitened[place == number].reshape(-1, len(scale))
        pieces[number] = own.T @ own
    return pieces


def _open(recording: Recording) -> Array:
    """Standard deviation of all inertial parameters before the recording, shape (10 n_segments,)."""
    inertias = inertias_of(recording.model)
    result = np.empty((len(inertias.mass), N_PARAMETERS))
    mass = inertias.mass
    result[:, 0] = MASS_SHARE * mass
    result[:, 1:4] = PLACE_M * mass[:, None]
    result[:, 4:] = TENSOR_SHARE * np.einsum("kii->k", inertias.tensor)[:, None] / 3.0
    return result.ravel()


def _greedy(pieces: list[Array], count: int) -> tuple[list[int], list[float]]:
    """Places of the pieces that raise ``log det (1 + sum)`` most, one by one, and by how much."""
    total, value = np.eye(len(pieces[0])), 0.0
    order: list[int] = []
    gains: list[float] = []
    for _ in range(count):
        rest = [k for k in range(len(pieces)) if k not in order]
        values = [float(np.linalg.slogdet(total + pieces[k])[1]) for k in rest]
        best = int(np.argmax(values))
        order.append(rest[best])
        gains.append(values[best] - value)
        total, value = total + pieces[rest[best]], values[best]
    return order, gains
