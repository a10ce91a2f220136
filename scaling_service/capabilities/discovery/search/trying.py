"""Effects tried in full: everything is estimated anew with them, and those that hold are added.

What was promised is to first order, and of one sort of observation. Once everything has followed, numbers may
have left their ranges, little may be kept of the promise, and a motion that brings the markers of recordings
that were not fitted nearer may carry masses along as no force says they were.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

from scaling_service.capabilities.discovery.evidence.fitting import (
    Account,
    Recording,
    reweighed,
    squares,
    unseen_squares,
    without,
)
from scaling_service.capabilities.discovery.search.findings import Named
from scaling_service.capabilities.discovery.search.hindsight import keeps_to_its_range
from scaling_service.capabilities.discovery.search.refining import ROUGHLY, refined, taken_back
from scaling_service.capabilities.discovery.search.strictness import DiscoverySettings

KEPT = 0.3
"""Share of what an effect promised to explain that it must explain when everything is estimated anew with it
(chosen: the promise is that of a small change; a law that is only right for small ones keeps little)."""


@dataclass(frozen=True, slots=True, eq=False)
class Tried:
    """What came of a trial in full.

    Parameters
    ----------
    account : Account
        With the effects that hold.
    added : list of Named
        These.
    refused : set of str
        Keys of candidates that do not hold.
    early : set of str
        Keys of candidates that raise what markers and forces disagree where they were not fitted, as far as
        the forces are known by now.
    """

    account: Account
    added: list[Named]
    refused: set[str]
    early: set[str]


def tried_in_full(
    now: Account, found: Sequence[Named], recordings: Sequence[Recording], settings: DiscoverySettings
) -> Tried:
    """Try effects together, and without those that do not hold again, until the rest does.

    Parameters
    ----------
    found : sequence of Named
        At least one.
    """
    refused: set[str] = set()
    early: set[str] = set()
    left = list(found)
    tried = _with(left, now, recordings, settings)
    while True:
        strange = _strange(left, tried)
        broken = [] if strange else [g for g in _sorts(left) if not _keep_their_promise(g, now, tried)]
        sound = not strange and not broken
        harmful = [g for g in _sorts(left) if _do_harm(g, now, tried, recordings)] if sound else []
        worst = [_worst(group, tried, recordings) for group in harmful]
        gone = strange or worst or [n for group in broken for n in group[1:] or group]
        if not gone:
            return Tried(tried, left, refused, early)
        refused |= {n.effect.candidate.key for n in gone if n in strange or [n] in broken}
        early |= {n.effect.candidate.key for n in worst}
        left = [n for n in left if n not in gone]
        if not left:
            return Tried(now, [], refused, early)
        if worst or not (strange or any(not n.effect.candidate.of_forces for n in gone)):
            tried = taken_back([n.effect for n in gone], tried, recordings, settings.stretch_s)
        else:
            tried = _with(left, now, recordings, settings)


def _with(
    found: Sequence[Named], now: Account, recordings: Sequence[Recording], settings: DiscoverySettings
) -> Account:
    """Everything estimated with effects, unless they turn out to be strange on the way."""
    return refined(
        now,
        recordings,
        [n.effect for n in found],
        settings.stretch_s,
        ROUGHLY,
        of_forces=all(n.effect.candidate.of_forces for n in found),
        hopeless=partial(_strange, found),
    )


def _strange(named: Sequence[Named], now: Account) -> list[Named]:
    """Those whose numbers no laboratory could meet."""
    return [n for n in named if not keeps_to_its_range(n, now)]


def _sorts(named: Sequence[Named]) -> list[list[Named]]:
    """Effects of the motion and of the forces apart."""
    sorts = [[n for n in named if n.effect.candidate.of_forces == kind] for kind in (False, True)]
    return [sort for sort in sorts if sort]


def _keep_their_promise(group: Sequence[Named], before: Account, after: Account) -> bool:
    """Whether the disagreement fell about as much as was expected of effects of one sort."""
    of = [n.effect.candidate for n in group]
    was, left = (squares(a, of_forces=of[0].of_forces, of=of) for a in (before, after))
    return was - left > KEPT * sum(n.fitted.expected for n in group)


def _do_harm(
    group: Sequence[Named], before: Account, after: Account, recordings: Sequence[Recording]
) -> bool:
    """Whether markers and forces together disagree more, where they were not fitted, for effects of one sort.

    Effects of the motion are compared with the forces as they were known before, those of the forces with
    the motion as it is after.
    """
    unseen = [item.name for item in before.watched if item.role == "held_out"]
    if unseen and not any(n.effect.candidate.holds_in(trial) for n in group for trial in unseen):
        return False
    half_way = unseen_squares(_with_forces_of(before, after, recordings))
    if group[0].effect.candidate.of_forces:
        return unseen_squares(after) > half_way
    return half_way > unseen_squares(before)


def _with_forces_of(before: Account, after: Account, recordings: Sequence[Recording]) -> Account:
    """The motion as it is after, and of the forces what was known before, all of it as large as it was."""
    motion = [e for e in after.effects if not e.candidate.of_forces]
    forces = [e for e in before.effects if e.candidate.of_forces]
    return reweighed(replace(after, effects=(*motion, *forces)), recordings)


def _worst(group: Sequence[Named], now: Account, recordings: Sequence[Recording]) -> Named:
    """Of effects of one sort that do harm, the one without which least is left where nothing was fitted."""
    if len(group) == 1:
        return group[0]
    return min(group, key=lambda n: unseen_squares(without({n.effect.candidate.key}, now, recordings)))
