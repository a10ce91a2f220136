"""Two faults of one plate at once, each of which hides behind the other.

Effects are named one after the other. Where two at one plate partly cancel, what is left looks like neither,
and several others may be named in their stead: a plate that measures too little and has something added looks
like another plate that measures too much. So once effects of forces are named, be it one, every two faults of
one plate are tried in their stead.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations

from scaling_service.discovery import catalogue
from scaling_service.discovery.additions import Sized
from scaling_service.discovery.candidates import Candidate
from scaling_service.discovery.findings import Named
from scaling_service.discovery.fitting import Account, reweighed, scene_of
from scaling_service.discovery.options import compared
from scaling_service.discovery.refining import ROUGHLY, misfit, refined
from scaling_service.discovery.rivals import Naming
from scaling_service.discovery.scene import Scene
from scaling_service.discovery.strictness import DiscoverySettings

Two = tuple[Candidate, Candidate]


def two_of_one_plate(named: Sequence[Named], now: Account, naming: Naming) -> tuple[list[Named], Account]:
    """Two faults of one plate in place of the effects of forces, where the two explain more."""
    recordings, settings = naming.recordings, naming.settings
    several = [n for n in named if n.effect.candidate.of_forces]
    if not several:
        return list(named), now
    tries = 1 if len(several) > 1 else naming.count  # one more effect than is named must stand as any other
    bare = replace(now, effects=tuple(e for e in now.effects if not e.candidate.of_forces))
    bare = reweighed(bare, recordings)
    sized = _best(bare, settings)
    if sized is None:
        return list(named), now
    tried = refined(bare, recordings, sized, settings.stretch_s, ROUGHLY, of_forces=True)
    if misfit(tried) >= misfit(now):
        return list(named), now
    made = [_beside(one, other, bare, naming, tries) for one, other in (sized, sized[::-1])]
    sure = [n for n in made if n is not None]
    if len(sure) < len(made):
        return list(named), now
    return [n for n in named if n not in several] + sure, tried


def _best(bare: Account, settings: DiscoverySettings) -> tuple[Sized, Sized] | None:
    """The two that explain most together, if it is no chance."""
    pairs = {_both(one, other): (one, other) for one, other in _pairs(scene_of(bare))}
    for option in compared(bare, list(pairs), settings.stretch_s, 1):
        if option.fitted.p * len(pairs) <= settings.level and option.unseen.p <= settings.level:
            one, other = pairs[option.candidate]
            edge = len(one.columns)
            return Sized(one, option.fitted.size[:edge]), Sized(other, option.fitted.size[edge:])
    return None


def _pairs(scene: Scene) -> Iterator[Two]:
    faults = [c for c in catalogue.candidates(scene) if not c.trials and c.where[0] in scene.plates]
    return ((a, b) for a, b in combinations(faults, 2) if a.where == b.where and a.kind != b.kind)


def _both(one: Candidate, other: Candidate) -> Candidate:
    note = f"{one.kind} {one.note} {other.kind} {other.note}"
    return Candidate("pair", one.where, (*one.columns, *other.columns), note=note)


def _beside(one: Sized, other: Sized, bare: Account, naming: Naming, tries: int) -> Named | None:
    """One of the two as a named effect where the other is known, if it stands by itself then."""
    known = reweighed(replace(bare, effects=(*bare.effects, other)), naming.recordings)
    for option in compared(known, [one.candidate], naming.settings.stretch_s, 1):
        if max(tries * option.fitted.p, option.unseen.p) <= naming.settings.level:
            return naming.name(option, known)
    return None
