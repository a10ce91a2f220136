"""Columns that several effects share."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from scaling_service.capabilities.discovery.laws.candidates import Column, Part
from scaling_service.capabilities.discovery.laws.profiles import Following, Profile
from scaling_service.capabilities.discovery.laws.spots import LETTERS, JointSpot, MarkerSpot, Spot

MM = 1e3
DEG = 180.0 / math.pi
MM_PER_DEG = MM / DEG

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


def make_shifts(spots: Spots, *, driver: str | None = None) -> tuple[Column, ...]:
    """A column for each axis: constant, or per degree of a coordinate."""
    if driver is None:
        return _make_along_axes(spots, "_mm", MM, None)
    return _make_along_axes(spots, "_mm_per_deg", MM_PER_DEG, Following(driver))


def make_turns(spots: Spots, *, driver: str) -> tuple[Column, ...]:
    """A column for each axis."""
    return _make_along_axes(spots, "_deg_per_deg", 1.0, Following(driver))


def _make_along_axes(spots: Spots, suffix: str, unit: float, profile: Profile) -> tuple[Column, ...]:
    """``spots`` gives what moves together along an axis."""
    return tuple(
        Column(name=f"{LETTERS[k]}{suffix}", unit=unit, parts=tuple(Part(s, profile) for s in spots(k)))
        for k in range(3)
    )
