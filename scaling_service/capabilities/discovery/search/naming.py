"""A scored candidate becomes a named effect: tuned, with its equivalence class and what it is worth."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
import scipy

from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.evidence.scoring import ScoredCandidate, ScoredCandidates
from scaling_service.capabilities.discovery.evidence.statistics import Fitted, assess_lead, fit_each
from scaling_service.capabilities.discovery.evidence.sums import Evidence, invert_curvature
from scaling_service.capabilities.discovery.evidence.wrench import choose_observation
from scaling_service.capabilities.discovery.laws.candidates import (
    DAMPINGS,
    FREQUENCIES_HZ,
    Candidate,
    Estimate,
    FreeMotion,
)
from scaling_service.capabilities.discovery.observations.performed import MOVEMENTS
from scaling_service.capabilities.discovery.search.findings import NamedEffect
from scaling_service.numerics.multibody.laws import Array


def name_tuned(scored: ScoredCandidate, fit: Fit, among: ScoredCandidates) -> NamedEffect | None:
    """Named at the frequency that explains most; None where no oscillation is plausible."""
    best = tune(scored, fit)
    return None if best is None else name_effect(best, fit, among)


def name_effect(scored: ScoredCandidate, fit: Fit, among: ScoredCandidates) -> NamedEffect:
    """A candidate as a named effect, with the others among which it was selected."""
    settings, candidate = fit.settings, scored.candidate
    effect = Estimate(candidate, scored.fitted.size)
    equivalents = find_equivalents(scored, among.best, settings.equivalence_level)
    return NamedEffect(
        effect=effect,
        covariance=scored.fitted.spread,
        fitted=scored.fitted,
        p_family=scored.p_family(among.count),
        held_out=scored.held_out,
        smallest=find_smallest_nameable(effect, scored.fitted, settings.level / among.count, settings.power),
        equivalents=equivalents,
        rivals=tuple(o.candidate for o in among.best if _are_comparable(o.candidate, candidate)),
    )


def _are_comparable(other: Candidate, candidate: Candidate) -> bool:
    """Whether both are sums of columns of the same sort."""
    return bool(other.columns and candidate.columns) and other.seen_in == candidate.seen_in


def find_equivalents(
    scored: ScoredCandidate, others: Sequence[ScoredCandidate], level: float
) -> Mapping[Candidate, float]:
    """The candidates that explain what this one does so nearly as well that chance could make the difference.

    Each with how likely chance makes so large a lead, the nearest first; a half where that is not known. A
    motion that may take any course could always stand for one that follows a law, so it does not count.
    """
    if scored.gains is None:
        return dict.fromkeys(scored.equivalents, 0.5)
    own, found = scored.candidate, {}
    for other in others:
        one = other.candidate
        looser = isinstance(one.change, FreeMotion) and own.change is None
        same = (one.trials, one.seen_in) == (own.trials, own.seen_in)
        renamed = (one.kind, one.where, one.driver) != (own.kind, own.where, own.driver)
        if (
            other.gains is not None
            and len(other.gains) == len(scored.gains)
            and same
            and renamed
            and not looser
        ):
            p = assess_lead(scored.gains, other.gains, scored.fitted.by_chance - other.fitted.by_chance)
            if p > level:
                found[one] = p
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def tell_classes(named: Sequence[NamedEffect], fit: Fit) -> list[NamedEffect]:
    """Each with its class once all are known: without what is named itself, and what separates it."""
    taken = {n.key for n in named}
    found = []
    for n in named:
        others = {c: p for c, p in n.equivalents.items() if c.key not in taken}
        movement = find_separating_movement(n.effect, tuple(others), fit)
        found.append(replace(n, equivalents=others, would_separate=movement))
    return found


def find_smallest_nameable(
    effect: Estimate, fitted: Fitted, level: float, power: float
) -> Mapping[str, float]:
    """Sizes of the columns, in proportion as found, from which a share would pass the first gate.

    Parameters
    ----------
    level : float
        P-value that one candidate must reach.
    power : float
        That share.
    """
    k = len(fitted.size)
    spread = np.sqrt(np.diag(fitted.covariance)) if k else np.zeros(0)
    if not k or not np.isfinite(fitted.freedom) or fitted.freedom < 2.0 or not spread.all():
        return {}
    needed = scipy.stats.f.isf(level, k, fitted.freedom)

    def compute_missed(strength: float) -> float:
        return float(scipy.stats.ncf.sf(needed, k, fitted.freedom, strength)) - power

    top = 10.0
    while compute_missed(top) < 0.0 and top < 1e9:
        top *= 4.0
    strength = scipy.optimize.brentq(compute_missed, 1e-9, top) if compute_missed(top) > 0.0 else float("inf")
    found: Array = effect.size
    own = float(found @ np.linalg.pinv(fitted.covariance) @ found)
    share = np.sqrt(strength / own) if own > 0.0 else float("inf")
    return {
        column.name: abs(column.unit * size) * share
        for column, size in zip(effect.candidate.columns, found.tolist(), strict=True)
    }


def find_separating_movement(effect: Estimate, others: Sequence[Candidate], fit: Fit) -> str:
    """The movement in which the nearest of the others leaves most of the effect unexplained, or ``""``."""
    own, settings, observation = effect.candidate, fit.settings, choose_observation(effect.candidate)
    columns = [c for c in others if c.columns and observation.shows(c)][: settings.separating_nearest]
    if not own.columns or not columns or not fit.tracked:
        return ""
    best = (settings.separating_square, "")
    every = [replace(c, trials=()) for c in (own, *columns)]
    for movement in MOVEMENTS:
        item = observation.perform(fit, movement)
        if item is not None:
            shown = observation.gather([item], [], every, settings.separating_block_s, together=True)
            left = _compute_left(effect.size, shown)
            if left > best[0]:
                best = left, movement
    return best[1]


def _compute_left(size: Array, shown: Evidence) -> float:
    """Whitened square of the first candidate, of that size, that the best of the others cannot explain."""
    own, *rest = shown.groups
    total = np.sum([s.own for s in shown.blocks], axis=0)
    signal = float(size @ total[own, own] @ size)
    left = []
    for rows in rest:
        along = total[rows, own] @ size
        inverse = invert_curvature(total[rows, rows], shown.raw[rows])[0]
        left.append(signal - float(along @ inverse @ along))
    return min(left)


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
    best = _search_best(start, scored.candidate, fit, _free)
    if scored.candidate.columns[0].natural is not None:
        natural = _search_best(start, scored.candidate, fit, _compute_natural_gain)
        if _compute_natural_gain(*natural[1:]) > (1.0 - fit.settings.natural_lead) * _free(*best[1:]):
            best = natural
    pair, candidate, fitted = best
    inside = all(low < x < high for x, (low, high) in zip(pair, (FREQUENCIES_HZ, DAMPINGS), strict=True))
    if not inside or not candidate.plausible(fitted.size):
        return None
    return replace(scored, candidate=candidate, fitted=fitted)


def _free(_candidate: Candidate, fitted: Fitted) -> float:
    """What it takes off at the size that fits best."""
    return fitted.gain


def _compute_natural_gain(candidate: Candidate, fitted: Fitted) -> float:
    """What it takes off at its natural size."""
    natural, size = candidate.columns[0].natural, float(fitted.size[0]) if len(fitted.size) else 0.0
    assert natural is not None
    return fitted.gain * (1.0 - ((natural - size) / size) ** 2) if size else 0.0


def _search_best(
    start: Pair, candidate: Candidate, fit: Fit, worth: Callable[[Candidate, Fitted], float]
) -> tuple[Pair, Candidate, Fitted]:
    """A search on grids that grow finer about the best so far."""
    observation, pair = choose_observation(candidate), start
    for step in _STEPS:
        tried = sorted(
            {_vary_pair(pair, step * a, step * b) for a, b in product((-1, -0.5, 0, 0.5, 1), repeat=2)}
        )
        choice = [candidate.at(*each) for each in tried]
        found = fit_each(observation.gather_beside(fit, choice, together=False), choice)
        k = max(range(len(choice)), key=lambda i: worth(choice[i], found[i]))
        pair, best = tried[k], (tried[k], choice[k], found[k])
    return best


def _vary_pair(pair: Pair, a: float, b: float) -> Pair:
    """A pair changed by shares, within what is tried."""
    return _clip(pair[0] * (1.0 + a), FREQUENCIES_HZ), _clip(pair[1] * (1.0 + b), DAMPINGS)


def _clip(value: float, bounds: Pair) -> float:
    return min(max(value, bounds[0]), bounds[1])
