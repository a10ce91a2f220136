"""What persons say together of effects of the model that they may share.

Every person's recordings say something of every effect, the person's own part of it integrated out: scores x
and products X of all numbers together. What all share has the sums of both, so that a tendency that nobody
shows beyond what is ordinary is told where many show it. A generic model is the mirror image of itself: what
it has wrong on one side it has wrong on the other, and both legs of a person speak for the same numbers.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.discovery.evidence.fit import fit_recordings
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Estimate
from scaling_service.capabilities.discovery.mirror import flip_name, mirror_numbers
from scaling_service.capabilities.discovery.ordinary.odds import Scored
from scaling_service.capabilities.discovery.result import DiscoverResults
from scaling_service.capabilities.discovery.search.findings import UNITS
from scaling_service.capabilities.discovery.search.gaps import PARTS, rms_by_place
from scaling_service.core.arrays import Array
from scaling_service.model.body import BodyModel

FEWEST = 2  # persons


@dataclass(frozen=True, slots=True, eq=False)
class Shared:
    """Numbers that persons share: of an effect at one place, or alike at both sides."""

    candidate: Candidate  # as the first person has it; of the right where there are two
    sd: Array  # (k,): prior deviations
    sides: Mapping[str, Array]  # key of a candidate to its numbers by the shared ones, (k, k)

    @property
    def where(self) -> list[str]:
        """Its place, or both."""
        own = list(self.candidate.where)
        return own if len(self.sides) < 2 else [*own, *map(flip_name, own)]

    def place(self, candidates: Sequence[Candidate], model: BodyModel, size: Array) -> list[Estimate]:
        """What it is in one model, of those candidates."""
        own = [c for c in candidates if c.key in self.sides]
        return [Estimate(c, self.sides[c.key] @ size * measure_unit(c, model)) for c in own]


def measure_unit(candidate: Candidate, model: BodyModel) -> float:
    """What one of the shared numbers is in a model: of a segment's mass, which are shares, that mass."""
    return model.segment(candidate.where[0]).mass if candidate.kind == "segment_mass" else 1.0


def list_shared(found: Sequence[DiscoverResults]) -> list[Shared]:
    """All effects that two persons or more say something of."""
    count, shared = Counter(c.key for results in found for c in results.leanings.candidates), list[Shared]()
    for results in found:
        model, own = results.before.model, results.leanings
        by_place = {(c.kind, c.where, c.driver, c.note): c for c in own.candidates}
        for candidate, at in own.rows():
            if count[candidate.key] < FEWEST or any(candidate.key in one.sides for one in shared):
                continue
            sd = own.sd[at] / measure_unit(candidate, model)
            where, driver = (tuple(map(flip_name, names)) for names in (candidate.where, candidate.driver))
            other = by_place.get((candidate.kind, where, driver, candidate.note), candidate)
            right, left = sorted((candidate, other), key=lambda c: c.where[0].endswith("_l"))
            turn = mirror_numbers(right, left, model) if left is not right else None
            if turn is None:
                shared.append(Shared(candidate, sd, {candidate.key: np.eye(len(sd))}))
            else:
                shared.append(Shared(right, sd, {right.key: np.eye(len(sd)), left.key: turn}))
    return shared


def pool(results: DiscoverResults, shared: Sequence[Shared]) -> tuple[Array, Array]:
    """Scores (n,) and products (n, n) that one person's recordings have of all shared numbers together."""
    own, edges = results.leanings, np.cumsum([0, *(len(one.sd) for one in shared)])
    turn = np.zeros((len(own.score), edges[-1]))
    for candidate, rows in own.rows():
        for k, one in enumerate(shared):
            if candidate.key in one.sides:
                unit = measure_unit(candidate, results.before.model)
                turn[rows, edges[k] : edges[k + 1]] = unit * one.sides[candidate.key]
    return turn.T @ own.score, turn.T @ own.information @ turn


@dataclass(frozen=True, slots=True, eq=False)
class Pooled:
    """What persons say together of what they may share."""

    shared: Sequence[Shared]
    said: Mapping[str, tuple[Array, Array]]  # by person: scores and products

    def weigh(self, chosen: Sequence[int], without: str = "") -> Scored:
        """Some effects together against nothing, by all persons but one."""
        at, said = self._find_rows(chosen), [one for who, one in self.said.items() if who != without]
        x, X = (np.sum(parts, axis=0) for parts in zip(*said, strict=True))
        sd = np.concatenate([np.zeros(0), *(self.shared[k].sd for k in chosen)])
        return Scored.of(x[at], X[np.ix_(at, at)], sd)

    def list_odds(self, named: Sequence[int]) -> dict[int, float]:
        """Log odds of everything beside what is named, the number of its places counted."""
        places, known = Counter(one.candidate.kind for one in self.shared), self.weigh(named).bayes
        return {
            k: self.weigh([*named, k]).bayes - known - math.log(places[one.candidate.kind])
            for k, one in enumerate(self.shared)
            if k not in named
        }

    def is_of_many(self, k: int, named: Sequence[int]) -> bool:
        """Whether an effect is likelier than not without the person who speaks loudest for it."""
        loudest = max(self.said, key=lambda who: self.ask(who, [*named, k], named))
        return self.weigh([*named, k], loudest).bayes > self.weigh(named, loudest).bayes

    def ask(self, person: str, chosen: Sequence[int], without: Sequence[int] = ()) -> float:
        """By how much one person's recordings are likelier with the shared sizes of some than of fewer."""
        x, X = self.said[person]
        values = []
        for some in (chosen, without):
            size, at = self.weigh(some).size, self._find_rows(some)
            values.append(float(x[at] @ size - 0.5 * size @ X[np.ix_(at, at)] @ size))
        return values[0] - values[1]

    def split(self, chosen: Sequence[int]) -> list[tuple[Shared, Array, Array]]:
        """Some effects with their sizes (k,) and deviations (k,), estimated together."""
        together, found, at = self.weigh(chosen), [], 0
        sds = np.sqrt(np.diag(together.covariance))
        for k in chosen:
            rows = slice(at, at := at + len(self.shared[k].sd))
            found.append((self.shared[k], together.size[rows], sds[rows]))
        return found

    def _find_rows(self, chosen: Sequence[int]) -> NDArray[np.intp]:
        edges = np.cumsum([0, *(len(one.sd) for one in self.shared)])
        return np.concatenate([np.arange(0), *(np.arange(edges[k], edges[k + 1]) for k in chosen)])

    def refit(self, results: DiscoverResults, chosen: Sequence[int]) -> dict[str, float]:
        """RMS of what is left in one person's recordings that did not fit, with the shared sizes of some."""
        keys = {key for one in self.shared for key in one.sides}
        effects = [e for e in results.after.effects if e.candidate.key not in keys]
        for one, size, _ in self.split(chosen):
            effects += one.place(results.leanings.candidates, results.before.model, size)
        fit = fit_recordings(results.after.context, effects, results.after)
        unseen = [item.name for item in fit.tracked if item.role == "held_out"]
        trials, left = unseen or [item.name for item in fit.tracked], {}
        for observable, (name, part) in PARTS.items():
            rms = rms_by_place(fit, trials, forces=observable != "marker")
            if shown := list(rms.values())[part]:
                left[name] = UNITS[observable][1] * math.sqrt(np.mean(np.square(shown)))
        return left
