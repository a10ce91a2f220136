"""The disturbance that explains most, if it does so clearly better than any effect."""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module

from scaling_service.capabilities.discovery import disturbances as package
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.evidence.scoring import (
    ScoredCandidate,
    ScoredCandidates,
    score_candidates,
)
from scaling_service.capabilities.discovery.evidence.settings import DiscoverySettings
from scaling_service.capabilities.discovery.evidence.wrench import OBSERVATIONS
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Contact, FreeMotion, Seen


@dataclass(frozen=True, slots=True)
class Disturbance:
    """A law that the recordings follow and that no entry of the catalogue has."""

    where: tuple[str, ...]
    law: str  # in words and numbers
    expected: float  # as ``Fitted.expected``
    p: float  # of as large a statistic by chance, for this law alone
    held_out: float  # of as consistent a gain by chance on what did not fit it
    seen_in: Seen = "markers"
    flexible: bool = False  # of so many numbers that it follows nearly any course itself
    rms: float = 0.0  # SI, of what the readings alone show; 0 where only a fit tells


_COMPARED = 8
"""Laws of columns that are looked at closely: only the best of them can be clear (chosen)."""

Describe = Callable[[ScoredCandidate], tuple[tuple[str, ...], str]]
"""Where, and in words and numbers."""


@dataclass(frozen=True, slots=True)
class DisturbanceLaw:
    """Sums of columns and how they are described, or a search of its own."""

    candidates: Callable[[Fit], Iterable[Candidate]] | None = None
    describe: Describe | None = None
    search: Callable[[Fit], Iterable[Disturbance]] | None = None


@cache
def _laws() -> tuple[DisturbanceLaw, ...]:
    modules = [import_module(f"{package.__name__}.{i.name}") for i in pkgutil.iter_modules(package.__path__)]
    return tuple(law for module in modules for law in getattr(module, "LAWS", ()))


def find_disturbance(fit: Fit, scored: ScoredCandidates) -> Disturbance | None:
    """The disturbance that explains most of what stands above the noise, if it is clear and no chance."""
    settings = fit.settings
    sure = [law for law in _found(fit) if max(law.p * scored.count, law.held_out) <= settings.level]
    fitting = [item.name for item in fit.tracked if item.role == "fit"]
    rivals = [o for o in scored.best if any(map(o.candidate.holds_in, fitting))]
    above = {o.name: o.above_noise(fit) for o in OBSERVATIONS}
    main = [law for law in sure if law.expected > settings.disturbance_main * above[law.seen_in]]
    clear = [law for law in main if _clear(law, rivals, above[law.seen_in], settings)]
    return max(clear, key=lambda law: law.expected, default=None)


def outdoes(disturbance: Disturbance, without: Fit, fit: Fit) -> bool:
    """Whether a law explains more without some effects than these effects do.

    An effect that resembles a disturbance takes the most of it, and leaves what the same law explains.
    """
    observation = next(o for o in OBSERVATIONS if o.name == disturbance.seen_in)
    taken = observation.squares(without) - observation.squares(fit)
    laws = [law for law in _found(without) if law.seen_in == disturbance.seen_in]
    return any(max(law.p, law.held_out) <= fit.settings.level and law.expected > taken for law in laws)


def _clear(
    law: Disturbance, effects: Sequence[ScoredCandidate], above: float, settings: DiscoverySettings
) -> bool:
    """Whether it explains clearly more than any effect, or leaves little where they leave something.

    What the effects explain is held to their own standard: a motion or force of any course follows every law,
    and so does a law of many numbers.
    """
    rivals = 0.0
    for one in effects:
        if one.candidate.seen_in == law.seen_in:
            any_course = isinstance(one.candidate.change, FreeMotion | Contact) and not law.flexible
            factor = settings.free_course_share if any_course else settings.disturbance_lead
            rivals = max(rivals, factor * one.fitted.expected)
    lead = above - rivals / settings.disturbance_lead
    something, little = settings.effects_leave * above, settings.disturbance_leaves * lead
    return law.expected > rivals or (lead > something and above - law.expected < little)


def _found(fit: Fit) -> Iterator[Disturbance]:
    described: dict[Candidate, Describe] = {}
    for law in _laws():
        if law.search is not None:
            yield from law.search(fit)
        if law.candidates is not None and law.describe is not None:
            described |= dict.fromkeys(law.candidates(fit), law.describe)
    for observation in OBSERVATIONS:
        choice = [c for c in described if observation.shows(c)]
        for one in score_candidates(fit, choice, _COMPARED):
            where, law_in_words = described[one.candidate](one)
            p = one.p_family(1)
            yield Disturbance(where, law_in_words, one.fitted.expected, p, one.held_out.p, observation.name)
