"""The search itself: labels, then the body and its markers, then the forces."""

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
from scaling_service.capabilities.discovery.effects.marker_swap import find_exchanges
from scaling_service.capabilities.discovery.effects.sizes import is_met, list_usual_deviations, settle_size
from scaling_service.capabilities.discovery.evidence.fit import Fit, fit_recordings, fit_wrenches
from scaling_service.capabilities.discovery.laws.candidates import (
    Candidate,
    Contact,
    Estimate,
    Exchange,
    Reweighed,
    Swinging,
)
from scaling_service.capabilities.discovery.observations.wrench import COMPONENTS
from scaling_service.capabilities.discovery.ordinary.forces import NOISE, ForceEvidence, Touch, WrenchTable
from scaling_service.capabilities.discovery.ordinary.loads import Loads, score_loads
from scaling_service.capabilities.discovery.ordinary.odds import Scored
from scaling_service.capabilities.discovery.ordinary.witnesses import hear_declared, hear_sum
from scaling_service.capabilities.discovery.search.cameras import describe_cameras
from scaling_service.capabilities.discovery.search.findings import NamedEffect
from scaling_service.capabilities.discovery.search.gaps import rms_by_place
from scaling_service.capabilities.discovery.search.instruments import Prior, find_misreading
from scaling_service.capabilities.discovery.search.jumps import Jump, list_jumps
from scaling_service.capabilities.discovery.search.markers import BodyTable, Ranked, is_of_body
from scaling_service.capabilities.discovery.search.naming import Naming, is_of_forces, is_of_markers
from scaling_service.capabilities.dynamics.weight import Weight
from scaling_service.core.arrays import Array
from scaling_service.core.threads import map_parallel
from scaling_service.model.inertia import sum_mass
from scaling_service.recording.faults import OF_CAMERAS

LOAD, MASS = "carried_load", "segment_mass"
LABELS, BODY, FORCES = 0.1, 0.6, 0.9  # of the work, where its parts end (chosen)
_MOVED = 0.3  # deviations by which sizes must move to be worth tracking anew (chosen)

_LIVELY = 1.645
"""Deviations by which a marker whose effect was named may be livelier than others of its part: 95 of 100."""

_MANY = 3  # others alike, from which what is there is not told (chosen: a person can check as many)
LIVELY = "most like {}, which leaves its place livelier than others"
DRIFTS = "most like {}, but of a size that changes in the course of a recording, or from one to another"
GROWN = "most like {}, but of a size that nobody meets"
ONE_OF_MANY = "most like {}, and as much like several others"
CARRIED = "most like {}, but what markers there do is not explained"
UNWEIGHED = "most like {}, but a plate that bears it is not explained"
MISREAD = "its readings are off as by no fault that is known; most simply, {}"
CAMERAS = "cameras misread, as by no known fault; most simply, {}: only what is likelier than that is named"
UNLIKE = "in {} it is off between {:.2f} and {:.2f} s by more than elsewhere, as by no touch of the body"

_TUNED, _IN_TUNE = 6, 0.005
"""Times that what swings is tuned and tracked anew, and the share of its frequency at which that ends
(chosen)."""


