"""Two effects at one place at once, each of which hides behind the other.

Effects are named one after the other. Where two of one place partly cancel, what is left looks like neither,
and nothing is named, or several others in their stead: a plate that measures too little and has something
added looks like another plate that measures too much; a marker that was stuck on elsewhere, over skin that
takes it back as the joint bends, looks like one that goes its own way.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

from scaling_service.capabilities.discovery.disturbances.search import CLEARLY, Odd
from scaling_service.capabilities.discovery.evidence.fitting import Account, reweighed, scene_of
from scaling_service.capabilities.discovery.laws.additions import Sized
from scaling_service.capabilities.discovery.search import catalogue
from scaling_service.capabilities.discovery.search.candidates import Candidate
from scaling_service.capabilities.discovery.search.findings import Named
from scaling_service.capabilities.discovery.search.options import compared
from scaling_service.capabilities.discovery.search.refining import ROUGHLY, misfit, refined
from scaling_service.capabilities.discovery.search.rivals import Naming


@dataclass(frozen=True, slots=True)
class _Pair:
    """Two effects with their sizes when fitted together, and what they are to explain on other data."""

    both: tuple[Sized, Sized]
    expected: float


def two_of_one_marker(odd: Odd, now: Account, naming: Naming, refused: Collection[str]) -> list[Named]:
    """Two laws of a marker that seems to go its own way, if they explain about as much; else none.

    Parameters
    ----------
    refused : collection of str
        Keys of candidates that were tried in vain.
    """
    laws = [
        c
        for c in catalogue.candidates(scene_of(now))
        if c.where == odd.candidate.where and c.swing is None and not c.trials and c.key not in refused
    ]
    pair = _best(now, laws, naming, naming.count)
    if pair is None or CLEARLY * pair.expected < odd.expected:
        return []
    return _named(pair, now, naming, naming.count)


def two_of_one_plate(named: Sequence[Named], now: Account, naming: Naming) -> tuple[list[Named], Account]:
    """Two faults of one plate in place of the effects of forces, where the two explain more."""
    recordings, settings = naming.recordings, naming.settings
    several = [n for n in named if n.effect.candidate.of_forces]
    tries = 1 if len(several) > 1 else naming.count  # one more effect than is named must stand as any other
    bare = replace(now, effects=tuple(e for e in now.effects if not e.candidate.of_forces))
    bare = reweighed(bare, recordings)
    scene = scene_of(bare)
    faults = [c for c in catalogue.candidates(scene) if not c.trials and c.where[0] in scene.plates]
    pair = _best(bare, faults, naming, tries)
    if pair is None:
        return list(named), now
    tried = refined(bare, recordings, pair.both, settings.stretch_s, ROUGHLY, of_forces=True)
    if misfit(tried) >= misfit(now):
        return list(named), now
    sure = _named(pair, bare, naming, tries)
    if not sure:
        return list(named), now
    return [n for n in named if n not in several] + sure, tried


def _best(now: Account, laws: Iterable[Candidate], naming: Naming, tries: int) -> _Pair | None:
    """The two of different kinds at one place that explain most together, if it is no chance."""
    pairs = {
        _together(a, b): (a, b) for a, b in combinations(laws, 2) if a.where == b.where and a.kind != b.kind
    }
    level = naming.settings.level
    for option in compared(now, list(pairs), naming.settings.stretch_s, 1):
        fitted = option.fitted
        if fitted.p * max(tries, len(pairs)) <= level and option.unseen.p <= level:
            one, other = pairs[option.candidate]
            edge = len(one.columns)
            return _Pair((Sized(one, fitted.size[:edge]), Sized(other, fitted.size[edge:])), fitted.expected)
    return None


def _together(one: Candidate, other: Candidate) -> Candidate:
    return Candidate("pair", one.where, (*one.columns, *other.columns), note=f"{one.name} and {other.name}")


def _named(pair: _Pair, now: Account, naming: Naming, tries: int) -> list[Named]:
    """Both as named effects where the other is known, if each stands by itself then; else none."""
    made = [_beside(one, other, now, naming, tries) for one, other in (pair.both, pair.both[::-1])]
    sure = [n for n in made if n is not None]
    return sure if len(sure) == len(made) else []


def _beside(one: Sized, other: Sized, now: Account, naming: Naming, tries: int) -> Named | None:
    known = replace(now, effects=(*now.effects, other))
    for option in compared(known, [one.candidate], naming.settings.stretch_s, 1):
        if max(tries * option.fitted.p, option.unseen.p) <= naming.settings.level:
            return naming.name(option, known)
    return None
