"""The search, second half: the forces, once labels and body are found."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from scaling_service.capabilities.discovery.effects.body_mass import (
    balance_weight,
    find_usual_mass,
    make_candidate,
)
from scaling_service.capabilities.discovery.effects.catalogue import propose_candidates
from scaling_service.capabilities.discovery.effects.external_contact import find_contacts, make_touch
from scaling_service.capabilities.discovery.effects.sizes import is_met, list_usual_deviations
from scaling_service.capabilities.discovery.evidence.fit import Fit, fit_wrenches
from scaling_service.capabilities.discovery.laws.candidates import (
    Candidate,
    Contact,
    Estimate,
    Reweighed,
)
from scaling_service.capabilities.discovery.observations.wrench import COMPONENTS
from scaling_service.capabilities.discovery.ordinary.forces import NOISE, ForceEvidence, Touch, WrenchTable
from scaling_service.capabilities.discovery.ordinary.loads import Loads, score_loads
from scaling_service.capabilities.discovery.ordinary.odds import Scored
from scaling_service.capabilities.discovery.ordinary.witnesses import hear_declared, hear_sum
from scaling_service.capabilities.discovery.search import body as body_search
from scaling_service.capabilities.discovery.search.findings import NamedEffect
from scaling_service.capabilities.discovery.search.gaps import rms_by_place
from scaling_service.capabilities.discovery.search.instruments import Prior, find_misreading
from scaling_service.capabilities.discovery.search.markers import Ranked
from scaling_service.capabilities.discovery.search.naming import is_of_forces, is_of_markers
from scaling_service.capabilities.dynamics.weight import Weight
from scaling_service.core.arrays import Array
from scaling_service.model.inertia import sum_mass

LOAD, MASS = "carried_load", "segment_mass"
FORCES = 0.9  # of the work, where it ends (chosen)
GROWN = "most like {}, but of a size that nobody meets"
UNWEIGHED = "most like {}, but a plate that bears it is not explained"
MISREAD = "its readings are off as by no fault that is known; most simply, {}"
UNLIKE = "in {} it is off between {:.2f} and {:.2f} s by more than elsewhere, as by no touch of the body"


@dataclass(slots=True, eq=False, kw_only=True)
class Search(body_search.BodySearch):
    """Labels, body and forces, one after the other."""

    misread: list[tuple[Prior, str]] = field(default_factory=list)  # plates, and how in words
    together: dict[str, float] = field(default_factory=dict)  # log odds of touches with others of a segment
    # by their keys, as what is withdrawn: touches that explain less than forces that disagree in whatever way
    unlike: dict[str, tuple[Candidate, tuple[str, ...], str]] = field(default_factory=dict)

    def search_forces(self) -> tuple[WrenchTable, ForceEvidence] | None:
        """What stands out of the forces; the last table."""
        if not self.fit.wrenches or not self.fit.scene.plates:
            return None
        for count in range(self.settings.most + 1):
            share = body_search.BODY + (FORCES - body_search.BODY) * count / self.settings.most
            self.steps.begin(f"looking for effect {len(self.named) + 1}", share, FORCES)
            loads, ranked = self._rank_forces()
            self.last["wrench"] = ranked
            self._remember(ranked, loads.square)
            if count == self.settings.most:
                break
            ranked = [r for r in ranked if r.odds > self.distorted]
            if self._find_misread(ranked):
                continue
            classes = self._tell_classes(ranked, partial(compare_loads, loads))
            if not self._name_first(ranked, self._refit_forces, classes):
                break
        return self._withdraw_of_forces(loads)

    def _withdraw_of_forces(self, loads: Loads) -> tuple[WrenchTable, ForceEvidence]:
        """Without what changes in the course of a recording, has grown out of what is met, or is one of many.

        What was named after it was found in what it left, and goes with it. With what is like nothing known.
        """
        if self.distorted == -math.inf:
            self.withdrawn |= self.unlike
        for (candidate, _), how in self.misread:
            self.withdrawn[candidate.key] = candidate, candidate.where, MISREAD.format(how)
        ours, sizes = [n for n in self.named if not is_of_markers(n.candidate)], self.fit.by_key
        lively = _find_lively(loads, self.settings.unexplained)
        alike = Counter((one.candidate.kind, one.candidate.where) for one in ours)  # in one recording or more
        for k, one in enumerate(ours):
            of_forces, sd = is_of_forces(one.candidate), list_usual_deviations(one.candidate, self.fit.model)
            where: tuple[str, ...] = ()
            if self.astray & set(one.candidate.where):
                reason = body_search.CARRIED
            elif of_forces and not is_met(one.candidate, sizes[one.key].size, self.fit.model):
                reason = GROWN
            elif lively and self._find_most(one) in lively:
                reason = body_search.LIVELY
            elif of_forces and (
                (one.candidate.trials and alike[one.candidate.kind, one.candidate.where] > 1)
                or (sd is not None and loads.score_drift(sizes[one.key], sd) > self.settings.odds)
            ):
                reason = body_search.DRIFTS
            elif len(one.equivalents) >= body_search.MANY:
                reason, where = body_search.ONE_OF_MANY, (self._find_most(one),)
            else:
                continue
            self._withdraw(one, reason, where)
            later = {n.key for n in ours[k:]}
            for key in later:
                self._forget(key)
            self.fit = self._refit_forces(self.fit.without(later).effects)
            loads, self.last["wrench"] = self._rank_forces()
            break
        unexplained = {w for _, where, _ in self.withdrawn.values() for w in where}
        plates = tuple(plate for plate in self.fit.scene.plates if plate in unexplained)
        weighed = [one for one in self.named if isinstance(one.candidate.change, Reweighed)] if plates else []
        for one in weighed:
            self._withdraw(one, UNWEIGHED, plates)
            self.fit = self._refit_forces(self.fit.without({one.key}).effects)
            loads, self.last["wrench"] = self._rank_forces()
        return loads.table, loads.none

    def _find_most(self, one: NamedEffect) -> str:
        """The component of the wrench that an effect changes most, in what is ordinary of each."""
        fit = self._refit_forces(self.fit.without({one.key}).effects)
        trials = [item.name for item in fit.wrenches if one.candidate.holds_in(item.name)]
        before, after = (rms_by_place(f, trials, forces=True) for f in (fit, self.fit))
        return max(before, key=lambda c: (before[c] ** 2 - after[c] ** 2) / NOISE[COMPONENTS.index(c)] ** 2)

    def _find_misread(self, ranked: Sequence[Ranked]) -> bool:
        """Whether a plate that reads as by no known fault is likelier than all that could be named.

        What was named of that plate is taken back.
        """
        passed = self.refused | self.fit.by_key.keys()
        odds = {r.candidate.key: r.odds for r in ranked if r.odds >= self.settings.odds}
        best = max((self.together.get(key, odds[key]) for key in odds.keys() - passed), default=None)
        if best is None:
            return False
        known = [prior for prior, _ in self.misread]
        found = find_misreading(self.fit, self._list_named_loads(), known, self._list_touching())
        if found is None or found[0] <= best:
            return False
        _, prior, how = found
        self.misread.append((prior, how))
        taken = {n.key for n in self.named if n.candidate.where == prior[0].where}
        for key in taken:
            self._forget(key)
        if taken:
            self.fit = self._refit_forces(self.fit.without(taken).effects)
        return True

    def _list_named_loads(self) -> list[tuple[Estimate, Array]]:
        """What is named of the wrench, with the prior deviations of its numbers."""
        return [
            (e, sd)
            for e in self.fit.effects
            if is_of_forces(e.candidate)
            and (sd := list_usual_deviations(e.candidate, self.fit.model)) is not None
        ]

    def _list_touching(self) -> list[Touch]:
        """Touches that are named."""
        named = (e.candidate for e in self.fit.effects)
        return [make_touch(self.fit, c) for c in named if isinstance(c.change, Contact)]

    def _rank_forces(self) -> tuple[Loads, list[Ranked]]:
        """All candidates of the wrench, those named estimated together."""
        model, misread = self.fit.model, [prior for prior, _ in self.misread]
        unlike = {candidate.where for candidate, _ in misread}
        choice = [
            (c, sd)
            for c in propose_candidates(self.fit.scene)
            if is_of_forces(c) and c.where not in unlike
            if (sd := list_usual_deviations(c, model)) is not None
        ]
        weight = balance_weight(self.fit)
        weighed = self._is_weighed()
        contacts: list[tuple[float, Candidate]] = []

        def list_touches(noise: Mapping[str, Array]) -> list[Touch]:
            contacts.extend(find_contacts(self.fit, noise))
            return [make_touch(self.fit, candidate) for _, candidate in contacts]

        loads = score_loads(
            self.fit,
            choice,
            self._list_named_loads(),
            misread,
            mass_sd=find_usual_mass(self.fit.model),
            weighed=weighed,
            each=weight is not None and weight.disagree,
            touching=self._list_touching(),
            touches=list_touches,
        )
        if effects := self._move(self._settle(loads.named)):
            self.fit = self._refit_forces(effects)
        places = Counter(c.kind for c, _ in choice)
        ranked = [
            Ranked(s.bayes - math.log(places[c.kind]), c, s)
            for (c, _), s in zip(choice, self._hear_declared(choice, loads, weight), strict=True)
        ]
        self.unlike = {}
        for touched, (prior, candidate) in zip(loads.touched, contacts, strict=True):
            told = touched.beyond + prior >= self.settings.odds
            ranked.append(Ranked((touched.bayes if told else touched.beyond) + prior, candidate))
            self.together[candidate.key] = touched.together + prior
            if touched.bayes + prior >= self.settings.odds and not told:
                self._keep_unlike(candidate)
        ranked.sort(key=lambda one: -one.odds)
        declared = None if weighed else self.origin.declared_kg
        mass = None if declared is None else make_candidate(self.fit, declared)
        if mass is not None and weight is not None:
            of_mass = Ranked(loads.mass, mass)
            likely = of_mass.odds >= self.settings.odds
            at = place_mass(ranked, of_mass, disagree=weight.disagree) if likely else len(ranked)
            ranked.insert(at, of_mass)
        return loads, ranked

    def _keep_unlike(self, candidate: Candidate) -> None:
        """What a touch would explain, and forces that disagree there in whatever way explain better."""
        contact = candidate.change
        assert isinstance(contact, Contact)
        item = next(w for w in self.fit.wrenches if candidate.holds_in(w.name))
        inside = item.usable & (item.times >= contact.start_s) & (item.times <= contact.end_s)
        most = np.square(item.residuals[inside] / np.array(contact.noise)).mean(axis=0).argmax()
        reason = UNLIKE.format(item.name, contact.start_s, contact.end_s)
        self.unlike[candidate.key] = candidate, (COMPONENTS[most],), reason

    def _hear_declared(
        self, choice: Sequence[tuple[Candidate, Array]], loads: Loads, weight: Weight | None
    ) -> list[Scored]:
        """Candidates of the wrench, loads and segments with the declared mass as a further reading."""
        declared = self.origin.declared_kg
        if weight is None or declared is None:
            return list(loads.scored)
        of = {LOAD: 0.0, MASS: 0.0}
        for e in self.fit.effects:
            if e.candidate.kind in of:
                of[e.candidate.kind] += float(e.size[0])
        model, found = sum_mass(self.fit.model) + of[MASS], []
        for (c, _), s in zip(choice, loads.scored, strict=True):
            if c.kind == LOAD:
                s = hear_declared(s, borne_kg=weight.plates_kg - of[LOAD], declared_kg=declared)
            elif c.kind == MASS and not self._is_weighed():
                s = hear_sum(s, model_kg=model, declared_kg=declared)
            found.append(s)
        return found

    def _is_weighed(self) -> bool:
        """Whether the model weighs what the plates bear by now."""
        return any(isinstance(e.candidate.change, Reweighed) for e in self.fit.effects)

    def _refit_forces(self, effects: Sequence[Estimate]) -> Fit:
        return fit_wrenches(replace(self.fit, effects=tuple(effects)))


def _find_lively(loads: Loads, limit: float) -> set[str]:
    """Components of the wrench that are livelier than usual, by so many deviations."""
    most = loads.table.rate_levels(loads.none).max(axis=0)
    return {COMPONENTS[k] for k in np.flatnonzero(most > limit)}


def place_mass(ranked: Sequence[Ranked], mass: Ranked, *, disagree: bool) -> int:
    """Where the body's mass stands among candidates in the order of their odds.

    Where recordings disagree about it, it is one number with the gains and biases of single recordings'
    plates, and comes before them.
    """
    at = bisect_left(ranked, -mass.odds, key=lambda one: -one.odds)
    if not disagree:
        return at
    before = enumerate(r.candidate for r in ranked[:at])
    return next((k for k, c in before if c.kind != MASS and c.trials), at)


def compare_loads(loads: Loads, one: Ranked, other: Ranked) -> float:
    """Cosine between what two candidates of the wrench explain, as they were found; 0 without columns.

    Touches of one recording may take any course, so that they explain the same.
    """
    if isinstance(one.candidate.change, Contact) and isinstance(other.candidate.change, Contact):
        return float(one.candidate.trials == other.candidate.trials)
    if one.scored is None or other.scored is None:
        return 0.0
    table, scale = loads.table, loads.table.scale(loads.none.levels)
    a, b = (
        (scale * table.explain(loads.number(r.candidate), s.size)).ravel()
        for r, s in ((one, one.scored), (other, other.scored))
    )
    return float(a @ b / math.sqrt(max(float(a @ a) * float(b @ b), 1e-300)))
