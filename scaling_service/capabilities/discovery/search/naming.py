"""Naming, the likeliest first: labels, then the body and its markers, then the weight and the forces.

Nothing is named whose own places, or whose forces or markers as a whole, are worse with it on what did not
fit it.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy

from scaling_service.capabilities.discovery.effects.body_mass import question_mass
from scaling_service.capabilities.discovery.effects.catalogue import propose_candidates
from scaling_service.capabilities.discovery.effects.external_contact import find_contacts
from scaling_service.capabilities.discovery.effects.marker_swap import find_exchange
from scaling_service.capabilities.discovery.effects.sizes import is_met, list_usual_deviations
from scaling_service.capabilities.discovery.evidence.fit import Fit, fit_recordings, fit_wrenches
from scaling_service.capabilities.discovery.evidence.settings import DiscoverySettings
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Estimate, Reweighed
from scaling_service.capabilities.discovery.observations.wrench import COMPONENTS
from scaling_service.capabilities.discovery.ordinary.forces import (
    Evidence,
    Loads,
    WrenchTable,
    measure_noise,
    score_loads,
)
from scaling_service.capabilities.discovery.ordinary.odds import Scored
from scaling_service.capabilities.discovery.search.findings import Tried
from scaling_service.capabilities.discovery.search.gaps import rms_by_place
from scaling_service.capabilities.discovery.search.markers import BodyTable, Ranked
from scaling_service.core.progress import Steps
from scaling_service.core.threads import map_parallel
from scaling_service.numerics.multibody.laws import Array

LABELS, BODY, FORCES = 0.1, 0.6, 0.9  # of the work, where its parts end (chosen)
_MOVED = 0.3  # deviations by which sizes must move to be worth tracking anew (chosen)
SHOWN = 30  # of what was not named (chosen)


@dataclass(frozen=True, slots=True, kw_only=True)
class Origin:
    """Where the model comes from.

    ``given``: it was made for the person elsewhere; ``placed``: its markers' places were fitted;
    ``declared_kg``: the person's mass, if it was declared.
    """

    given: bool = False
    placed: bool = True
    declared_kg: float | None = None


SCALED_HERE = Origin()
"""A model with fitted markers, of a person whose mass was not declared."""


@dataclass(slots=True, eq=False, kw_only=True)
class Named:
    """What was named so far."""

    ranked: Ranked
    gain: float
    by_blocks: bool
    equivalents: Mapping[Candidate, float]
    smallest: Mapping[str, float]


@dataclass(slots=True, eq=False, kw_only=True)
class Search:
    """What is assumed by now."""

    fit: Fit
    origin: Origin
    steps: Steps
    named: list[Named] = field(default_factory=list)
    refused: set[str] = field(default_factory=set)  # keys
    tried: dict[str, Tried] = field(default_factory=dict)
    covariances: dict[str, Array] = field(default_factory=dict)
    reason: str = ""

    @property
    def settings(self) -> DiscoverySettings:
        """How strict it is."""
        return self.fit.settings

    # Labels

    def find_labels(self) -> None:
        """Exchanges, one after the other, before anything else is believed of the markers."""
        self.steps.begin("looking for exchanged labels", 0.0, LABELS)
        for _ in range(self.settings.most):
            found = [one for one in map_parallel(find_exchange, self.fit.tracked) if one is not None]
            ranked = sorted((Ranked(odds, c) for odds, c in found), key=lambda one: -one.odds)
            if not self._name_first(ranked, self._refit_markers, {}):
                break

    # The body

    def search_body(self) -> BodyTable:
        """Until nothing of the body and its markers stands out; the last table."""
        for count in range(self.settings.most + 1):
            share = LABELS + (BODY - LABELS) * count / self.settings.most
            self.steps.begin(f"looking for effect {len(self.named) + 1}", share, BODY)
            body = self._make_table()
            ranked = body.rank()
            self._remember(ranked, sum(s.square for s in body.table.sums))
            if count == self.settings.most:
                break
            chosen = self._reorder(body, ranked)
            classes = self._tell_classes(chosen, body.compare)
            if not self._name_first(chosen, self._refit_markers, classes):
                break
        return body

    def _make_table(self) -> BodyTable:
        """With all sizes estimated together; tracked once more where they moved."""
        body = self._tabulate(self.fit)
        again = body.reestimate()
        self.covariances |= {e.candidate.key: covariance for e, covariance in again}
        unmet = [e for e, _ in again if not is_met(e.candidate, e.size, self.fit.model)]
        if unmet:  # it grew out of what laboratories meet: it is something else
            self._take_back(unmet[0].candidate.key)
            return self._make_table()
        moved = {e.candidate.key: e for e, c in again if self._has_moved(e, c)}
        if not moved:
            return body
        effects = tuple(moved.get(e.candidate.key, e) for e in self.fit.effects)
        self.fit = self._refit_markers(effects)
        return self._tabulate(self.fit, body)

    def _take_back(self, key: str) -> None:
        """An effect of the body, for good."""
        self.refused.add(key)
        self.named = [n for n in self.named if n.ranked.candidate.key != key]
        self.fit = self._refit_markers([e for e in self.fit.effects if e.candidate.key != key])

    def _has_moved(self, effect: Estimate, covariance: Array) -> bool:
        before = next(e for e in self.fit.effects if e.candidate.key == effect.candidate.key)
        sd = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
        return bool((np.abs(effect.size - before.size) > _MOVED * sd).any())

    def _tabulate(self, fit: Fit, like: BodyTable | None = None) -> BodyTable:
        return BodyTable.of(fit, given=self.origin.given, placed=self.origin.placed, like=like)

    def _reorder(self, body: BodyTable, ranked: list[Ranked]) -> list[Ranked]:
        """With the first and what has the odds at the same place compared once more, as tracked with each.

        One step of a linear table does not tell a turned axis from a law that follows the angle.
        """
        first = next((r for r in ranked if r.candidate.key not in self.refused), None)
        if first is None or first.odds < self.settings.odds or first.scored is None:
            return ranked
        rivals = {
            r.candidate.kind: r
            for r in reversed(ranked)
            if r.odds >= self.settings.odds
            and r.scored is not None
            and self._is_rival(r.candidate, first.candidate)
        }
        if len(rivals) < 2:
            return ranked
        found = {}
        for r in rivals.values():
            assert r.scored is not None
            fit = self._refit_markers((*self.fit.effects, Estimate(r.candidate, r.scored.size)))
            prior = r.odds - r.scored.bayes  # of its kind and places
            found[r.candidate.key] = self._tabulate(fit, body).table.evidence + prior
        top = max(found.values())
        untold = [r for r in rivals.values() if found[r.candidate.key] > top - self.settings.class_odds]
        # Of those that the recordings do not tell apart, what is constant comes before what follows an angle
        best = min(untold, key=lambda r: (len(r.candidate.driver), -found[r.candidate.key])).candidate.key
        lead = first.odds
        return sorted(
            (
                replace(r, odds=lead + found[r.candidate.key] - top) if r.candidate.key in found else r
                for r in ranked
            ),
            key=lambda r: (r.candidate.key != best, -r.odds),
        )

    def _is_rival(self, one: Candidate, first: Candidate) -> bool:
        """Whether two sit at the same place in the same recordings."""
        same = bool(set(one.where) & set(first.where)) and one.trials == first.trials
        return same and one.key not in self.refused

    def _refit_markers(self, effects: Sequence[Estimate]) -> Fit:
        return fit_recordings(self.fit.context, effects, self.fit)

    # Forces

    def search_forces(self) -> tuple[WrenchTable, Evidence] | None:
        """The weight, and then what stands out of the forces; the last table."""
        if not self.fit.wrenches or not self.fit.scene.plates:
            return None
        mass = question_mass(self.fit, self.origin.declared_kg)
        if mass is not None:
            assert isinstance(mass.change, Reweighed)
            z = (mass.change.factor - 1.0) / max(mass.change.sd, 1e-6)
            self._name_first([Ranked(0.5 * z * z, mass)], self._refit_forces, {})
        for count in range(self.settings.most + 1):
            share = BODY + (FORCES - BODY) * count / self.settings.most
            self.steps.begin(f"looking for effect {len(self.named) + 1}", share, FORCES)
            loads, ranked = self._rank_forces()
            self._remember(ranked, loads.square)
            if count == self.settings.most:
                break
            classes = self._tell_classes(ranked, Alike(loads, [c for c, _ in self._list_loads()]))
            if not self._name_first(ranked, self._refit_forces, classes):
                break
        return loads.table, loads.none

    def _list_loads(self) -> list[tuple[Candidate, Array]]:
        pairs = [
            (c, list_usual_deviations(c, self.fit.model))
            for c in propose_candidates(self.fit.scene)
            if is_of_forces(c)
        ]
        return [(c, sd) for c, sd in pairs if sd is not None]

    def _rank_forces(self) -> tuple[Loads, list[Ranked]]:
        """All candidates of the wrench, those named estimated together."""
        choice = self._list_loads()
        named = [
            (e, sd)
            for e in self.fit.effects
            if is_of_forces(e.candidate)
            and (sd := list_usual_deviations(e.candidate, self.fit.model)) is not None
        ]
        loads = score_loads(self.fit, choice, named)
        self.covariances |= {e.candidate.key: covariance for e, covariance in loads.named}
        moved = {e.candidate.key: e for e, c in loads.named if self._has_moved(e, c)}
        if moved:
            self.fit = self._refit_forces([moved.get(e.candidate.key, e) for e in self.fit.effects])
        places = Counter(c.kind for c, _ in choice)
        ranked = [
            Ranked(s.bayes - math.log(places[c.kind]), c, s)
            for (c, _), s in zip(choice, loads.scored, strict=True)
        ]
        # A contact that nothing measured is noise to all others; beside it noise is ordinary at most
        raised = bool((loads.none.levels > 1.0).any())
        lead = loads.none.value - loads.none.unlearnt if raised else 0.0
        noise = measure_noise(loads.table, np.ones(6) if raised else loads.none.levels)
        ranked += [Ranked(odds - lead, c) for odds, c in find_contacts(self.fit, noise)]
        return loads, sorted(ranked, key=lambda one: -one.odds)

    def _refit_forces(self, effects: Sequence[Estimate]) -> Fit:
        return fit_wrenches(replace(self.fit, effects=tuple(effects)))

    # Naming

    def _name_first(
        self,
        ranked: Sequence[Ranked],
        refit: Callable[[Sequence[Estimate]], Fit],
        classes: Mapping[str, Mapping[Candidate, float]],
    ) -> bool:
        """Name the first that has the odds and does good; whether there was one."""
        taken = {e.candidate.key for e in self.fit.effects}
        for one in ranked:
            key = one.candidate.key
            if one.odds < self.settings.odds:
                break
            if key in self.refused or key in taken:
                continue
            size = np.zeros(0) if one.scored is None else one.scored.size
            if one.scored is not None and not self._is_met(one.candidate, one.scored):
                self.refused.add(key)
                continue
            fit = refit((*self.fit.effects, Estimate(one.candidate, size)))
            gain, by_blocks = self._measure_gain(fit, one.candidate)
            if gain is None:
                self.refused.add(key)
                continue
            self.fit = fit
            self.covariances[key] = np.zeros((0, 0)) if one.scored is None else one.scored.covariance
            self.named.append(
                Named(
                    ranked=one,
                    gain=gain,
                    by_blocks=by_blocks,
                    equivalents=classes.get(key, {}),
                    smallest=self._find_smallest(one),
                )
            )
            return True
        return False

    def _is_met(self, candidate: Candidate, scored: Scored) -> bool:
        """Whether its size is one that laboratories meet; else it is something else."""
        met = is_met(candidate, scored.size, self.fit.model)
        return met and (candidate.together is None or candidate.together(scored.size))

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
        groups = (COMPONENTS[:3], COMPONENTS[3:]) if forces else (tuple(old),)
        gains, fell = [], []
        for group in groups:
            a, b = (sum(rms[p] ** 2 for p in group if p in rms) for rms in (old, new))
            fell.append(b <= worst**2 * a)
            gains.append(1.0 - b / a if a > 0.0 else 0.0)
        return (max(gains) if all(fell) and max(gains) > 0.0 else None), not unseen

    def _tell_classes(
        self, ranked: Sequence[Ranked], compare: Callable[[Ranked, Ranked], float]
    ) -> dict[str, dict[Candidate, float]]:
        """Of the first that has the odds: those that these recordings do not tell from it."""
        first = next((r for r in ranked if r.candidate.key not in self.refused), None)
        if first is None or first.odds < self.settings.odds or first.scored is None:
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
        """Sizes of the columns, in proportion as found, from which a share would be named."""
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
        return {
            column.name: abs(column.unit * size) * share
            for column, size in zip(one.candidate.columns, s.size.tolist(), strict=True)
        }

    def _remember(self, ranked: Sequence[Ranked], square: float) -> None:
        """What was tried, as it was last, and what of the squares it would take."""
        for r in ranked[:SHOWN]:
            s = r.scored
            gain = float("nan") if s is None else float(s.size @ s.information @ s.size) / square
            self.tried[r.candidate.key] = Tried(candidate=r.candidate, odds=r.odds, gain=gain)


def is_of_forces(candidate: Candidate) -> bool:
    """Whether a candidate is a sum of columns of the wrench."""
    return bool(candidate.columns) and all(column.load is not None for column in candidate.columns)


def is_of_markers(candidate: Candidate) -> bool:
    """Whether a candidate shows among the markers."""
    return candidate.seen_in == "markers"


@dataclass(frozen=True, slots=True, eq=False)
class Alike:
    """Cosine between what two candidates of the wrench explain, as they were found."""

    loads: Loads
    choice: Sequence[Candidate]

    def __call__(self, one: Ranked, other: Ranked) -> float:
        """0 of what has no columns."""
        if one.scored is None or other.scored is None:
            return 0.0
        table, keys = self.loads.table, [c.key for c in self.choice]
        scale = np.sqrt(table.weight) / (table.sd * self.loads.none.levels)
        a, b = (
            (scale * table.explain(table.numbers[keys.index(r.candidate.key)], s.size)).ravel()
            for r, s in ((one, one.scored), (other, other.scored))
        )
        return float(a @ b / math.sqrt(max(float(a @ a) * float(b @ b), 1e-300)))
