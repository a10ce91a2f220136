"""All that could be the next effect, side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scaling_service.capabilities.discovery.evidence.fitting import Account
from scaling_service.capabilities.discovery.evidence.forces import gather_forces
from scaling_service.capabilities.discovery.evidence.score import Evidence, deciding, gather
from scaling_service.capabilities.discovery.evidence.watched import Watched
from scaling_service.capabilities.discovery.laws.at_once import each
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search import catalogue
from scaling_service.capabilities.discovery.search.candidates import Candidate, FreeMotion
from scaling_service.capabilities.discovery.search.comparing import explained, no_worse, unseen
from scaling_service.capabilities.discovery.search.judging import Fitted, fit_each
from scaling_service.capabilities.discovery.search.option import Option

ALIKE = 0.05
"""Chance of so large a lead above which two candidates count as not told apart (chosen: the custom)."""


@dataclass(frozen=True, slots=True, eq=False)
class Options:
    """The best, the best first, and among how many they were chosen.

    Parameters
    ----------
    best : list of Option
    count : int
    columns : list of Option
        Those of them that are sums of columns among the markers.
    motions : list of Option
        Those that were searched for among the markers.
    watched : tuple of Watched
        The recordings that these were told from.
    """

    best: list[Option]
    count: int
    columns: list[Option]
    motions: list[Option]
    watched: tuple[Watched, ...]


def look(
    now: Account, scene: Scene, stretch_s: float, shortlist: int, before: Options | None = None
) -> Options:
    """Try everything in the catalogue at every place.

    Parameters
    ----------
    shortlist : int
        How many to try on what did not fit them.
    before : Options, optional
        From the last look; what the same motion shows among the markers is not told anew.
    """
    taken = {s.candidate.key for s in now.everything}
    every = [c for c in catalogue.candidates(scene) if c.key not in taken]

    def seen(of_forces: bool) -> tuple[list[Option], list[Option]]:
        sums = compared(now, [c for c in every if c.of_forces == of_forces], stretch_s, shortlist)
        return sums, list(catalogue.options(now, scene, stretch_s, of_forces=of_forces))

    if before is not None and before.watched is now.watched:
        columns, motions, (loads, others) = before.columns, before.motions, seen(True)
    else:
        (columns, motions), (loads, others) = each(seen, (False, True))
    searched = [*motions, *others]
    new = [o for o in searched if o.candidate.key not in taken]
    best = sorted((*columns, *loads, *new), key=lambda o: -o.fitted.expected)
    return Options(best, len(every) + len(searched), columns, motions, now.watched)


def compared(now: Account, choice: Sequence[Candidate], stretch_s: float, shortlist: int) -> list[Option]:
    """The likely ones of candidates that all show among the markers, or all in the wrench, the best first."""
    if not choice:
        return []
    of_forces, picked = choice[0].of_forces, choice
    if len(choice) > shortlist:
        rough = gathered(now, choice, stretch_s, of_forces=of_forces, together=False)
        picked = [choice[k] for k, _ in _likely(rough, choice)[:shortlist]]
    return options_of(gathered(now, picked, stretch_s, of_forces=of_forces, together=True), picked)


def gathered(
    now: Account, candidates: Sequence[Candidate], stretch_s: float, *, of_forces: bool, together: bool
) -> Evidence:
    """Candidates beside all that is known of their sort."""
    known = [s.candidate for s in now.everything if s.candidate.columns]
    known = [c for c in known if c.of_forces == of_forces]
    if of_forces:
        return gather_forces(now.weighed, known, candidates, stretch_s, together=together)
    return gather(now.watched, known, candidates, stretch_s, together=together)


def options_of(evidence: Evidence, choice: Sequence[Candidate]) -> list[Option]:
    """The likely ones of candidates whose evidence was gathered together, the best first."""
    found = []
    for k, fitted in _likely(evidence, choice):
        gains = explained(evidence, k, deciding(evidence.stretches, choice[k])).gains
        found.append(Option(choice[k], fitted, gains, unseen(evidence, k, choice[k])))
    return found


def _likely(evidence: Evidence, choice: Sequence[Candidate]) -> list[tuple[int, Fitted]]:
    """Which of them have plausible numbers, the best first."""
    fitted = fit_each(evidence, choice)
    likely = [(k, f) for k, (c, f) in enumerate(zip(choice, fitted, strict=True)) if _plausible(c, f)]
    return sorted(likely, key=lambda one: -one[1].expected)


def _plausible(candidate: Candidate, fitted: Fitted) -> bool:
    """Whether every number lies in its range, give or take its own deviation, and all do together."""
    if not len(fitted.size):
        return False
    spread = np.sqrt(np.diag(fitted.covariance))
    nearest = [
        next((x for x in (size, size - sd, size + sd) if column.plausible(x)), size)
        for column, size, sd in zip(candidate.columns, fitted.size.tolist(), spread.tolist(), strict=True)
    ]
    return catalogue.plausible(candidate, np.array(nearest))


def confusable(option: Option, others: Sequence[Option]) -> tuple[Candidate, ...]:
    """The candidates that explain what this one does so nearly as well that chance could make the difference.

    A motion that may take any course could always stand for one that follows a law, so it does not count.
    """
    if option.gains is None:
        return option.alike
    found = []
    for other in others:
        comparable = other.gains is not None and len(other.gains) == len(option.gains)
        looser = isinstance(other.candidate.change, FreeMotion) and option.candidate.change is None
        same = other.candidate.trials == option.candidate.trials
        alike = other.candidate.of_forces == option.candidate.of_forces
        if comparable and same and alike and not looser and _named_otherwise(other, option):
            assert other.gains is not None
            p = no_worse(option.gains, other.gains, option.fitted.by_chance - other.fitted.by_chance)
            if p > ALIKE:
                found.append((p, other.candidate))
    return tuple(candidate for _, candidate in sorted(found, key=lambda item: -item[0]))


def _named_otherwise(other: Option, option: Option) -> bool:
    """Whether it is another kind, place or driver, not only another frequency or direction."""
    one, two = ((c.kind, c.where, c.driver) for c in (other.candidate, option.candidate))
    return one != two
