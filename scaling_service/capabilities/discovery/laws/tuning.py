"""Frequency and damping of what swings, once it is known that something does."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product

from scaling_service.capabilities.discovery.evidence.fitting import Account
from scaling_service.capabilities.discovery.evidence.forces import gather_forces
from scaling_service.capabilities.discovery.evidence.score import gather
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.laws.swings import DAMPINGS, FREQUENCIES_HZ, swung
from scaling_service.capabilities.discovery.search.candidates import Candidate
from scaling_service.capabilities.discovery.search.catalogue import plausible
from scaling_service.capabilities.discovery.search.judging import Fitted, fit_each
from scaling_service.capabilities.discovery.search.option import Option

_STEPS = (0.5, 0.25, 0.12, 0.06)
"""Shares by which both are changed, round after round; the last is finer than their own deviation."""

_CLEAR = 0.02
"""Share of the gain that a coefficient other than the natural one must add to be believed (chosen)."""

Pair = tuple[float, float]
Fit = Callable[[Sequence[Candidate]], Sequence[Fitted]]


def tuned(option: Option, now: Account, scene: Scene, stretch_s: float) -> Option | None:
    """The option at the frequency and damping at which it explains most; any other option as it is.

    None where that is at the edge of what is tried, or needs an implausible size: then it is no such swing.
    """
    start = option.candidate.swing
    if start is None:
        return option
    of_forces = option.candidate.of_forces
    known = [s.candidate for s in now.everything if s.candidate.columns]
    known = [c for c in known if c.of_forces == of_forces]

    def fit(choice: Sequence[Candidate]) -> Sequence[Fitted]:
        if of_forces:
            return fit_each(gather_forces(now.weighed, known, choice, stretch_s, together=False), choice)
        return fit_each(gather(now.watched, known, choice, stretch_s, together=False), choice)

    def at(pair: Pair) -> Candidate:
        return swung(option.candidate, scene, *pair)

    best = _best(start, at, fit, _free)
    if option.candidate.columns[0].natural is not None:
        natural = _best(start, at, fit, _natural)
        if _natural(*natural[1:]) > (1.0 - _CLEAR) * _free(*best[1:]):
            best = natural
    pair, candidate, fitted = best
    inside = all(low < x < high for x, (low, high) in zip(pair, (FREQUENCIES_HZ, DAMPINGS), strict=True))
    if not inside or not plausible(candidate, fitted.size):
        return None
    return replace(option, candidate=candidate, fitted=fitted)


def _free(_candidate: Candidate, fitted: Fitted) -> float:
    """What it takes off at the size that fits best."""
    return fitted.gain


def _natural(candidate: Candidate, fitted: Fitted) -> float:
    """What it takes off at its natural size."""
    natural, size = candidate.columns[0].natural, float(fitted.size[0]) if len(fitted.size) else 0.0
    assert natural is not None
    return fitted.gain * (1.0 - ((natural - size) / size) ** 2) if size else 0.0


def _best(
    start: Pair,
    at: Callable[[Pair], Candidate],
    fit: Fit,
    worth: Callable[[Candidate, Fitted], float],
) -> tuple[Pair, Candidate, Fitted]:
    """A search on grids that grow finer about the best so far."""
    pair = start
    for step in _STEPS:
        tried = sorted(
            {_beside(pair, step * a, step * b) for a, b in product((-1, -0.5, 0, 0.5, 1), repeat=2)}
        )
        choice = [at(each) for each in tried]
        found = fit(choice)
        k = max(range(len(choice)), key=lambda i: worth(choice[i], found[i]))
        pair, best = tried[k], (tried[k], choice[k], found[k])
    return best


def _beside(pair: Pair, a: float, b: float) -> Pair:
    """A pair changed by shares, within what is tried."""
    return _within(pair[0] * (1.0 + a), FREQUENCIES_HZ), _within(pair[1] * (1.0 + b), DAMPINGS)


def _within(value: float, bounds: Pair) -> float:
    return min(max(value, bounds[0]), bounds[1])
