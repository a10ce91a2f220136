"""What every recording has besides: camera noise, small motion of the skin, plates' noise, gaps."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from tests.blind.body import Array
from tests.blind.forces import Plates
from tests.blind.motions.motion import wander


@dataclass(frozen=True)
class Clutter:
    """How much of what.

    Parameters
    ----------
    white_m : float
        SD of independent camera noise: 0.2 mm at rest, 0.5 mm in motion (Vicon systems; chosen between).
    slow_m, slow_s : float
        SD and correlation time of the autocorrelated part (chosen: as large as the white part, 0.1 s:
        occlusion and calibration errors change as a marker crosses the volume).
    skin_m : float
        RMS of each marker's own slow motion in ground, 0.3 to 1.5 Hz, independent of every coordinate,
        different in each trial: artefact-like, but below every effect of the bank and the image of none.
        Measured artefacts are 5 to 30 mm (Leardini et al. 2005), nearly all of it driven by the joints and so
        no clutter.
    degrees_of_freedom : float
        Of Student's t for the white part; infinite for the normal law.
    force : float
        Factor on the plates' noise.
    gaps : int
        Per trial.
    """

    white_m: float = 0.3e-3
    slow_m: float = 0.3e-3
    slow_s: float = 0.1
    skin_m: float = 0.5e-3
    degrees_of_freedom: float = np.inf
    force: float = 1.0
    gaps: int = 3

    def scaled(self, factor: float) -> Clutter:
        """All noise, but no gaps, by a factor."""
        return replace(
            self,
            white_m=self.white_m * factor,
            slow_m=self.slow_m * factor,
            skin_m=self.skin_m * factor,
            force=self.force * factor,
        )

    def on_markers(self, times: Array, markers: Array, rng: np.random.Generator) -> Array:
        """Positions (n, m, 3) with all of it, gaps as NaN."""
        shape = markers.shape
        noise = self.white_m * _student(rng, shape, self.degrees_of_freedom)
        noise += autocorrelated(rng, shape, self.slow_m, self.slow_s, times[1] - times[0])
        if self.skin_m:
            for k in range(shape[1] * 3):
                noise[:, k // 3, k % 3] += wander(rng, times, self.skin_m, 0.3, 1.5)
        result = markers + noise
        for _ in range(self.gaps):
            start, length = rng.integers(10, shape[0] - 30), rng.integers(3, 15)
            result[start : start + length, rng.integers(shape[1])] = np.nan
        return result

    def on_plates(self, plates: Plates, rng: np.random.Generator) -> Plates:
        """Wrenches with noise.

        Notes
        -----
        Three SD of the white part are the data sheet's .1 % of the load, at least .22 N, and .2 mm of the
        centre of pressure (AMTI as cited by Muller et al. 2017); 1 N and 0.1 N m wander within 0.2 s (chosen:
        drift).
        """
        dt = plates.times[1] - plates.times[0]
        load = np.abs(plates.force[..., 1:2])
        sd = self.force * np.maximum(0.001 * load, 0.22) / 3
        force = plates.force + sd * rng.normal(size=plates.force.shape)
        force += autocorrelated(rng, plates.force.shape, self.force * 1.0, 0.2, dt)
        moment = plates.moment + self.force * 0.2e-3 / 3 * load * rng.normal(size=plates.force.shape)
        moment += autocorrelated(rng, plates.force.shape, self.force * 0.1, 0.2, dt)
        return replace(plates, force=force, moment=moment)


NONE = Clutter(0.0, 0.0, 0.1, 0.0, np.inf, 0.0, 0)
"""Nothing but the effect."""

NULLS: dict[str, Clutter] = {
    "white": Clutter(white_m=0.5e-3, slow_m=0.0, skin_m=0.0),
    "autocorrelated": Clutter(),
    "heavy_tailed": Clutter(white_m=0.5e-3, slow_m=0.0, skin_m=0.0, degrees_of_freedom=3.0),
    "other_scale": Clutter().scaled(3.0),
}
"""Recordings in which nothing is hidden."""


def autocorrelated(
    rng: np.random.Generator, shape: tuple[int, ...], sd: float, time_s: float, dt: float
) -> Array:
    """A first-order autoregressive signal along the first axis with this SD and correlation time."""
    decay = np.exp(-dt / time_s)
    white = rng.normal(size=shape)
    white[1:] *= np.sqrt(1 - decay**2)
    signal: Array = sd * lfilter([1.0], [1.0, -decay], white, axis=0)
    return signal


def _student(rng: np.random.Generator, shape: tuple[int, ...], degrees: float) -> Array:
    """Unit variance."""
    if np.isinf(degrees):
        return rng.normal(size=shape)
    return rng.standard_t(degrees, size=shape) / np.sqrt(degrees / (degrees - 2))