@dataclass(slots=True, eq=False, kw_only=True)
class Search(Naming):
    """Labels, body and forces, one after the other."""

    misread: list[tuple[Prior, str]] = field(default_factory=list)  # plates, and how in words
    # log odds of cameras that misread: the motion is not what was done; infinite where readings show it
    distorted: float = -math.inf
    jumps: list[Jump] = field(default_factory=list)
    astray: set[str] = field(default_factory=set)  # segments and joints at markers that are not explained
    together: dict[str, float] = field(
        default_factory=dict
    )  # log odds of touches with others of their segment
    # by their keys, as what is withdrawn: touches that explain less than forces that disagree in whatever way
    unlike: dict[str, tuple[Candidate, tuple[str, ...], str]] = field(default_factory=dict)

    # Labels

    def find_labels(self) -> None:
        """Exchanges, one after the other, before anything else is believed of the markers."""
        self.steps.begin("looking for exchanged labels", 0.0, LABELS)
        for _ in range(self.settings.most):
            found = [one for some in map_parallel(find_exchanges, self.fit.tracked) for one in some]
            ranked = sorted((Ranked(odds, c) for odds, c in found), key=lambda one: -one.odds)
            if not self._name_first(ranked, self._refit_labels, {}):
                break

    def _refit_labels(self, effects: Sequence[Estimate]) -> Fit:
        """From the start: the body may have turned to fit labels that were wrong."""
        return fit_recordings(self.fit.context, effects)

    # The body

    def search_body(self) -> BodyTable:
        """Until nothing of the body and its markers stands out; the last table."""
        if any(repair.what in OF_CAMERAS for item in self.fit.tracked for repair in item.trial.repairs):
            self.distorted = math.inf
        for count in range(self.settings.most + 1):
            share = LABELS + (BODY - LABELS) * count / self.settings.most
            self.steps.begin(f"looking for effect {len(self.named) + 1}", share, BODY)
            body = self._make_table()
            if astray := body.list_astray(self.settings.unexplained) - set(self.fit.astray):
                known = {**self.fit.astray, **{m: body.strays[m] for m in astray}}
                self.fit = fit_recordings(self.fit.context, self.fit.effects, replace(self.fit, astray=known))
                body = self._make_table()
            ranked = self.last["markers"] = body.rank()
            self._remember(ranked, sum(s.square for s in body.table.sums))
            if count == self.settings.most or self.distorted == math.inf:
                break
            chosen = self._reorder(body, ranked)
            if self._find_distorted(body, chosen):
                break
            classes = self._tell_classes(chosen, body.compare)
            if not self._name_first(chosen, self._refit_markers, classes):
                astray = body.list_astray(self.settings.unexplained)
                if not (unproven := [n for n in self.named if set(n.candidate.where) & astray]):
                    break
                # what is there is something else
                self._take_back(min(unproven, key=lambda n: n.odds).key)
        return self._withdraw_of_body(body)

    def _find_distorted(self, body: BodyTable, ranked: Sequence[Ranked]) -> bool:
        """Whether cameras that misread as by no known fault are likelier than all that could be named."""
        odds, candidate, size = body.find_misreading()
        passed = self.refused | self.fit.by_key.keys()
        best = max((r.odds for r in ranked if r.candidate.key not in passed), default=-math.inf)
        if odds < max(self.settings.odds, best):
            return False
        said = CAMERAS.format(describe_cameras(candidate, size))
        self.withdrawn[candidate.key] = candidate, candidate.where, said
        self.distorted = odds
        taken = {n.key for n in self.named if n.candidate.where == candidate.where}
        for key in taken:
            self._take_back(key)
        return True

    def _withdraw_of_body(self, body: BodyTable) -> BodyTable:
        """Without what leaves its markers livelier than others of their part, or is one of many alike."""
        lively, astray = body.list_astray(_LIVELY), body.list_astray(self.settings.unexplained)
        self.jumps = list_jumps(body, self.settings.odds)
        astray |= {marker for _, marker, *_ in self.jumps}
        astray |= {w for r in self.list_standing() if is_of_markers(r.candidate) for w in r.candidate.where}
        self.astray = self.fit.scene.list_bearing(astray, beside=True)
        sizes, model = self.fit.by_key, self.fit.model
        for one in [n for n in self.named if not isinstance(n.candidate.change, Exchange)]:
            sd = list_usual_deviations(one.candidate, model) if is_of_body(one.candidate) else None
            if lively & set(one.candidate.where):
                self._withdraw(one, LIVELY)
            elif self.astray & set(one.candidate.where):
                self._withdraw(one, CARRIED)
            elif sd is not None and body.score_drift(sizes[one.key], sd) > self.settings.odds:
                self._withdraw(one, DRIFTS)
            elif len(one.equivalents) >= _MANY:
                self._withdraw(one, ONE_OF_MANY)
        if not self.withdrawn:
            return body
        self.fit = self._refit_markers(self.fit.without(self.withdrawn).effects)
        return self._make_table()

    def _make_table(self) -> BodyTable:
        """With all sizes estimated together; tracked once more where they moved."""
        body = self._tabulate(self.fit)
        for _ in range(_TUNED):
            tuned = body.tune_swings()
            apart = [
                abs(math.log(a / b)) for a, b in zip(_pitch(tuned), _pitch(self.fit.effects), strict=True)
            ]
            if max(apart, default=0.0) < _IN_TUNE:
                break
            self.fit = self._refit_markers(tuned)
            body = self._tabulate(self.fit)
        again = self._settle(body.reestimate())
        swinging = [e for e in self.fit.effects if isinstance(e.candidate.change, Swinging)]
        unmet = [e for e in (*again, *swinging) if not is_met(e.candidate, e.size, self.fit.model)]
        if unmet:  # it grew out of what laboratories meet: it is something else
            self._take_back(unmet[0].candidate.key)
            return self._make_table()
        effects = self._move(again)
        if effects is None:
            return body
        self.fit = self._refit_markers(effects)
        return self._tabulate(self.fit, body)

    def _take_back(self, key: str) -> None:
        """An effect of the body, for good."""
        self._forget(key)
        self.fit = self._refit_markers(self.fit.without({key}).effects)

    def _settle(self, found: Sequence[tuple[Estimate, Array]]) -> list[Estimate]:
        """Estimates within what laboratories meet, where that is as uncertain; their covariances are kept."""
        self.covariances |= {e.candidate.key: covariance for e, covariance in found}
        sizes = [settle_size(e.candidate, e.size, covariance, self.fit.model) for e, covariance in found]
        return [
            e if size is None else Estimate(e.candidate, size)
            for (e, _), size in zip(found, sizes, strict=True)
        ]

    def _move(self, found: Sequence[Estimate]) -> list[Estimate] | None:
        """All effects, with those sizes that moved by more than they are uncertain; None where none did."""
        before, moved = self.fit.by_key, {}
        for effect in found:
            key = effect.candidate.key
            sd = np.sqrt(np.maximum(np.diag(self.covariances[key]), 1e-300))
            if (np.abs(effect.size - before[key].size) > _MOVED * sd).any():
                moved[key] = effect
        return [moved.get(key, e) for key, e in before.items()] if moved else None

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
            and set(r.candidate.where) & set(first.candidate.where)
            and r.candidate.trials == first.candidate.trials
            and r.candidate.key not in self.refused
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

    def _refit_markers(self, effects: Sequence[Estimate]) -> Fit:
        return fit_recordings(self.fit.context, effects, self.fit)

    # Forces

    def search_forces(self) -> tuple[WrenchTable, ForceEvidence] | None:
        """What stands out of the forces; the last table."""
        if not self.fit.wrenches or not self.fit.scene.plates:
            return None
        for count in range(self.settings.most + 1):
            share = BODY + (FORCES - BODY) * count / self.settings.most
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
                reason = CARRIED
            elif of_forces and not is_met(one.candidate, sizes[one.key].size, self.fit.model):
                reason = GROWN
            elif lively and self._find_most(one) in lively:
                reason = LIVELY
            elif of_forces and (
                (one.candidate.trials and alike[one.candidate.kind, one.candidate.where] > 1)
                or (sd is not None and loads.score_drift(sizes[one.key], sd) > self.settings.odds)
            ):
                reason = DRIFTS
            elif len(one.equivalents) >= _MANY:
                reason, where = ONE_OF_MANY, (self._find_most(one),)
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


def _pitch(effects: Sequence[Estimate]) -> list[float]:
    """Frequencies of what swings, Hz."""
    swinging = (e.candidate.change for e in effects)
    return [change.frequency_hz for change in swinging if isinstance(change, Swinging)]


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
