"""Naming the likeliest, and what is kept of all that was tried."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy

from scaling_service.capabilities.discovery.effects import sizes
from scaling_service.capabilities.discovery.effects.catalogue import find_effects
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.evidence.settings import DiscoverySettings
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Contact, Estimate, Seen
from scaling_service.capabilities.discovery.observations.wrench import COMPONENTS
from scaling_service.capabilities.discovery.ordinary.forces import NOISE
from scaling_service.capabilities.discovery.result import PlacedEffect, TriedDocument
from scaling_service.capabilities.discovery.search.findings import NamedEffect
from scaling_service.capabilities.discovery.search.gaps import rms_by_place
from scaling_service.capabilities.discovery.search.leanings import OF_MODELS, Leanings
from scaling_service.capabilities.discovery.search.markers import BodyTable, Ranked
from scaling_service.core.arrays import Array
from scaling_service.core.progress import Steps

SHOWN = 30  # of what was not named (chosen)


@dataclass(frozen=True, slots=True, kw_only=True)
class Origin:
    """Where the model comes from; unless told, scaled here, for a person whose mass was not declared.

    ``given``: it was made for the person elsewhere; ``placed``: its markers' places were fitted;
    ``declared_kg``: the person's mass, if it was declared.
    """

    given: bool = False
    placed: bool = True
    declared_kg: float | None = None


@dataclass(slots=True, eq=False, kw_only=True)
class Naming:
    """What is assumed by now, and how something is named."""

    fit: Fit
    origin: Origin
    steps: Steps
    named: list[NamedEffect] = field(default_factory=list)
    refused: set[str] = field(default_factory=set)  # keys
    # by their keys: what was named and is not what is there, its place, and why
    withdrawn: dict[str, tuple[Candidate, tuple[str, ...], str]] = field(default_factory=dict)
    tried: dict[str, tuple[float, TriedDocument]] = field(default_factory=dict)  # with log odds
    covariances: dict[str, Array] = field(default_factory=dict)
    leanings: dict[str, Leanings] = field(default_factory=dict)
    last: dict[Seen, list[Ranked]] = field(default_factory=dict)  # as they were ranked last

    @property
    def settings(self) -> DiscoverySettings:
        """How strict it is."""
        return self.fit.settings

    def _name_first(
        self,
        ranked: Sequence[Ranked],
        refit: Callable[[Sequence[Estimate]], Fit],
        classes: Mapping[str, Mapping[Candidate, float]],
    ) -> bool:
        """Name the first that has the odds and does good; whether there was one."""
        taken = self.fit.by_key
        for one in ranked:
            key = one.candidate.key
            if one.odds < self.settings.odds:
                break
            if key in self.refused or key in taken:
                continue
            size, covariance = np.zeros(0), np.zeros((0, 0))
            if one.scored is not None:
                covariance = one.scored.covariance
                settled = sizes.settle_size(one.candidate, one.scored.size, covariance, self.fit.model)
                size = one.scored.size if settled is None else settled
            if not self._is_met(one.candidate, size):
                self.refused.add(key)
                continue
            effect = Estimate(one.candidate, size)
            fit = refit((*self.fit.effects, effect))
            gain, by_blocks = self._measure_gain(fit, one.candidate)
            usual = sizes.look_up_usual_sizes(one.candidate, self.fit.model)
            details = find_effects()[one.candidate.kind].details(effect, fit)
            shown = ((usual(name), value) for name, value in details.items())
            if gain is None or any(met and not met.low <= value <= met.high for met, value in shown):
                self.refused.add(key)
                continue
            self.fit = fit
            self.covariances[key] = covariance
            self.named.append(
                NamedEffect(
                    effect=effect,
                    covariance=covariance,
                    odds=one.odds,
                    gain=gain,
                    by_blocks=by_blocks,
                    equivalents=classes.get(key, {}),
                    smallest=self._find_smallest(one),
                )
            )
            return True
        return False

    def _is_met(self, candidate: Candidate, size: Array) -> bool:
        """Whether its size is one that laboratories meet; else it is something else."""
        met = sizes.is_met(candidate, size, self.fit.model)
        return met and (candidate.together is None or candidate.together(size))

    def _measure_gain(self, fit: Fit, candidate: Candidate) -> tuple[float | None, bool]:
        """Share of the squares that it takes off what did not fit it; None where anything is worse there."""
        forces = not is_of_markers(candidate)
        here = [r.trial.name for r in fit.context.recordings if candidate.holds_in(r.trial.name)]
        unseen = [
            r.trial.name for r in fit.context.recordings if r.role == "held_out" and r.trial.name in here
        ]
        trials = unseen or here
        old, new = (rms_by_place(f, trials, forces=forces) for f in (self.fit, fit))
        worst = 1.0 + self.settings.worse
        own = [w for w in candidate.where if w in old and w in new]
        if any(new[w] > worst * old[w] for w in own):
            return None, not unseen
        # Forces and moments are one wrench, each component against its everyday noise
        unit = dict(zip(COMPONENTS, NOISE, strict=True)) if forces else dict.fromkeys(old, 1.0)
        a, b = (sum((rms[p] / unit[p]) ** 2 for p in unit if p in rms) for rms in (old, new))
        gain = 1.0 - b / a if a > 0.0 else 0.0
        return (gain if gain > 0.0 else None), not unseen

    def _tell_classes(
        self, ranked: Sequence[Ranked], compare: Callable[[Ranked, Ranked], float]
    ) -> dict[str, dict[Candidate, float]]:
        """Of the first that has the odds: those that these recordings do not tell from it."""
        first = next((r for r in ranked if r.candidate.key not in self.refused), None)
        if first is None or first.odds < self.settings.odds:
            return {}
        if first.scored is None and not isinstance(first.candidate.change, Contact):
            return {}
        near = [r for r in ranked if r is not first and r.odds > first.odds - self.settings.class_odds]
        own = first.candidate
        alike = {
            r.candidate: r.odds - first.odds
            for r in near
            if (r.candidate.kind, r.candidate.where) != (own.kind, own.where)
            and abs(compare(first, r)) > self.settings.class_cosine
        }
        return {first.candidate.key: alike}

    def _find_smallest(self, one: Ranked) -> dict[str, float]:
        """Sizes of the columns, in proportion as found, from which a share would be named.

        Nothing where that is more than laboratories meet.
        """
        if one.scored is None:
            return {}
        s = one.scored
        scaled = np.eye(len(s.sd)) + s.information * np.outer(s.sd, s.sd)
        shown = s.information @ s.size
        strength = float(shown @ (s.sd * np.linalg.solve(scaled, s.sd * shown)))
        needed = self.settings.odds + (s.bayes - one.odds) + 0.5 * float(np.linalg.slogdet(scaled)[1])
        if strength <= 0.0 or needed <= 0.0:
            return {}
        z = float(scipy.stats.norm.ppf(self.settings.power))
        share = (z + math.sqrt(z * z + 2.0 * needed)) / math.sqrt(strength)
        if not self._is_met(one.candidate, share * s.size):
            return {}
        return {
            column.name: abs(column.unit * size) * share
            for column, size in zip(one.candidate.columns, s.size.tolist(), strict=True)
        }

    def _remember(self, ranked: Sequence[Ranked], square: float) -> None:
        """What was tried, as it was last, and what of the squares it would take."""
        for r in ranked[:SHOWN]:
            s = r.scored
            gain = float("nan") if s is None else float(s.size @ s.information @ s.size) / square
            document = TriedDocument(
                **dict(PlacedEffect.model_validate(r.candidate)),
                gain=gain,
                log_odds=r.odds,
                smallest_nameable=self._find_smallest(r),
            )
            self.tried[r.candidate.key] = r.odds, document
        for r in ranked:
            if r.scored is not None and r.candidate.kind in OF_MODELS and not r.candidate.trials:
                s = r.scored
                self.leanings[r.candidate.key] = Leanings.of(r.candidate, s.size, s.covariance, s.sd)

    def list_standing(self) -> list[Ranked]:
        """What has the odds and was refused: of a size that nobody meets, or worse on unseen recordings."""
        every = [r for ranked in self.last.values() for r in ranked]
        refused = self.refused - self.withdrawn.keys()
        return [r for r in every if r.odds >= self.settings.odds and r.candidate.key in refused]

    def _withdraw(self, one: NamedEffect, reason: str, where: tuple[str, ...] = ()) -> None:
        """Take an effect out of what is named; recordings are not tracked anew."""
        self.withdrawn[one.key] = one.candidate, where or one.candidate.where, reason
        self._forget(one.key)

    def _forget(self, key: str) -> None:
        self.refused.add(key)
        self.named = [n for n in self.named if n.key != key]

    def join_leanings(self, body: BodyTable) -> Leanings:
        """What the recordings say of every effect of the model, named or not; of the body's together."""
        taken = self.fit.by_key
        for key, effect in taken.items():
            sd = sizes.list_usual_deviations(effect.candidate, self.fit.model)
            if key in self.leanings and sd is not None:
                self.leanings[key] = Leanings.of(effect.candidate, effect.size, self.covariances[key], sd)
        together = body.lean(self.leanings.keys() - taken.keys())
        known = {c.key for c in together.candidates}
        return Leanings.join([together, *(one for key, one in self.leanings.items() if key not in known)])


def is_of_forces(candidate: Candidate) -> bool:
    """Whether a candidate is a sum of columns of the wrench."""
    return bool(candidate.columns) and all(column.load is not None for column in candidate.columns)


def is_of_markers(candidate: Candidate) -> bool:
    """Whether a candidate shows among the markers."""
    return candidate.seen_in == "markers"
