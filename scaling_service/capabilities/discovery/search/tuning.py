"""Frequency and damping of what oscillates, once it is known that something does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product

from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.evidence.scoring import ScoredCandidate
from scaling_service.capabilities.discovery.evidence.statistics import Fitted, fit_each
from scaling_service.capabilities.discovery.evidence.wrench import observation_of
from scaling_service.capabilities.discovery.laws.candidates import Candidate
from scaling_service.capabilities.discovery.laws.oscillations import DAMPINGS, FREQUENCIES_HZ

_STEPS = (0.5, 0.25, 0.12, 0.06)
"""Shares by which both are changed, round after round; the last is finer than their own deviation."""

Pair = tuple[float, float]


def tune(scored: ScoredCandidate, fit: Fit) -> ScoredCandidate | None:
    """The candidate at the frequency and damping at which it explains most; any other as it is.

    None where that is at the edge of what is tried, or needs an implausible size: then it is no oscillation.
    """
    start = scored.candidate.oscillation
    if start is None:
        return scored
    best = _best(start, scored.candidate, fit, _free)
    if scored.candidate.columns[0].natural is not None:
        natural = _best(start, scored.candidate, fit, _natural)
        if _natural(*natural[1:]) > (1.0 - fit.settings.natural_lead) * _free(*best[1:]):
            best = natural
    pair, candidate, fitted = best
    inside = all(low < x < high for x, (low, high) in zip(pair, (FREQUENCIES_HZ, DAMPINGS), strict=True))
    if not inside or not candidate.plausible(fitted.size):
        return None
    return replace(scored, candidate=candidate, fitted=fitted)


def _free(_candidate: Candidate, fitted: Fitted) -> float:
    """What it takes off at the size that fits best."""
    return fitted.gain


def _natural(candidate: Candidate, fitted: Fitted) -> float:
    """What it takes off at its natural size."""
    natural, size = candidate.columns[0].natural, float(fitted.size[0]) if len(fitted.size) else 0.0
    assert natural is not None
    return fitted.gain * (1.0 - ((natural - size) / size) ** 2) if size else 0.0


def _best(
    start: Pair, candidate: Candidate, fit: Fit, worth: Callable[[Candidate, Fitted], float]
) -> tuple[Pair, Candidate, Fitted]:
    """A search on grids that grow finer about the best so far."""
    observation, pair = observation_of(candidate), start
    for step in _STEPS:
        tried = sorted(
            {_beside(pair, step * a, step * b) for a, b in product((-1, -0.5, 0, 0.5, 1), repeat=2)}
        )
        choice = [candidate.at(*each) for each in tried]
        found = fit_each(observation.gather_beside(fit, choice, together=False), choice)
        k = max(range(len(choice)), key=lambda i: worth(choice[i], found[i]))
        pair, best = tried[k], (tried[k], choice[k], found[k])
    return best


def _beside(pair: Pair, a: float, b: float) -> Pair:
    """A pair changed by shares, within what is tried."""
    return _within(pair[0] * (1.0 + a), FREQUENCIES_HZ), _within(pair[1] * (1.0 + b), DAMPINGS)


def _within(value: float, bounds: Pair) -> float:
    return min(max(value, bounds[0]), bounds[1])
