"""How the value at a spot varies: not at all, or with a coordinate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scaling_service.capabilities.discovery.observations.tracked import MotionFit
from scaling_service.core.arrays import Array
from scaling_service.model.body import Law, Term


@dataclass(frozen=True, slots=True)
class Following:
    """In proportion to a coordinate (rad or m)."""

    coordinate: str


Profile = Following | None
"""None: the same in all frames."""


def make_law(profile: Profile, gain: float) -> Law:
    """The profile times a gain."""
    return Law((Term(gain, coordinate=None if profile is None else profile.coordinate),))


def evaluate_profiles(profiles: Sequence[Profile], item: MotionFit) -> Array:
    """Profiles in every frame of a recording, (n_profiles, n_frames)."""
    names, still = item.task.model.coordinate_names, np.ones(len(item.q))
    return np.array([still if p is None else item.q[:, names.index(p.coordinate)] for p in profiles])
