"""Frequency and damping of what swings, once it is known that something does."""

from __future__ import annotations

from dataclasses import replace

from scaling_service.discovery.catalogue import kinds
from scaling_service.discovery.evidence import gather
from scaling_service.discovery.fitting import Account
from scaling_service.discovery.forces import gather_forces
from scaling_service.discovery.judging import fit_each
from scaling_service.discovery.option import Option
from scaling_service.discovery.scene import Scene

FREQUENCIES_HZ, DAMPINGS = (1.0, 30.0), (0.01, 0.9)
_STEPS = (0.5, 0.25, 0.12, 0.06)
"""Shares by which both are changed, round after round; the last is finer than their own deviation."""


def tuned(option: Option, now: Account, scene: Scene, stretch_s: float) -> Option:
    """The option at the frequency and damping at which it explains most; any other option as it is."""
    start, swinging = option.candidate.swing, kinds()[option.candidate.kind].swinging
    if start is None or swinging is None:
        return option
    pair, best = start, option
    known = [s.candidate for s in now.everything if s.candidate.columns]
    known = [c for c in known if c.of_forces == option.candidate.of_forces]
    for step in _STEPS:
        tried = sorted(
            {
                (
                    _within(pair[0] * (1.0 + step * a), FREQUENCIES_HZ),
                    _within(pair[1] * (1.0 + step * b), DAMPINGS),
                )
                for a in (-1, -0.5, 0, 0.5, 1)
                for b in (-1, -0.5, 0, 0.5, 1)
            }
        )
        choice = [swinging(option.candidate, scene, *each) for each in tried]
        if option.candidate.of_forces:
            found = fit_each(gather_forces(now.weighed, known, choice, stretch_s, together=False), choice)
        else:
            found = fit_each(gather(now.watched, known, choice, stretch_s, together=False), choice)
        k = max(range(len(choice)), key=lambda i: found[i].gain)
        if found[k].gain > best.fitted.gain:
            pair, best = tried[k], replace(option, candidate=choice[k], fitted=found[k])
    return best


def _within(value: float, bounds: tuple[float, float]) -> float:
    return min(max(value, bounds[0]), bounds[1])
