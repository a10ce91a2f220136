"""Columns that several effects share."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from scaling_service.capabilities.discovery.laws.candidates import Column, Part
from scaling_service.capabilities.discovery.laws.profiles import ALWAYS, Following, Profile
from scaling_service.capabilities.discovery.laws.spots import LETTERS, JointSpot, MarkerSpot, Spot

MM = 1e3
DEG = 180.0 / math.pi
MM_PER_DEG = MM / DEG
MOST_MM_PER_DEG = 3.0
"""Chosen: over 60 degrees of knee flexion this is 180 mm, far more than skin moves."""

Spots = Callable[[int], Sequence[Spot]]
"""What moves together along an axis (0, 1, 2)."""


def of_markers(*markers: str) -> Spots:
    """Markers, along the axes of their segment."""
    return lambda axis: [MarkerSpot(marker, axis) for marker in markers]


def shift_of(segment: str) -> Spots:
    """A segment, along the axes of its parent."""
    return lambda axis: [JointSpot(segment, "start", "translation", axis)]


def turn_of(segment: str) -> Spots:
    """A segment, about the axes before its joint's own turns."""
    return lambda axis: [JointSpot(segment, "before", "rotation", axis)]


def shifts(
    spots: Spots,
    *,
    suffix: str = "_mm",
    unit: float = MM,
    profile: Profile = ALWAYS,
    most: float,
) -> tuple[Column, ...]:
    """A column for each axis, of ``most`` at most; ``spots`` gives what moves together along one."""
    return tuple(
        Column(f"{LETTERS[k]}{suffix}", unit, tuple(Part(s, profile) for s in spots(k)), low=-most, high=most)
        for k in range(3)
    )


def skin(markers: Sequence[str], driver: str) -> tuple[Column, ...]:
    """Markers that move alike in their segment, in proportion to a coordinate."""
    return shifts(
        of_markers(*markers),
        suffix="_mm_per_deg",
        unit=MM_PER_DEG,
        profile=Following(driver),
        most=MOST_MM_PER_DEG,
    )


def glide(segment: str, driver: str) -> tuple[Column, ...]:
    """A segment that shifts in its parent, in proportion to a coordinate."""
    return shifts(
        shift_of(segment),
        suffix="_mm_per_deg",
        unit=MM_PER_DEG,
        profile=Following(driver),
        most=MOST_MM_PER_DEG,
    )
