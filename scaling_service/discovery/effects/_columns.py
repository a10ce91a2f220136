"""Columns that several effects share."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from scaling_service.discovery.candidates import Column, Part
from scaling_service.discovery.profiles import ALWAYS, Following, Profile
from scaling_service.discovery.spots import LETTERS, JointSpot, MarkerSpot, Spot

MM = 1e3
DEG = 180.0 / math.pi
MM_PER_DEG = MM / DEG

MOST_MM_PER_DEG = 3.0
"""Chosen: skin over the thigh moves by up to some 40 mm over 60 degrees of knee flexion (Peters et al. 2010,
Gait Posture 31:1)."""


def shifts(
    spots: Callable[[int], Sequence[Spot]],
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
        lambda k: [MarkerSpot(m, k) for m in markers],
        suffix="_mm_per_deg",
        unit=MM_PER_DEG,
        profile=Following(driver),
        most=MOST_MM_PER_DEG,
    )


def glide(segment: str, driver: str) -> tuple[Column, ...]:
    """A segment that shifts in its parent, in proportion to a coordinate."""
    return shifts(
        lambda k: [JointSpot(segment, "start", "translation", k)],
        suffix="_mm_per_deg",
        unit=MM_PER_DEG,
        profile=Following(driver),
        most=MOST_MM_PER_DEG,
    )
