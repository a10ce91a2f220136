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


def shifts(
    spots: Callable[[int], Sequence[Spot]],
    *,
    suffix: str = "_mm",
    unit: float = MM,
    profile: Profile = ALWAYS,
    axes: Sequence[int] = (0, 1, 2),
) -> tuple[Column, ...]:
    """A column for each axis; ``spots`` gives what moves together along one."""
    return tuple(
        Column(f"{LETTERS[k]}{suffix}", unit, tuple(Part(s, profile) for s in spots(k))) for k in axes
    )


def skin(markers: Sequence[str], driver: str) -> tuple[Column, ...]:
    """Markers that move alike in their segment, in proportion to a coordinate."""
    return shifts(
        lambda k: [MarkerSpot(m, k) for m in markers],
        suffix="_mm_per_deg",
        unit=MM_PER_DEG,
        profile=Following(driver),
    )


def glide(segment: str, driver: str) -> tuple[Column, ...]:
    """A segment that shifts in its parent, in proportion to a coordinate."""
    return shifts(
        lambda k: [JointSpot(segment, "start", "translation", k)],
        suffix="_mm_per_deg",
        unit=MM_PER_DEG,
        profile=Following(driver),
    )
