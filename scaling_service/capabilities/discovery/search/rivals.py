"""Names compared again once more is known: with their rivals, and two that hide behind each other.

The first name is given while everything else is still missing, and what is missing may have spoken for the
wrong place. With the others known, another candidate may explain clearly more.

Effects are named one after the other. Where two of one place partly cancel, what is left looks like neither,
and nothing is named, or several others in their stead: a plate that measures too little and has something
added looks like another plate that measures too much; a marker that was stuck on elsewhere, over skin that
takes it back as the joint bends, looks like one that moves independently.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

from scaling_service.capabilities.discovery.disturbances.disturbance import Disturbance
from scaling_service.capabilities.discovery.disturbances.free_marker import FreeMarker
from scaling_service.capabilities.discovery.effects.catalogue import propose_candidates, search_effects
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.evidence.scoring import ScoredCandidate, score_candidates
from scaling_service.capabilities.discovery.evidence.settings import DiscoverySettings
from scaling_service.capabilities.discovery.evidence.statistics import assess_lead
from scaling_service.capabilities.discovery.evidence.wrench import OBSERVATIONS, WRENCH
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Contact, Estimate, Reweighed
from scaling_service.capabilities.discovery.search.elimination import Removable
from scaling_service.capabilities.discovery.search.estimation import (
    ROUGHLY,
    SOON,
    compute_misfit,
    estimate,
    refit_without,
    select_observations,
)
from scaling_service.capabilities.discovery.search.findings import NamedEffect
from scaling_service.capabilities.discovery.search.selection import in_range


@dataclass(frozen=True, slots=True)
class _Pair:
    """Two effects with their sizes when fitted together, and what they are to explain on other data."""

    both: tuple[Estimate, Estimate]
    expected: float


def find_marker_pair(
    odd: FreeMarker, fit: Fit, name: Name, count: int, refused: Collection[str]
) -> list[NamedEffect]:
    """Two laws of a marker that seems to move independently, if they explain about as much; else none.

    Parameters
    ----------
    count : int
        Of the candidates among which names are selected.
    refused : collection of str
        Keys of candidates that were tried without success.
    """
    laws = [
        c
        for c in propose_candidates(fit.scene)
        if c.where == odd.candidate.where and c.oscillation is None and not c.trials and c.key not in refused
    ]
    pair = _find_best(fit, laws, count)
    if pair is None or fit.settings.free_marker_lead * pair.expected < odd.expected:
        return []
    return _name_both(pair, fit, name, count)


def replace_by_plate_pair(
    named: Sequence[NamedEffect], fit: Fit, name: Name, count: int
) -> tuple[list[NamedEffect], Fit]:
    """Two faults of one plate in place of the effects of forces, where the two explain more."""
    loads = (n for n in named if WRENCH.shows(n.candidate))
    several = [n for n in loads if not isinstance(n.candidate.change, Reweighed)]
    tries = 1 if len(several) > 1 else count  # one more effect than is named must stand as any other
    gone = {n.key for n in several}
    bare = WRENCH.refit(fit, fit.free, [e for e in fit.effects if e.candidate.key not in gone])
    pair = _find_best(bare, _list_plate_faults(bare), tries)
    if pair is None:
        return list(named), fit
    tried = estimate(bare, pair.both, ROUGHLY, observations=(WRENCH,))
    if compute_misfit(tried) >= compute_misfit(fit):
        return list(named), fit
    sure = _name_both(pair, bare, name, tries)
    if not sure:
        return list(named), fit
    return [n for n in named if n not in several] + sure, tried


def is_plate_pair(law: Disturbance, fit: Fit, count: int) -> bool:
    """Whether two faults of one plate explain more than a disturbance of forces that resembles them."""
    pair = _find_best(fit, _list_plate_faults(fit), count) if law.seen_in == WRENCH.name else None
    return pair is not None and pair.expected >= law.expected


def _list_plate_faults(fit: Fit) -> list[Candidate]:
    return [c for c in propose_candidates(fit.scene) if not c.trials and c.where[0] in fit.scene.plates]


def _find_best(fit: Fit, laws: Iterable[Candidate], tries: int) -> _Pair | None:
    """The two of different kinds at one place that explain most together, if it is no chance."""
    pairs = {
        _join_pair(a, b): (a, b) for a, b in combinations(laws, 2) if a.where == b.where and a.kind != b.kind
    }
    level = fit.settings.level
    for scored in score_candidates(fit, list(pairs), 1):
        fitted = scored.fitted
        if fitted.p * max(tries, len(pairs)) <= level and scored.held_out.p <= level:
            one, other = pairs[scored.candidate]
            edge = len(one.columns)
            sizes = fitted.size[:edge], fitted.size[edge:]
            return _Pair((Estimate(one, sizes[0]), Estimate(other, sizes[1])), fitted.expected)
    return None


def _join_pair(one: Candidate, other: Candidate) -> Candidate:
    return Candidate(
        kind="pair",
        where=one.where,
        columns=(*one.columns, *other.columns),
        note=f"{one.name} and {other.name}",
    )


def _name_both(pair: _Pair, fit: Fit, name: Name, tries: int) -> list[NamedEffect]:
    """Both as named effects where the other is known, if each stands by itself then; else none."""
    made = [_name_beside(one, other, fit, name, tries) for one, other in (pair.both, pair.both[::-1])]
    sure = [n for n in made if n is not None]
    return sure if len(sure) == len(made) else []


def _name_beside(one: Estimate, other: Estimate, fit: Fit, name: Name, tries: int) -> NamedEffect | None:
    known = replace(fit, effects=(*fit.effects, other))
    for scored in score_candidates(known, [one.candidate], 1):
        if max(tries * scored.fitted.p, scored.held_out.p) <= fit.settings.level:
            return name(scored, known)
    return None


Name = Callable[[ScoredCandidate, Fit], NamedEffect | None]
"""Makes a named effect of a scored candidate, in a fit."""


def rename(named: Sequence[NamedEffect], fit: Fit, name: Name) -> tuple[list[NamedEffect], Fit]:
    """Give every name but the last of its sort to a rival that explains clearly more, or more with less."""
    kept = list(named)
    for observation in OBSERVATIONS:
        sort = [k for k, n in enumerate(named) if observation.shows(n.candidate)]
        early = [k for k in sort[:-1] if named[k].candidate.columns and _list_rivals(named[k])]
        rivals = list(dict.fromkeys(c for k in early for c in _list_rivals(named[k])))
        known: Removable | None = None
        for k in early:
            known = known or Removable.of(fit, observation, rivals)
            given = _give_away(kept[k], known, fit, name)
            if given is not None:
                (kept[k], fit), known = given, None
    return _place_contacts_anew(kept, fit, name)


def _give_away(n: NamedEffect, known: Removable, fit: Fit, name: Name) -> tuple[NamedEffect, Fit] | None:
    """A better rival with the name, if there is one whose numbers a laboratory could meet."""
    better = find_better_rival(n, known.without(n.effect, _list_rivals(n)), fit.settings)
    if better is None:
        return None
    bare = refit_without(fit, {n.key})
    made = name(better, bare)
    if made is None:
        return None
    tried = estimate(bare, [made.effect], SOON, observations=select_observations([made.effect]))
    return (replace(made, rivals=n.rivals), tried) if in_range(made, tried) else None


def _place_contacts_anew(named: Sequence[NamedEffect], fit: Fit, name: Name) -> tuple[list[NamedEffect], Fit]:
    """Look again for where something touches, now that more is known of the forces."""
    kept = list(named)
    loads = [k for k, n in enumerate(named) if WRENCH.shows(n.candidate)]
    for k in loads[:-1]:
        own = kept[k].candidate
        if isinstance(own.change, Contact):
            bare = refit_without(fit, {own.key})
            again = search_effects(bare, WRENCH.name)
            same = (o for o in again if o.candidate.kind == own.kind and o.candidate.trials == own.trials)
            best = next(same, None)
            made = None if best is None else name(best, bare)
            if made is not None:
                tried = estimate(bare, [made.effect], ROUGHLY, observations=(WRENCH,))
                if compute_misfit(tried) < compute_misfit(fit):
                    kept[k], fit = made, tried
    return kept, fit


def _list_rivals(n: NamedEffect) -> list[Candidate]:
    return [c for c in n.rivals if c.key != n.key and c.trials == n.candidate.trials]


def find_better_rival(
    n: NamedEffect, scored: Sequence[ScoredCandidate], settings: DiscoverySettings
) -> ScoredCandidate | None:
    """The best of a name and its rivals, if it is a rival and chance does not make the difference.

    Nor does it where the rival needs fewer numbers for more. What elimination would drop gets no name.
    """
    level = settings.level
    best = next(iter(scored), None)
    mine = next((o for o in scored if o.candidate.key == n.key), None)
    if best is None or best is mine or best.fitted.p > level or not best.does_good(level):
        return None
    if mine is None or len(best.candidate.columns) < len(mine.candidate.columns):
        return best
    assert best.gains is not None
    assert mine.gains is not None
    p = assess_lead(best.gains, mine.gains, best.fitted.by_chance - mine.fitted.by_chance)
    return best if p <= settings.equivalence_level else None
