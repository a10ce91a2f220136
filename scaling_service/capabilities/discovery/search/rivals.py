"""Names that were given early, compared with their rivals again once more is known.

The first name is given while everything else is still missing, and what is missing may have spoken for the
wrong place. With the others known, another candidate may explain clearly more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from scaling_service.capabilities.discovery.effects.catalogue import search_effects
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.evidence.scoring import ScoredCandidate
from scaling_service.capabilities.discovery.evidence.settings import DiscoverySettings
from scaling_service.capabilities.discovery.evidence.statistics import assess_lead
from scaling_service.capabilities.discovery.evidence.wrench import OBSERVATIONS, WRENCH
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Contact
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
from scaling_service.capabilities.discovery.search.testing import in_range

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
