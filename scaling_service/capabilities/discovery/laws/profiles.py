"""How the value at a spot varies: not at all, or with a coordinate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scaling_service.capabilities.discovery.observations.tracked import MotionFit
from scaling_service.core.arrays import Array
from scaling_service.model.body import Term


@dataclass(frozen=True, slots=True)
class Constant:
    """The same in all frames."""

    def values(self, item: MotionFit) -> Array:
        """In every frame, (n,)."""
        return np.ones(len(item.q))

    def term(self, gain: float) -> Term:
        """The profile times a gain, as a term of a law."""
        return Term(gain)


@dataclass(frozen=True, slots=True)
class Following:
    """In proportion to a coordinate (rad or m)."""

    coordinate: str

    def values(self, item: MotionFit) -> Array:
        """In every frame, (n,)."""
        return np.asarray(item.q[:, item.task.model.coordinate_names.index(self.coordinate)])

    def term(self, gain: float) -> Term:
        """The profile times a gain, as a term of a law."""
        return Term(gain, coordinate=self.coordinate)


Profile = Constant | Following
ALWAYS = Constant()


def evaluate_profiles(profiles: Sequence[Profile], item: MotionFit) -> Array:
    """Profiles in every frame of a recording, (n_profiles, n_frames)."""
    return np.array([profile.values(item) for profile in profiles])
