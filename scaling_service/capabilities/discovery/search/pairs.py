"""Two effects at one place at once, each of which hides behind the other.

Effects are named one after the other. Where two of one place partly cancel, what is left looks like neither,
and nothing is named, or several others in their stead: a plate that measures too little and has something
added looks like another plate that measures too much; a marker that was stuck on elsewhere, over skin that
takes it back as the joint bends, looks like one that moves independently.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

from scaling_service.capabilities.discovery.disturbances.disturbance import Disturbance
from scaling_service.capabilities.discovery.disturbances.free_marker import FreeMarker
from scaling_service.capabilities.discovery.effects.catalogue import propose_candidates
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.evidence.scoring import score_candidates
from scaling_service.capabilities.discovery.evidence.wrench import WRENCH
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Estimate, Reweighed
from scaling_service.capabilities.discovery.search.estimation import ROUGHLY, compute_misfit, estimate
from scaling_service.capabilities.discovery.search.findings import NamedEffect
from scaling_service.capabilities.discovery.search.rivals import Name


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
