"""What is named next: the best effect of the motion with its companions, and the best of the forces.

One effect after the other would be slow where much is missing, and would leave no room for small ones. So
others of the motion are named along with the best if they pass beside it and explain most of what they do
without it: then they are no shadows of it.

What is chosen is tested in full: everything is estimated anew with it, and what holds is added. What was
promised is to first order, and of one sort of observation. Once everything has followed, numbers may have
left their ranges, little may be kept of the promise, and a motion that brings the markers of recordings
that were not fitted nearer may carry masses along as no force says they were.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from scaling_service.capabilities.discovery.effects.catalogue import propose_candidates, search_effects
from scaling_service.capabilities.discovery.effects.missing_dof import is_in_usual_range
from scaling_service.capabilities.discovery.effects.plates import contradict_bias
from scaling_service.capabilities.discovery.effects.sizes import is_usual
from scaling_service.capabilities.discovery.evidence.fit import Fit, sum_held_out_squares
from scaling_service.capabilities.discovery.evidence.markers import MARKERS
from scaling_service.capabilities.discovery.evidence.observation import Observation
from scaling_service.capabilities.discovery.evidence.scoring import (
    ScoredCandidate,
    ScoredCandidates,
    score_candidates,
    score_gathered,
)
from scaling_service.capabilities.discovery.evidence.settings import DiscoverySettings
from scaling_service.capabilities.discovery.evidence.wrench import OBSERVATIONS, WRENCH, choose_observation
from scaling_service.capabilities.discovery.search.estimation import (
    ROUGHLY,
    estimate,
    refit_without,
    remove,
    select_observations,
)
from scaling_service.capabilities.discovery.search.findings import NamedEffect
from scaling_service.capabilities.discovery.search.naming import (
    find_equivalents,
    name_effect,
    name_tuned,
    tune,
)
from scaling_service.core.threads import map_parallel


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


def score_all(fit: Fit, before: ScoredCandidates | None = None) -> ScoredCandidates:
    """Try everything in the catalogue at every place.

    Parameters
    ----------
    before : ScoredCandidates, optional
        From the last round; what the same motion shows among the markers is not scored again.
    """
    taken = {s.candidate.key for s in fit.estimates}
    every = [c for c in propose_candidates(fit.scene) if c.key not in taken]

    def score(observation: Observation[Any]) -> tuple[Sequence[ScoredCandidate], Sequence[ScoredCandidate]]:
        choice = [c for c in every if observation.shows(c)]
        found = search_effects(fit, observation.name)
        return score_candidates(fit, choice, fit.settings.shortlist), list(found)

    if before is not None and before.tracked is fit.tracked:
        of_markers, of_wrench = before.of_markers, score(WRENCH)
    else:
        of_markers, of_wrench = map_parallel(score, OBSERVATIONS)
    found = [*of_markers[1], *of_wrench[1]]
    new = [o for o in found if o.candidate.key not in taken]
    best = sorted((*of_markers[0], *of_wrench[0], *new), key=lambda o: o.fitted.rank)
    return ScoredCandidates(best, len(every) + len(found), of_markers, fit.tracked)


@dataclass(frozen=True, slots=True)
class Selection:
    """What to name next, and keys of candidates that no plausible oscillation fits."""

    named: list[NamedEffect]
    refused: set[str]


def select(
    fit: Fit, scored: ScoredCandidates, named: Sequence[NamedEffect], refused: Collection[str]
) -> Selection:
    """The best of the motion and of the forces that pass, as far as there is room, with their companions.

    Parameters
    ----------
    named : sequence of NamedEffect
        So far.
    refused : collection of str
        Keys of candidates that were tried without success.
    """
    found: list[NamedEffect] = []
    implausible: set[str] = set()
    trials = [item.name for item in fit.tracked]
    fitting = [item.name for item in fit.tracked if item.role == "fit"]
    for observation in OBSERVATIONS:
        room = fit.settings.most - sum(observation.shows(n.candidate) for n in named)
        shown = [o for o in scored.best if observation.shows(o.candidate)]
        passing = [o for o in (*_tune_best(shown, scored, fit), *shown) if _is_accepted(o, scored, fit)]
        passing = [
            o for o in keep_widest(passing, trials, fitting, fit.settings) if o.candidate.key not in refused
        ]
        for best in _put_usual_first(passing, scored, fit) if room > 0 else []:
            first = name_tuned(best, fit, scored)
            if first is not None:
                others = [
                    o for o in passing if MARKERS.shows(o.candidate) and o.candidate.key not in implausible
                ]
                found += [first, *_list_companions(first, others, scored, fit)[: room - 1]]
                break
            implausible.add(best.candidate.key)
    return Selection(found, implausible)


def _put_usual_first(
    passing: Sequence[ScoredCandidate], among: ScoredCandidates, fit: Fit
) -> Sequence[ScoredCandidate]:
    """The same; before a best of a size that laboratories do not meet, one that they do, not told from it."""

    def is_met(one: ScoredCandidate) -> bool:
        return is_usual(one.candidate, one.fitted.size, one.fitted.spread, fit.model)

    if not passing or is_met(passing[0]):
        return passing
    equivalents = find_equivalents(passing[0], among.best, fit.settings.equivalence_level)
    better = [one for one in passing if one.candidate in equivalents and is_met(one)]
    return [*better[:1], *passing]


def _tune_best(shown: Sequence[ScoredCandidate], among: ScoredCandidates, fit: Fit) -> list[ScoredCandidate]:
    """The best candidate at its own frequency and damping, if it oscillates and between those tried may pass.

    One that explains much at a frequency beside its own strays too much from block to block to pass there.
    """
    best = next(iter(shown), None)
    if best is None or best.candidate.oscillation is None or _is_accepted(best, among, fit):
        return []
    observation = choose_observation(best.candidate)
    if best.fitted.expected < fit.settings.oscillation_main * observation.above_noise(fit):
        return []
    tuned = tune(best, fit)
    if tuned is None:
        return []
    choice = [tuned.candidate]
    return score_gathered(observation.gather_beside(fit, choice, together=True), choice)


def _is_accepted(one: ScoredCandidate, among: ScoredCandidates, fit: Fit) -> bool:
    level = fit.settings.level
    by_chance = max(one.p_family(among.count), one.fitted.p)
    likely = by_chance <= level and one.fitted.expected > 0.0
    contradicted = contradict_bias(one.candidate, one.fitted.size, fit.wrenches)
    return likely and one.does_good(level) and not (contradicted or _is_partial_plate_fault(one, fit))


def _is_partial_plate_fault(one: ScoredCandidate, fit: Fit) -> bool:
    """Whether it is a plate's fault in some recordings only that is not all that is wrong with these.

    A model that is wrong looks like a fault of a plate in the recording that it was fitted to, and like
    another one in the next.
    """
    trials = one.candidate.trials
    if not trials or one.candidate.where[0] not in fit.scene.plates:
        return False
    above = sum(item.square - item.freedom for item in fit.wrenches if item.name in trials)
    return one.fitted.gain < fit.settings.whole_cause * above


def _list_companions(
    first: NamedEffect, passing: Sequence[ScoredCandidate], among: ScoredCandidates, fit: Fit
) -> list[NamedEffect]:
    """Effects that explain beside the first, and beside each other, most of what each does alone."""
    settings = fit.settings
    worth = settings.companion_worth * first.fitted.expected
    plain = [o for o in passing if o.candidate.columns and o.candidate.oscillation is None]
    left = {o.candidate.key: o for o in plain if o.fitted.expected > worth}
    left.pop(first.key, None)
    choice = [first.candidate, *(o.candidate for o in left.values())]
    found = [first]
    if not left or not first.candidate.columns:
        return []
    evidence = MARKERS.gather_beside(fit, choice, together=True)
    columns = {c.key: np.r_[rows] for c, rows in zip(choice, evidence.groups, strict=True)}
    free = np.arange(evidence.nuisances)
    while left and len(found) <= settings.companions:
        known = np.concatenate([free, *(columns[n.key] for n in found)])
        rest = [o.candidate for o in left.values()]
        again = score_gathered(evidence.arrange(known, [columns[c.key] for c in rest]), rest)
        still = [
            left[o.candidate.key]
            for o in again
            if o.fitted.expected > settings.companion_beside * left[o.candidate.key].fitted.expected
            and _is_accepted(o, among, fit)
        ]
        left = {o.candidate.key: o for o in still[1:]}
        found += [name_effect(o, fit, among) for o in still[:1]]
    return found[1:]


def keep_widest(
    passing: Sequence[ScoredCandidate],
    trials: Sequence[str],
    fitting: Collection[str],
    settings: DiscoverySettings,
) -> list[ScoredCandidate]:
    """Without what passes in more trials too, or in all others, where gains cannot tell which it is.

    Gains in held-out trials and in those to fit do not compare. And where two scopes hold the same trials to
    fit, gains are the same: the held-out trials have judged the wider one, and it passed. Where what it
    changes is free in all trials, it explains as much in all others, reversed: then the model is taken to be
    right in the first trial, for what changes, changes later.

    Parameters
    ----------
    trials : sequence of str
        All trials, in their order.
    fitting : collection of str
        Those of them that are to fit.
    """
    every, known = frozenset(trials), frozenset(fitting)
    scopes: dict[str, dict[frozenset[str], float]] = {}
    for scored in passing:
        scopes.setdefault(_name_thing(scored), {})[_list_scope(scored, every)] = scored.fitted.expected

    def is_covered(scored: ScoredCandidate) -> bool:
        own, all_scopes = _list_scope(scored, every), scopes[_name_thing(scored)]
        wider = [other & known for other in all_scopes if own < other]
        return any(fits and own & known in (frozenset(), fits) for fits in wider)

    def is_reversed_later(scored: ScoredCandidate) -> bool:
        own = _list_scope(scored, every)
        others = scopes[_name_thing(scored)].get(every - own, 0.0)
        return trials[0] in own and others > settings.reversed_share * scored.fitted.expected

    return [scored for scored in passing if not is_covered(scored) and not is_reversed_later(scored)]


def _list_scope(scored: ScoredCandidate, every: frozenset[str]) -> frozenset[str]:
    return frozenset(scored.candidate.trials) or every


def _name_thing(scored: ScoredCandidate) -> str:
    """What it is, wherever it is."""
    return replace(scored.candidate, trials=()).name
