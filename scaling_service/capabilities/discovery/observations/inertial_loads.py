"""What a motion needs of the ground for every inertial number, whatever the masses are."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from scaling_service.capabilities.kinetics.inverse_dynamics import RatedMotion, differentiate_motion
from scaling_service.core.arrays import Array
from scaling_service.model.body import BodyModel
from scaling_service.model.compile import list_parameter_values
from scaling_service.model.inertia import compile_mechanism
from scaling_service.numerics.multibody.motion import Mechanism
from scaling_service.numerics.multibody.tree import pose_links
from scaling_service.numerics.wrench import compute_regressor_blocks


@dataclass(frozen=True, eq=False, kw_only=True)
class InertialLoads:
    """A motion (model with mass, times, coordinates) under a gravity; the masses count for nothing here."""

    model: BodyModel
    times: Array
    q: Array
    gravity: Array  # (3,), m/s2
    cutoff_hz: float  # of the light filter of coordinates

    @cached_property
    def rated(self) -> RatedMotion:
        """The motion with its rates, filtered."""
        return differentiate_motion(self.model, self.times, self.q, cutoff_hz=self.cutoff_hz)

    @cached_property
    def root(self) -> Array:
        """The trunk's origin, (n, 3), m."""
        poses = pose_links(self.mechanism.tree, self.rated.rates.q, list_parameter_values(self.model))
        return np.ascontiguousarray(poses.origins[0].T)

    @cached_property
    def per_number(self) -> Array:
        """Wrench about the ground origin per inertial number of each segment, (n, 6, 10 n_segments)."""
        p = list_parameter_values(self.model)
        found = compute_regressor_blocks(self.mechanism, self.rated.rates, p, gravity=self.gravity)
        made = np.concatenate([block.ground for block in found])
        made[:, 3:] += np.cross(self.root[:, :, None], made[:, :3], axis=1)
        return made

    @property
    def mechanism(self) -> Mechanism:
        """The model, compiled."""
        return _compiled(self.model)


_compiled = lru_cache(8)(compile_mechanism)  # chosen: bodies of as many recordings, if each has its own
