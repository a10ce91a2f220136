"""How the value at a spot varies: not at all, with a coordinate, or as skin that swings."""

from __future__ import annotations

from dataclasses import dataclass

from scaling_service.model.body import Term


@dataclass(frozen=True, slots=True)
class Constant:
    """The same in all frames."""


@dataclass(frozen=True, slots=True)
class Following:
    """In proportion to a coordinate (rad or m)."""

    coordinate: str


@dataclass(frozen=True, slots=True)
class Swing:
    """The skin under a marker as an oscillator that its segment drives, along an axis of the segment (m)."""

    marker: str
    frequency_hz: float
    damping: float
    axis: int


@dataclass(frozen=True, slots=True)
class Standing:
    """The time since the segment with these markers came to stand on the floor, zero off it (s)."""

    markers: tuple[str, ...]


Profile = Constant | Following | Swing | Standing
ALWAYS = Constant()


def term(profile: Constant | Following, gain: float) -> Term:
    """The profile times a gain, as a term of a law."""
    return Term(gain, coordinate=profile.coordinate if isinstance(profile, Following) else None)
