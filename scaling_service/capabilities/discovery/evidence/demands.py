"""What a motion demands of the ground for every inertial number, whatever the masses are."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from functools import cached_property, lru_cache
from threading import Lock

import numpy as np

from scaling_service.capabilities.dynamics.inverse_dynamics import RatedMotion, rated_motion
from scaling_service.model.body import BodyModel
from scaling_service.model.compile import parameter_values
from scaling_service.model.inertia import inertias_of, mechanism_of
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.mechanism import Mechanism
from scaling_service.numerics.multibody.tree import forward
from scaling_service.numerics.wrench.regressor import regressor_blocks

_BUDGET = 3e8  # bytes; chosen: three trials of a full body for some 15 s, and four draws of their noise each


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
        return _remembered(self)

    def wrench(self, model: BodyModel) -> Array:
        """What the motion needs with the masses of a model, (n, 6), moment about the ground origin."""
        return np.asarray(self.per_number @ inertias_of(model).parameters().ravel())

    @property
    def mechanism(self) -> Mechanism:
        """The model, compiled: once for a motion and all draws of its noise."""
        return _compiled(self.model)


def _per_number(demands: Demands) -> Array:
    p = parameter_values(demands.model)
    found = regressor_blocks(demands.mechanism, demands.rated.rates, p, gravity=demands.gravity)
    made = np.concatenate([block.ground for block in found])
    made[:, 3:] += np.cross(demands.root[:, :, None], made[:, :3], axis=1)
    return made


_compiled = lru_cache(8)(mechanism_of)  # chosen: bodies of as many recordings, if each has its own

_known: OrderedDict[Demands, Array] = OrderedDict()
_one_at_a_time = Lock()


def _remembered(demands: Demands) -> Array:
    """What was asked for lately is kept, as far as it fits: the search asks for it again and again."""
    found = _known.get(demands)
    made = _per_number(demands) if found is None else found
    with _one_at_a_time:
        _known[demands] = made
        _known.move_to_end(demands)
        while sum(array.nbytes for array in _known.values()) > _BUDGET:
            _known.popitem(last=False)
    return made


def forget() -> None:
    """Give the memory back that :attr:`Demands.per_number` keeps, once a search is over."""
    with _one_at_a_time:
        _known.clear()
