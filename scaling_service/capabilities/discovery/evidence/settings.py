"""How strict the search is."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class DiscoverySettings:
    """How strict the search is.

    Parameters
    ----------
    odds : float
        Natural logarithm of the odds against the ordinary from which an effect is named, its places taken
        into account.
    most : int
        Effects to name at most, of markers and of forces each.
    block_s : float
        Length of the blocks of time that count as independent in intervals, s.
    """

    # 400 to 1: people have tails that the Gaussian of the ordinary does not. In ordinary recordings of five
    # laboratories the likeliest reached 2.4, 2.9, 3.3, 5.5 and, of toes that a model does not bend, 9.5
    odds: float = 6.0
    most: int = 8
    block_s: float = 0.5
    # a coordinate that spreads less drives nothing that could be told from a constant (chosen: 2 degrees)
    moving_rad: float = math.radians(2.0)
    # difference of log odds up to which two effects that look alike are one class (20 to 1), and the cosine
    # between
    # what they explain from which they look alike (chosen: half of one is explained by the other)
    class_odds: float = 3.0
    class_cosine: float = 0.7
    # of their RMS by which places may be worse on unseen recordings with an effect than without (chosen:
    # rounding)
    worse: float = 0.005
    # deviations by which a place stands out of the others, in logarithms of its level, so that it is called
    # unexplained
    unexplained: float = 3.0
    power: float = 0.9  # of naming an effect of the smallest size that is called nameable
    separating: float = 25.0  # deviations squared that a movement must leave between effects to separate them
