"""An effect that was named, as a frozen value, and the units and words in which places are told."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from scaling_service.capabilities.discovery import words
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Estimate
from scaling_service.capabilities.discovery.observations.wrench import COMPONENTS
from scaling_service.capabilities.discovery.result import Unit
from scaling_service.core.arrays import Array

Observable = Literal["marker", "force", "moment"]
UNITS: Mapping[Observable, tuple[Unit, float]] = {
    "marker": ("mm", 1e3),
    "force": ("N", 1.0),
    "moment": ("N m", 1.0),
}
"""What results are in, and how many of it make one of SI."""


def classify_place(place: str) -> Observable:
    """What kind of place a name is."""
    if place not in COMPONENTS:
        return "marker"
    return "force" if place.startswith("f") else "moment"


def turn_into_probability(odds: float) -> float:
    """Of something, from the natural logarithm of its odds.

    Examples
    --------
    >>> turn_into_probability(0.0), round(turn_into_probability(3.0), 3)
    (0.5, 0.953)
    """
    return 1.0 / (1.0 + math.exp(-odds)) if odds > -500.0 else 0.0


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class NamedEffect:
    """An effect that stands out of what is ordinary."""

    effect: Estimate  # with its size, in the end once everything was estimated together
    covariance: Array  # (k, k): of its size (SI)
    odds: float  # logarithm of the odds that it is there, all its places taken into account
    gain: float  # share of the squares of markers, or of forces, that it took off what did not fit it
    by_blocks: bool = False  # whether nothing was held out, so that it is the share of all
    # column to the size (as in the results) from which it is named nine times in ten
    smallest: Mapping[str, float] = field(default_factory=dict)
    # its class: those that these recordings do not tell from it, with the differences of their log odds
    equivalents: Mapping[Candidate, float] = field(default_factory=dict)
    would_separate: str = ""  # the ordinary movement that would
    # further numbers by the names of the results (``rms_deg``, ``start_s``, ``frequency_hz``)
    details: Mapping[str, float] = field(default_factory=dict)
    # standard deviations of those of them that have one, and of sizes that are estimated together with these
    spreads: Mapping[str, float] = field(default_factory=dict)

    @property
    def candidate(self) -> Candidate:
        """What it is, and where."""
        return self.effect.candidate

    @property
    def carries(self) -> bool:
        """Whether it stands in the headline: what takes nothing off does not."""
        return self.gain >= words.NOTHING

    @property
    def member(self) -> float:
        """Probability that it is this one of its class."""
        return 1.0 / (1.0 + sum(math.exp(min(odds, 0.0)) for odds in self.equivalents.values()))

    @property
    def key(self) -> str:
        """The candidate's."""
        return self.effect.candidate.key
