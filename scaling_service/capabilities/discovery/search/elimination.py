"""Backward elimination: effects looked at again once all are known, and dropped where they are not needed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from scaling_service.capabilities.discovery.effects.catalogue import (
    ask,
    describe_details,
    estimate_spreads,
    is_answer,
)
from scaling_service.capabilities.discovery.evidence.fit import Fit, sum_held_out_squares
from scaling_service.capabilities.discovery.evidence.markers import MARKERS
from scaling_service.capabilities.discovery.evidence.noise_floors import (
    measure_noise_floor,
    measure_noise_floors,
)
from scaling_service.capabilities.discovery.evidence.observation import Observation, Tally
from scaling_service.capabilities.discovery.evidence.scoring import ScoredCandidate, score_gathered
from scaling_service.capabilities.discovery.evidence.sums import Block, Evidence
from scaling_service.capabilities.discovery.evidence.wrench import OBSERVATIONS, WRENCH
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Estimate, Masked, Reweighed
from scaling_service.capabilities.discovery.observations.tracked import ROLES, Role
from scaling_service.capabilities.discovery.search.estimation import SETTLED, compute_misfit, estimate, remove
from scaling_service.capabilities.discovery.search.findings import NamedEffect
from scaling_service.capabilities.discovery.search.selection import in_range
from scaling_service.numerics.multibody.laws import Array


@dataclass(frozen=True, slots=True, eq=False)
class Removable:
    """All that is known of one observation beside rivals, to be taken back by columns alone.

    Whether a name is still the best of its rivals, and whether an effect still does any good, is asked of
    every effect each time that another one is found. To first order the answer lies in products of columns
    that are made once: what an effect took off is put back, and it and its rivals are fitted beside
    everything else, without tracking the recordings anew.
    """

    evidence: Evidence  # gathered together: known columns are its nuisances
    known: list[Estimate]
    rivals: list[Candidate]

    @classmethod
    def of(cls, fit: Fit, observation: Observation[Any], rivals: Sequence[Candidate] = ()) -> Removable:
        """Pass all recordings once."""
        evidence = observation.gather_beside(fit, rivals, together=True)
        return cls(evidence, observation.list_known(fit), list(rivals))

    def without(self, effect: Estimate, rivals: Sequence[Candidate] = ()) -> list[ScoredCandidate]:
        """One of the known and some of the rivals scored where that one is taken back, the best first."""
        edges = np.cumsum([0, *(len(s.candidate.columns) for s in self.known)])
        k = next(k for k, s in enumerate(self.known) if s.candidate.key == effect.candidate.key)
        own = np.arange(edges[k], edges[k + 1])
        others = np.delete(np.arange(edges[-1]), own)
        groups = [own, *(np.r_[self.evidence.groups[self.rivals.index(c)]] for c in rivals)]
        blocks = tuple(_put_back(s, own, self.known[k].size) for s in self.evidence.blocks)
        evidence = replace(self.evidence, blocks=blocks).arrange(others, groups)
        return score_gathered(evidence, [self.known[k].candidate, *rivals])


def _put_back(s: Block, own: Array, size: Array) -> Block:
    """A block in which columns of known size are no longer taken off."""
    square = s.square + float(2.0 * size @ s.scores[own] + size @ s.own[np.ix_(own, own)] @ size)
    return replace(s, scores=s.scores + s.own[:, own] @ size, square=square)


def eliminate_backward(named: Sequence[NamedEffect], fit: Fit) -> tuple[list[NamedEffect], Fit]:
    """Drop what left its range, what chance explains as well, and what does no good where it was not fitted.

    An effect of some recordings shows in no other, so these say nothing of it. A rival that took an earlier
    name over must pass by itself, too.
    """
    kept = list(named)
    for n in named:
        if not in_range(n, fit) or n.p_family > fit.settings.level:
            kept.remove(n)
            fit = remove(fit, [n.effect])
    spared: list[NamedEffect] = []
    while len(kept) > 1 and (doubtful := _find_most_doubtful(kept, spared, fit)) is not None:
        n, by_chance = doubtful
        without = remove(fit, [n.effect])
        if by_chance or sum_held_out_squares(without) <= sum_held_out_squares(fit):
            kept.remove(n)
            fit = without
        else:
            spared.append(n)
    return kept, fit


def withdraw_answers(named: Sequence[NamedEffect], fit: Fit) -> tuple[list[NamedEffect], Fit]:
    """Take back the answers to questions that what was named since has answered as well.

    A plate that measures too little makes a person light, too; where it is named beside, it is the cause.
    """
    kept = list(named)
    for n in named:
        if len(kept) > 1 and is_answer(n.candidate.kind):
            without = remove(fit, [n.effect])
            as_good = compute_misfit(without) <= fit.settings.as_good * compute_misfit(fit)
            if as_good and ask(n.candidate.kind, without) is None:
                kept.remove(n)
                fit = without
    return kept, fit


def _find_most_doubtful(
    named: Sequence[NamedEffect], spared: Sequence[NamedEffect], fit: Fit
) -> tuple[NamedEffect, bool] | None:
    """Of effects that chance explains as well, or that do no sure good where not fitted, the least sure.

    And whether chance does as much as it does. One at a time: of two that stand for the same thing neither
    does anything beside the other.
    """
    level, found = fit.settings.level, []
    for observation in OBSERVATIONS:
        sort = [n for n in named if observation.shows(n.candidate) and n not in spared]
        sort = [n for n in sort if n.candidate.change is None]
        known = Removable.of(fit, observation) if sort else None
        for n in sort:
            assert known is not None
            scored = next(iter(known.without(n.effect)), None)
            p = 1.0 if scored is None else scored.fitted.p
            good = scored is not None and scored.does_good(level)
            if p > level or (not n.candidate.trials and not good):
                found.append((p, n))
    p, least = max(found, key=lambda each: each[0], default=(0.0, None))
    return None if least is None else (least, p > level)


def drop_predictable(named: Sequence[NamedEffect], fit: Fit, before: Fit) -> tuple[list[NamedEffect], Fit]:
    """Drop names at whose place the movement or the time still predicts much of what is left."""
    kept = list(named)
    for n in named:
        if _compute_predicted_share(n, before, fit) > fit.settings.predictable_share:
            kept.remove(n)
            fit = remove(fit, [n.effect])
    return kept, fit


def _compute_predicted_share(n: NamedEffect, before: Fit, fit: Fit) -> float:
    """What is still predicted at the place of a marker's effect, over what the effect took off there.

    Of effects of joints, segments and forces no single place is theirs, so nothing is asked.
    """
    names = MARKERS.places(fit)
    rows = [names.index(m) for m in n.candidate.where if m in names]
    trials = n.candidate.trials
    if not rows or not trials or n.candidate.change is not None:
        return 0.0
    explained = measure_noise_floor(fit, MARKERS, before.scene.moving).explained
    left = sum(float(explained[trial][:, rows].sum()) for trial in trials)
    wanted = [names[r] for r in rows]
    taken = _sum_squares_at(before, wanted, trials) - _sum_squares_at(fit, wanted, trials)
    return left / max(taken, 1e-300)


def _sum_squares_at(fit: Fit, markers: Sequence[str], trials: Sequence[str]) -> float:
    """Squared residuals of some markers in some trials, m2."""
    squares = 0.0
    for item in fit.tracked:
        if item.name in trials:
            at = [item.markers.index(m) for m in markers if m in item.markers]
            squares += float(np.nansum(item.residuals[:, at] ** 2))
    return squares


def settle(named: Sequence[NamedEffect], fit: Fit) -> tuple[list[NamedEffect], Fit]:
    """Names with their numbers where everything is estimated to its last digit.

    If that helps: skin near resonance may come to no rest.
    """
    settled = estimate(fit)
    fit = settled if compute_misfit(settled) <= compute_misfit(fit) * (1.0 + SETTLED) else fit
    by_key = {e.candidate.key: e for e in fit.effects}
    found = [replace(n, effect=by_key[n.key]) for n in named]
    return [
        replace(n, details=describe_details(n.effect, fit), spreads=estimate_spreads(n.effect, fit))
        for n in found
    ], fit


_INSUFFICIENT = (
    "the motion is known down to its noise, yet what the catalogue offers for the forces ({names}) leaves "
    "much of their disagreement: it is not named"
)


def drop_insufficient(
    named: Sequence[NamedEffect], fit: Fit, before: Fit
) -> tuple[list[NamedEffect], Fit, tuple[str, ...]]:
    """Effects of the forces that are not their whole story taken back, and what is said about it.

    Where the model follows the markers down to their noise, its motion is known, and a law that is right
    leaves little of the forces' disagreement. One that leaves much of it stands for something that the
    catalogue does not have: a clock that drifts looks somewhat like a plate's bias. Where the markers say
    that more is missing anyhow, what is left is not held against anything.
    """
    loads = [n for n in named if WRENCH.shows(n.candidate) and not isinstance(n.candidate.change, Reweighed)]
    if not loads or is_sufficient(before, fit):
        return list(named), fit, ()
    gone = {n.key for n in loads}
    kept = tuple(e for e in fit.effects if e.candidate.key not in gone)
    fit = estimate(replace(fit, effects=kept), observations=(WRENCH,))
    names = ", ".join(n.candidate.name for n in loads)
    return [n for n in named if n not in loads], fit, (_INSUFFICIENT.format(names=names),)


_NEGLIGIBLE = (
    "the cameras' noise is known, and what the catalogue offers for the motion ({names}) takes little of "
    "what stands above it: it is not named"
)


def drop_negligible(
    named: Sequence[NamedEffect], fit: Fit, before: Fit
) -> tuple[list[NamedEffect], Fit, tuple[str, ...]]:
    """Effects of the motion that together take little of what is wrong taken back, and what is said about it.

    Where the cameras' noise shows, it is known how much stands above it. A law that the catalogue does not
    have resembles some effect a little, here and there. Effects that are not told apart from many others must
    take most of it.
    """
    moved = [n for n in named if MARKERS.shows(n.candidate)]
    if not moved or not all(item.shows_noise for item in before.tracked):
        return list(named), fit, ()
    noise = measure_noise_floors(fit, before.scene.moving)[MARKERS.name].noise
    masked = [e for e in fit.effects if isinstance(e.candidate.change, Masked)]
    start = MARKERS.refit(before, before.free, masked) if masked else before  # of the same markers
    vague = max(n.member for n in moved) < fit.settings.vague
    least = fit.settings.vague_share if vague else fit.settings.negligible
    was, left = (_compute_excess(MARKERS.tally(each, None, noise)) for each in (start, fit))
    if was <= fit.settings.tracked_excess or left <= (1.0 - least) * was:
        return list(named), fit, ()
    names = ", ".join(n.candidate.name for n in moved)
    fit = remove(fit, [n.effect for n in moved])
    return [n for n in named if n not in moved], fit, (_NEGLIGIBLE.format(names=names),)


def is_sufficient(before: Fit, after: Fit) -> bool:
    """Whether the effects that lie between two fits explain the forces, as far as that can be told."""
    floors, settings = measure_noise_floors(after, before.scene.moving), after.settings

    def compute_excess(observation: Observation[Any], fit: Fit, role: Role) -> float:
        return _compute_excess(observation.tally(fit, role, floors[observation.name].noise))

    if any(compute_excess(MARKERS, after, role) > settings.tracked_excess for role in ROLES):
        return True
    left = [(compute_excess(WRENCH, before, role), compute_excess(WRENCH, after, role)) for role in ROLES]
    return all(now <= max(settings.wrench_slight, settings.wrench_left * was) for was, now in left)


def _compute_excess(tally: Tally | None) -> float:
    """Mean square of all places, each in its own floors, beyond one; none where nothing is measured."""
    if tally is None:
        return 0.0
    frames, floor = tally.frames.sum(axis=0), tally.floor.sum(axis=0)
    shown = floor > 0.0
    ratio = tally.square.sum(axis=0)[shown] / floor[shown]
    return float((ratio * frames[shown]).sum() / frames[shown].sum() - 1.0)
