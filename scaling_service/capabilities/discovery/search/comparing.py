"""Candidates against each other, and against recordings that were not used to fit them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import scipy

from scaling_service.capabilities.discovery.evidence.score import Evidence, Stretch
from scaling_service.capabilities.discovery.search.candidates import Candidate
from scaling_service.capabilities.discovery.search.judging import inverse_of
from scaling_service.numerics.multibody.laws import Array

_FEWEST = 3
"""Stretches from which a spread of gains is told (chosen: one degree of freedom more than needed)."""

_KEPT = 4  # chosen: the two halves of what is folded, of motion and of forces


@dataclass(frozen=True, slots=True, eq=False)
class Explained:
    """What a fitted candidate takes off each stretch that it was fitted to.

    Parameters
    ----------
    size : ndarray, shape (k,)
        Of the candidate's columns, SI.
    along : ndarray, shape (n_nuisances,)
        How the nuisances move with it.
    step : ndarray, shape (n_nuisances,)
        How they move without it.
    gains : ndarray, shape (n_stretches,)
        Of the whitened sum of squares.
    """

    size: Array
    along: Array
    step: Array
    gains: Array


def explained(evidence: Evidence, index: int, stretches: Sequence[Stretch]) -> Explained:
    """Fit one candidate to stretches.

    Parameters
    ----------
    evidence : Evidence
        Gathered together.
    index : int
        Of the candidate.
    """
    rows, count = evidence.groups[index], evidence.nuisances
    total, score, inverse = _summed(evidence, tuple(stretches))
    follow, step = inverse @ total[:count, rows], inverse @ score[:count]
    curvature = total[rows, rows] - total[rows, :count] @ follow
    size = inverse_of(curvature, evidence.raw[rows])[0] @ (score[rows] - follow.T @ score[:count])
    along = -follow @ size
    found = Explained(size, along, step, np.zeros(0))
    return replace(found, gains=gains_of(evidence, index, found, stretches))


@lru_cache(_KEPT)
def _summed(evidence: Evidence, stretches: tuple[Stretch, ...]) -> tuple[Array, Array, Array]:
    """Products and scores of all columns over stretches, and the inverse of what the nuisances show there.

    Most candidates are fitted to the same stretches, one after the other.
    """
    count = evidence.nuisances
    total = np.sum([s.own for s in stretches], axis=0)
    inverse = inverse_of(total[:count, :count], evidence.raw[:count])[0]
    return total, np.sum([s.scores for s in stretches], axis=0), inverse


def forget_sums() -> None:
    """Give the memory back that the last evidence takes, once a search is over."""
    _summed.cache_clear()


def gains_of(evidence: Evidence, index: int, found: Explained, stretches: Sequence[Stretch]) -> Array:
    """What a candidate takes off stretches beyond what nuisances by themselves do, (n_stretches,)."""
    count, rows = evidence.nuisances, evidence.groups[index]
    chosen = np.r_[0:count, rows.start : rows.stop]
    change = np.concatenate([found.along, found.size])

    def gain(s: Stretch) -> float:
        own = s.own[np.ix_(chosen, chosen)]
        return float(change @ (2.0 * (s.scores[chosen] - own[:, :count] @ found.step) - own @ change))

    return np.array([gain(s) for s in stretches])


def no_worse(best: Array, other: Array, penalty: float) -> float:
    """How likely chance alone makes the best as much better as it is (Vuong 1989, Econometrica 57:307).

    Parameters
    ----------
    best, other : ndarray, shape (n_stretches,)
        Gains of the two.
    penalty : float
        What the best spends more on chance than the other; not finite where that cannot be told.

    Returns
    -------
    float
        One where stretches are too few to tell.
    """
    if len(best) < _FEWEST or not np.isfinite(penalty):
        return 1.0
    lead = best - other - penalty / len(best)
    spread = float(lead.std(ddof=1))
    if spread == 0.0:
        return 1.0 if lead.mean() <= 0.0 else 0.0
    statistic = float(lead.mean()) / (spread / np.sqrt(len(lead)))
    return float(scipy.stats.t.sf(statistic, len(lead) - 1))


@dataclass(frozen=True, slots=True)
class Unseen:
    """A candidate on stretches that did not fit it.

    Parameters
    ----------
    gain : float
        Share of their whitened sum of squares that it takes off.
    p : float
        Of as consistent a gain by chance.
    folds : bool
        Whether these were blocks of time of the same trial, for want of another one.
    """

    gain: float
    p: float
    folds: bool


def unseen(evidence: Evidence, index: int, candidate: Candidate) -> Unseen:
    """Try a candidate on what did not fit it.

    One that is in trials to fit and in held-out ones is fitted to those and tried on these; any other is
    fitted to every other stretch where it is and tried on those between. Trials to fit in which it is not
    always tell the nuisances from it.
    """
    here = [s for s in evidence.stretches if candidate.holds_in(s.trial)]
    fitting = [s for s in here if s.role == "fit"]
    held = [s for s in here if s.role == "held_out"]
    others = [s for s in evidence.stretches if s.role == "fit" and not candidate.holds_in(s.trial)]
    halves = [(here[0::2], here[1::2]), (here[1::2], here[0::2])]
    rounds = [(fitting, held)] if fitting and held else halves
    gains, square = [], 0.0
    for known, new in rounds:
        found = explained(evidence, index, [*others, *known])
        gains.append(gains_of(evidence, index, found, new))
        square += sum(s.square for s in new)
    every = np.concatenate(gains)
    share = float(every.sum() / square) if square else 0.0
    if len(every) < _FEWEST or every.std() == 0.0:
        return Unseen(share, 1.0, len(rounds) > 1)
    statistic = float(every.mean() / (every.std(ddof=1) / np.sqrt(len(every))))
    return Unseen(share, float(scipy.stats.t.sf(statistic, len(every) - 1)), len(rounds) > 1)
