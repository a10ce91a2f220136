"""Laws that recordings can follow and no entry of the catalogue has: told as unexplained, never corrected.

A lens that bends the volume, a camera that trembles: each looks somewhat like several effects at once, and
these would be named in its stead. So such laws are looked for beside the catalogue, one small file each. A
new one is added by adding a file, with either ``candidates``, sums of columns, and how they are ``told``, or
with ``found``, a search of its own.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module

from scaling_service.capabilities.discovery.evidence.fitting import Account, scene_of
from scaling_service.capabilities.discovery.evidence.watched import Watched
from scaling_service.capabilities.discovery.evidence.weighed import Weighed
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.candidates import Candidate, Contact, FreeMotion
from scaling_service.capabilities.discovery.search.findings import Foreign
from scaling_service.capabilities.discovery.search.option import Option
from scaling_service.capabilities.discovery.search.options import Options, compared
from scaling_service.capabilities.discovery.search.strictness import DiscoverySettings

CLEARLY = 1.15
"""How much more a foreign law must explain than any effect (chosen: beside one that is there it explains the
same at most, having a few numbers more)."""

NEARLY = 0.8
"""Share of what a motion or a force of any course explains that a foreign law must explain: such a course
follows every law (chosen: what is left to it is what the law's few numbers miss)."""

MAINLY = 0.25
"""Share of what stands above the noise that a foreign law must explain (chosen: the search stops there, so it
must be most of what is wrong; where much else is, a few numbers more explain more than the right effect)."""


SOMETHING, LITTLE = 0.05, 0.25
"""Of what stands above the noise, what the effects must leave, and of that, what the law may leave (chosen:
an effect that is there leaves nothing; where one explains most, no law could explain clearly more)."""

Told = Callable[[Option], tuple[tuple[str, ...], str]]
"""Where, and in words and numbers."""


@dataclass(frozen=True, slots=True)
class _Law:
    candidates: Callable[[Account, Scene], Iterator[Candidate]] | None
    told: Told | None
    found: Callable[[Account], Iterator[Foreign]] | None


@cache
def _laws() -> tuple[_Law, ...]:
    modules = [import_module(f"{__name__}.{info.name}") for info in pkgutil.iter_modules(__path__)]
    hooks = ("candidates", "told", "found")
    return tuple(_Law(*(getattr(module, hook, None) for hook in hooks)) for module in modules)


def foreign(now: Account, options: Options, settings: DiscoverySettings) -> Foreign | None:
    """The law that explains most, if it does so clearly better than any effect."""
    found = _found(now, settings.stretch_s)
    sure = [law for law in found if max(law.p * options.count, law.unseen) <= settings.level]
    above = {of_forces: _standing_out(now, of_forces=of_forces) for of_forces in (False, True)}
    main = [law for law in sure if law.expected > MAINLY * above[law.of_forces]]
    clear = [law for law in main if _clear(law, _rivals(law, options), above[law.of_forces])]
    return max(clear, key=lambda law: law.expected, default=None)


def _clear(law: Foreign, rivals: float, above: float) -> bool:
    """Whether a law explains clearly more than any effect, or leaves little where they leave something."""
    lead = above - rivals / CLEARLY
    return law.expected > rivals or (lead > SOMETHING * above and above - law.expected < LITTLE * lead)


def _found(now: Account, stretch_s: float) -> Iterator[Foreign]:
    scene = scene_of(now)
    told: dict[Candidate, Told] = {}
    for law in _laws():
        if law.found is not None:
            yield from law.found(now)
        if law.candidates is not None and law.told is not None:
            told |= dict.fromkeys(law.candidates(now, scene), law.told)
    for of_forces in (False, True):
        choice = [c for c in told if c.of_forces == of_forces]
        for option in compared(now, choice, stretch_s, len(choice)):
            where, law_in_words = told[option.candidate](option)
            fitted, unseen = option.fitted, option.unseen
            yield Foreign(where, law_in_words, fitted.expected, fitted.p, unseen.p, of_forces)


def _standing_out(now: Account, *, of_forces: bool) -> float:
    """Whitened squares in the trials to fit, without those of noise."""
    items: Sequence[Watched | Weighed] = now.weighed if of_forces else now.watched
    return sum(item.square - item.freedom for item in items if item.role == "fit")


def _rivals(law: Foreign, options: Options) -> float:
    """What the effects explain, each held to its own standard."""
    most = 0.0
    for option in options.best:
        if option.candidate.of_forces == law.of_forces:
            any_course = isinstance(option.candidate.change, FreeMotion | Contact)
            most = max(most, (NEARLY if any_course else CLEARLY) * option.fitted.expected)
    return most
