"""How strict the search is."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class DiscoverySettings:
    """How strict the search is.

    Parameters
    ----------
    level : float
        Family-wise: of naming anything where nothing is.
    stretch_s : float
        Length of the stretches of time that count as independent, s.
    most : int
        Effects to name at most, of markers and of forces each.
    shortlist : int
        Candidates that are compared with each other.
    strangers : int
        Markers at most that are left out because they go their own way.
    """

    level: float = 0.05
    stretch_s: float = 0.5
    most: int = 8
    shortlist: int = 30
    strangers: int = 3
