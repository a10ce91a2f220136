"""The disturbance that explains most, if it does so clearly better than any effect."""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any

from scaling_service.capabilities.discovery import disturbances as package
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.evidence.observation import Observation
from scaling_service.capabilities.discovery.evidence.scoring import (
    ScoredCandidate,
    ScoredCandidates,
    keep_likely,
    score_gathered,
)
from scaling_service.capabilities.discovery.evidence.settings import DiscoverySettings
from scaling_service.capabilities.discovery.evidence.sums import Evidence
from scaling_service.capabilities.discovery.evidence.wrench import OBSERVATIONS
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Contact, FreeMotion, Seen


@dataclass(frozen=True, slots=True, kw_only=True)
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

_ROUGHLY = 0.5
"""Share of what a law must explain that it must take off a few frames (chosen: twice what they stray)."""

Describe = Callable[[ScoredCandidate], tuple[tuple[str, ...], str]]
"""Where, and in words and numbers."""

Judge = Callable[[Fit, Evidence, int, Candidate], Disturbance]
"""What becomes of a candidate, by its index in evidence that was gathered together."""


@dataclass(frozen=True, slots=True)
class DisturbanceLaw:
    """Sums of columns and how they are described, or judged otherwise than effects are; or a search."""

    candidates: Callable[[Fit], Iterable[Candidate]] | None = None
    describe: Describe | None = None
    judge: Judge | None = None
    search: Callable[[Fit], Iterable[Disturbance]] | None = None


@cache
def _list_laws() -> tuple[DisturbanceLaw, ...]:
    modules = [import_module(f"{package.__name__}.{i.name}") for i in pkgutil.iter_modules(package.__path__)]
    return tuple(law for module in modules for law in getattr(module, "LAWS", ()))


def find_disturbance(fit: Fit, scored: ScoredCandidates) -> Disturbance | None:
    """The disturbance that explains most of what stands above the noise, if it is clear and no chance."""
    settings = fit.settings
    fitting = [item.name for item in fit.tracked if item.role == "fit"]
    rivals = [o for o in scored.best if any(map(o.candidate.holds_in, fitting))]
    above = {o.name: o.above_noise(fit) for o in OBSERVATIONS}

    def find_needed(seen_in: Seen, flexible: bool) -> float:
        effects = [o for o in rivals if o.candidate.seen_in == seen_in]
        return _compute_needed_share(effects, above[seen_in], flexible, settings)

    least = {o.name: find_needed(o.name, flexible=False) for o in OBSERVATIONS}
    sure = [
        law for law in _judge_laws(fit, least) if max(law.p * scored.count, law.held_out) <= settings.level
    ]
    clear = [law for law in sure if law.expected > find_needed(law.seen_in, law.flexible)]
    return max(clear, key=lambda law: law.expected, default=None)


def is_better_than_effects(disturbance: Disturbance, without: Fit, fit: Fit) -> bool:
    """Whether a law explains more without some effects than these effects do.

    An effect that resembles a disturbance takes the most of it, and leaves what the same law explains.
    """
    observation = next(o for o in OBSERVATIONS if o.name == disturbance.seen_in)
    taken = observation.squares(without) - observation.squares(fit)
    laws = [
        law for law in _judge_laws(without, {observation.name: taken}) if law.seen_in == disturbance.seen_in
    ]
    return any(max(law.p, law.held_out) <= fit.settings.level and law.expected > taken for law in laws)


def _compute_needed_share(
    effects: Sequence[ScoredCandidate], above: float, flexible: bool, settings: DiscoverySettings
) -> float:
    """What a law must explain: much, and clearly more than effects do, or nearly all where they leave some.

    What the effects explain is held to their own standard: a motion or force of any course follows every law,
    and so does a law of many numbers.
    """
    rivals = 0.0
    for one in effects:
        any_course = isinstance(one.candidate.change, FreeMotion | Contact) and not flexible
        factor = settings.free_course_share if any_course else settings.disturbance_lead
        rivals = max(rivals, factor * one.fitted.expected)
    lead = above - rivals / settings.disturbance_lead
    all_but_little = above - settings.disturbance_leaves * lead
    clearly = min(rivals, all_but_little) if lead > settings.effects_leave * above else rivals
    return max(settings.disturbance_main * above, clearly)


def _judge_laws(fit: Fit, least: Mapping[Seen, float]) -> Iterator[Disturbance]:
    """Laws that may explain more than so much of an observation; none of those that are not asked for."""
    laws: dict[Candidate, DisturbanceLaw] = {}
    for law in _list_laws():
        if law.search is not None:
            yield from law.search(fit)
        if law.candidates is not None:
            laws |= dict.fromkeys(law.candidates(fit), law)
    for observation in OBSERVATIONS:
        if observation.name in least:
            choice = {c: law for c, law in laws.items() if observation.shows(c)}
            yield from _look_closely(fit, observation, choice, least[observation.name])


def _look_closely(
    fit: Fit, observation: Observation[Any], laws: Mapping[Candidate, DisturbanceLaw], least: float
) -> Iterator[Disturbance]:
    """Those that a few frames do not rule out."""
    if not laws:
        return
    choice = list(laws)
    rough = observation.gather_beside(fit, choice, together=False, rough=True)
    square = sum(block.square for block in rough.blocks if block.role == "fit")
    enough = _ROUGHLY * least * square / max(observation.squares(fit), 1e-300)
    promising = [choice[k] for k, fitted in keep_likely(rough, choice) if fitted.gain > enough]
    plain = [c for c in promising if laws[c].judge is None][:_COMPARED]
    picked = [*plain, *(c for c in promising if laws[c].judge is not None)]
    if not picked:
        return
    evidence = observation.gather_beside(fit, picked, together=True)
    for k, candidate in enumerate(picked):
        judge = laws[candidate].judge
        if judge is not None:
            yield judge(fit, evidence, k, candidate)
    for one in score_gathered(evidence, picked):
        describe = laws[one.candidate].describe
        if describe is not None:
            where, law_in_words = describe(one)
            p = one.p_family(1)
            yield Disturbance(
                where=where,
                law=law_in_words,
                expected=one.fitted.expected,
                p=p,
                held_out=one.held_out.p,
                seen_in=observation.name,
            )
