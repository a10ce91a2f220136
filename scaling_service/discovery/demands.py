"""What a motion demands of the ground for every inertial number, whatever the masses are."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from scaling_service.estimation.inverse_dynamics import RatedMotion, rated_motion
from scaling_service.kernels.laws import Array
from scaling_service.kernels.mechanism import N_PARAMETERS, Mechanism
from scaling_service.kernels.regressor import regressor_blocks
from scaling_service.kernels.tree import forward
from scaling_service.models.body import BodyModel
from scaling_service.models.compile import parameter_values
from scaling_service.models.massive import inertias_of, mechanism_of

_REMEMBERED = 16  # chosen: three trials and four draws of their noise each
_LARGEST = 40_000  # segments times frames; chosen: 20 MB each, a full body for some 15 s


@dataclass(frozen=True, eq=False)
class Demands:
    """A motion under a gravity.

    Parameters
    ----------
    model : BodyModel
        With mass; its masses count for nothing here.
    times : ndarray, shape (n,), s
    q : ndarray, shape (n, n_coordinates), rad or m
    gravity : ndarray, shape (3,), m/s2
    cutoff_hz : float
        Of the light filter of coordinates.
    """

    model: BodyModel
    times: Array
    q: Array
    gravity: Array
    cutoff_hz: float

    @cached_property
    def rated(self) -> RatedMotion:
        """The motion with its rates, filtered."""
        return rated_motion(self.model, self.times, self.q, cutoff_hz=self.cutoff_hz)

    @cached_property
    def root(self) -> Array:
        """The trunk's origin, (n, 3), m."""
        poses = forward(self.mechanism.tree, self.rated.rates.q, parameter_values(self.model))
        return np.ascontiguousarray(poses.origins[0].T)

    @property
    def per_number(self) -> Array:
        """Wrench about the ground origin per inertial number of each segment, (n, 6, 10 n_segments)."""
        small = len(self.times) * len(self.model.segments) <= _LARGEST
        return _remembered(self) if small else _per_number(self)

    def of_segment(self, k: int) -> Array:
        """The same of one segment, (n, 6, 10)."""
        return self.per_number[:, :, N_PARAMETERS * k : N_PARAMETERS * (k + 1)]

    def wrench(self, model: BodyModel) -> Array:
        """What the motion needs with the masses of a model, (n, 6), moment about the ground origin."""
        return np.asarray(self.per_number @ inertias_of(model).parameters().ravel())

    @cached_property
    def mechanism(self) -> Mechanism:
        """The model, compiled."""
        return mechanism_of(self.model)


def _per_number(demands: Demands) -> Array:
    p = parameter_values(demands.model)
    found = regressor_blocks(demands.mechanism, demands.rated.rates, p, gravity=demands.gravity)
    made = np.concatenate([block.ground for block in found])
    made[:, 3:] += np.cross(demands.root[:, :, None], made[:, :3], axis=1)
    return made


_remembered = lru_cache(_REMEMBERED)(_per_number)


def forget() -> None:
    """Give the memory back that :attr:`Demands.per_number` keeps, once a search is over."""
    _remembered.cache_clear()
