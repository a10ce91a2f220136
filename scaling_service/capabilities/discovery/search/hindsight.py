"""Effects looked at again once all are known: superfluous ones and ill-fitting names are dropped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from scaling_service.capabilities.discovery.evidence.fitting import Account, Recording, unseen_squares
from scaling_service.capabilities.discovery.evidence.predictable import marker_names
from scaling_service.capabilities.discovery.laws.additions import freedom_name
from scaling_service.capabilities.discovery.laws.freedoms import MOST, course_rms
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.candidates import FreeMotion
from scaling_service.capabilities.discovery.search.catalogue import details, plausible, spreads
from scaling_service.capabilities.discovery.search.findings import Named
from scaling_service.capabilities.discovery.search.option import Option
from scaling_service.capabilities.discovery.search.refining import SETTLED, misfit, refined, taken_back
from scaling_service.capabilities.discovery.search.strictness import DiscoverySettings
from scaling_service.capabilities.discovery.search.tallies import floors_of
from scaling_service.capabilities.discovery.search.withdrawn import Withdrawable

LACK = 0.3
"""Of what an effect explains at its place: when the movement or the time predicts more than this of what is
left there, the name does not fit (chosen: a law that is right leaves nothing to predict)."""


def without_the_superfluous(
    named: Sequence[Named], now: Account, recordings: Sequence[Recording], settings: DiscoverySettings
) -> tuple[list[Named], Account]:
    """Drop what left its range, what chance explains as well, and what does no good where it was not fitted.

    An effect of some recordings shows in no other, so these say nothing of it.
    """
    kept = list(named)
    for n in named:
        if not keeps_to_its_range(n, now):
            kept = [m for m in kept if m is not n]
            now = taken_back([n.effect], now, recordings, settings.stretch_s)
    spared: list[Named] = []
    while len(kept) > 1 and (doubtful := _most_doubtful(kept, spared, now, settings)) is not None:
        n, by_chance = doubtful
        without = taken_back([n.effect], now, recordings, settings.stretch_s)
        if by_chance or unseen_squares(without) <= unseen_squares(now):
            kept = [m for m in kept if m is not n]
            now = without
        else:
            spared.append(n)
    return kept, now


def without_the_ill_fitting(
    named: Sequence[Named],
    now: Account,
    before: Account,
    recordings: Sequence[Recording],
    scene: Scene,
    stretch_s: float,
) -> tuple[list[Named], Account]:
    """Drop names at whose place the movement or the time still predicts much of what is left."""
    kept = list(named)
    for n in named:
        if _lack(n, before, now, scene, stretch_s) > LACK:
            kept = [m for m in kept if m is not n]
            now = taken_back([n.effect], now, recordings, stretch_s)
    return kept, now


def at_rest(
    named: Sequence[Named], now: Account, recordings: Sequence[Recording], stretch_s: float
) -> tuple[list[Named], Account]:
    """Names with their numbers where everything is estimated to its last digit."""
    now = _settled(now, recordings, stretch_s)
    by_key = {e.candidate.key: e for e in now.effects}
    found = [replace(n, effect=by_key[n.effect.candidate.key]) for n in named]
    return [
        replace(n, details=details(n.effect, now), spreads=spreads(n.effect, now, stretch_s)) for n in found
    ], now


def _most_doubtful(
    named: Sequence[Named], spared: Sequence[Named], now: Account, settings: DiscoverySettings
) -> tuple[Named, bool] | None:
    """Of effects that chance explains as well, or that do no sure good where not fitted, the least sure.

    And whether chance does as much as it does. One at a time: of two that stand for the same thing neither
    does anything beside the other.
    """
    found: list[tuple[float, Named]] = []
    for of_forces in (False, True):
        sort = [n for n in named if n.effect.candidate.of_forces == of_forces and n not in spared]
        sort = [n for n in sort if n.effect.candidate.change is None]
        known = Withdrawable.of(now, [], settings.stretch_s, of_forces=of_forces) if sort else None
        for n in sort:
            assert known is not None
            option = next(iter(known.without(n.effect, [])), None)
            p = 1.0 if option is None else option.fitted.p
            if p > settings.level or (not n.effect.candidate.trials and not does_good(option, settings)):
                found.append((p, n))
    p, least = max(found, key=lambda each: each[0], default=(0.0, None))
    return None if least is None else (least, p > settings.level)


def does_good(option: Option | None, settings: DiscoverySettings) -> bool:
    """Whether an effect surely lowers what recordings that did not fit it disagree."""
    return option is not None and option.unseen.p <= settings.level and option.unseen.gain > 0.0


def keeps_to_its_range(n: Named, now: Account) -> bool:
    """Whether all its numbers, estimated with everything else, are such as a laboratory could meet."""
    effect = next(e for e in now.effects if e.candidate.key == n.effect.candidate.key)
    free = effect.candidate.change
    if isinstance(free, FreeMotion):
        return bool(course_rms(now.watched, freedom_name(effect.candidate)) < MOST[free.kind])
    return plausible(effect.candidate, effect.size)


def _settled(now: Account, recordings: Sequence[Recording], stretch_s: float) -> Account:
    """Everything estimated to its last digit, if that helps: skin near resonance may come to no rest."""
    settled = refined(now, recordings, [], stretch_s)
    return settled if misfit(settled) <= misfit(now) * (1.0 + SETTLED) else now


def _lack(n: Named, before: Account, now: Account, scene: Scene, stretch_s: float) -> float:
    """What is still predicted at the place of a marker's effect, over what the effect took off there.

    Of effects of joints, segments and forces no single place is theirs, so nothing is asked.
    """
    names = marker_names(now)
    rows = [names.index(m) for m in n.effect.candidate.where if m in names]
    trials = n.effect.candidate.trials
    if not rows or not trials or n.effect.candidate.change is not None:
        return 0.0
    floors = floors_of(now, scene.moving, stretch_s)
    left = sum(float(floors.explained_markers[trial][:, rows].sum()) for trial in trials)
    wanted = [names[r] for r in rows]
    taken = _squares_at(before, wanted, trials) - _squares_at(now, wanted, trials)
    return left / max(taken, 1e-300)


def _squares_at(now: Account, markers: Sequence[str], trials: Sequence[str]) -> float:
    """Squared residuals of some markers in some trials, m2."""
    squares = 0.0
    for item in now.watched:
        if item.name in trials:
            at = [item.markers.index(m) for m in markers if m in item.markers]
            squares += float(np.nansum(item.residuals[:, at] ** 2))
    return squares
