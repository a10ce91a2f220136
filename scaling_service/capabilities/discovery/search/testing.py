"""Effects tested in full: everything is estimated anew with them, and those that hold are added.

What was promised is to first order, and of one sort of observation. Once everything has followed, numbers may
have left their ranges, little may be kept of the promise, and a motion that brings the markers of recordings
that were not fitted nearer may carry masses along as no force says they were.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from scaling_service.capabilities.discovery.effects.missing_dof import is_in_usual_range
from scaling_service.capabilities.discovery.effects.plates import contradict_bias
from scaling_service.capabilities.discovery.evidence.fit import Fit, sum_held_out_squares
from scaling_service.capabilities.discovery.evidence.markers import MARKERS
from scaling_service.capabilities.discovery.evidence.wrench import OBSERVATIONS, WRENCH, choose_observation
from scaling_service.capabilities.discovery.search.estimation import (
    ROUGHLY,
    estimate,
    refit_without,
    remove,
    select_observations,
)
from scaling_service.capabilities.discovery.search.findings import NamedEffect


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """What came of a test in full."""

    fit: Fit  # with the effects that hold
    added: list[NamedEffect]  # these
    refused: set[str]  # keys of candidates that do not hold
    # keys of candidates that raise what markers and forces disagree where they were not fitted, as far as
    # the forces are known by now
    early: set[str]


def try_in_full(fit: Fit, found: Sequence[NamedEffect]) -> Outcome:
    """Test effects (at least one) together, and without those that do not hold again, until the rest does."""
    refused: set[str] = set()
    early: set[str] = set()
    left = list(found)
    tried = _with(left, fit)
    while True:
        implausible = _list_implausible(left, tried)
        broken = (
            [] if implausible else [g for g in _sort_by_kind(left) if not _keep_their_promise(g, fit, tried)]
        )
        sound = not implausible and not broken
        harmful = [g for g in _sort_by_kind(left) if _do_harm(g, fit, tried)] if sound else []
        worst = [_find_worst(group, tried) for group in harmful]
        gone = implausible or worst or [n for group in broken for n in group[1:] or group]
        if not gone:
            return Outcome(tried, left, refused, early)
        refused |= {n.key for n in gone if n in implausible or [n] in broken}
        early |= {n.key for n in worst}
        left = [n for n in left if n not in gone]
        if not left:
            return Outcome(fit, [], refused, early)
        if worst or not (implausible or any(MARKERS.shows(n.candidate) for n in gone)):
            tried = remove(tried, [n.effect for n in gone])
        else:
            tried = _with(left, fit)


def _with(found: Sequence[NamedEffect], fit: Fit) -> Fit:
    """Everything estimated with effects, unless their numbers turn out to be implausible on the way."""
    added = [n.effect for n in found]
    hopeless = partial(_list_implausible, found)
    return estimate(fit, added, ROUGHLY, observations=select_observations(added), hopeless=hopeless)


def _list_implausible(named: Sequence[NamedEffect], fit: Fit) -> list[NamedEffect]:
    """Those whose numbers no laboratory could meet."""
    return [n for n in named if not in_range(n, fit)]


def in_range(named: NamedEffect, fit: Fit) -> bool:
    """Whether all numbers, estimated with everything else, are such as a laboratory could meet."""
    effect = next(e for e in fit.effects if e.candidate.key == named.key)
    contradicted = contradict_bias(effect.candidate, effect.size, fit.wrenches, removed=True)
    return is_in_usual_range(effect, fit) and not contradicted


def _sort_by_kind(named: Sequence[NamedEffect]) -> list[list[NamedEffect]]:
    """Effects of the motion and of the forces apart."""
    sorts = [[n for n in named if observation.shows(n.candidate)] for observation in OBSERVATIONS]
    return [sort for sort in sorts if sort]


def _keep_their_promise(group: Sequence[NamedEffect], before: Fit, after: Fit) -> bool:
    """Whether the disagreement fell about as much as was expected of effects of one sort."""
    of = [n.candidate for n in group]
    was, left = (choose_observation(of[0]).squares(fit, of) for fit in (before, after))
    return was - left > before.settings.kept_promise * sum(n.fitted.expected for n in group)


def _do_harm(group: Sequence[NamedEffect], before: Fit, after: Fit) -> bool:
    """Whether markers and forces together disagree more, where they were not fitted, for effects of one sort.

    Effects of the motion are compared with the forces as they were known before, those of the forces with
    the motion as it is after.
    """
    held_out = [item.name for item in before.tracked if item.role == "held_out"]
    if held_out and not any(n.candidate.holds_in(trial) for n in group for trial in held_out):
        return False
    motion = [e for e in after.effects if MARKERS.shows(e.candidate)]
    forces = [e for e in before.effects if WRENCH.shows(e.candidate)]
    half_way = sum_held_out_squares(WRENCH.refit(after, after.free, (*motion, *forces)))
    if WRENCH.shows(group[0].candidate):
        return sum_held_out_squares(after) > half_way
    return half_way > sum_held_out_squares(before)


def _find_worst(group: Sequence[NamedEffect], fit: Fit) -> NamedEffect:
    """Of effects of one sort that do harm, the one without which least is left where nothing was fitted."""
    if len(group) == 1:
        return group[0]
    return min(group, key=lambda n: sum_held_out_squares(refit_without(fit, {n.key})))
