"""The search itself: labels, the body and its markers, the forces; each time the likeliest is named.

Nothing is named whose own places, or whose forces or markers as a whole, are worse with it on what did not
fit it.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy

from scaling_service.capabilities.discovery.effects.body_mass import (
    balance_weight,
    find_usual_mass,
    make_candidate,
)
from scaling_service.capabilities.discovery.effects.catalogue import describe_details, propose_candidates
from scaling_service.capabilities.discovery.effects.external_contact import find_contacts, make_touch
from scaling_service.capabilities.discovery.effects.marker_swap import find_exchanges
from scaling_service.capabilities.discovery.effects.sizes import (
    is_met,
    list_usual_deviations,
    look_up_usual_sizes,
)
from scaling_service.capabilities.discovery.evidence.fit import Fit, fit_recordings, fit_wrenches
from scaling_service.capabilities.discovery.evidence.settings import DiscoverySettings
from scaling_service.capabilities.discovery.laws.candidates import (
    Candidate,
    Contact,
    Estimate,
    Reweighed,
    Seen,
    Swinging,
)
from scaling_service.capabilities.discovery.laws.loads import PlateFault
from scaling_service.capabilities.discovery.observations.wrench import COMPONENTS
from scaling_service.capabilities.discovery.ordinary.forces import ForceEvidence, Touch, WrenchTable
from scaling_service.capabilities.discovery.ordinary.loads import Loads, score_loads
from scaling_service.capabilities.discovery.ordinary.odds import Scored
from scaling_service.capabilities.discovery.ordinary.witnesses import hear_declared, hear_sum
from scaling_service.capabilities.discovery.search.findings import Tried
from scaling_service.capabilities.discovery.search.gaps import rms_by_place
from scaling_service.capabilities.discovery.search.leanings import OF_MODELS, Leaning
from scaling_service.capabilities.discovery.search.markers import BodyTable, Ranked
from scaling_service.capabilities.dynamics.weight import Weight
from scaling_service.core.arrays import Array
from scaling_service.core.progress import Steps
from scaling_service.core.threads import map_parallel
from scaling_service.model.inertia import sum_mass

LOAD, MASS = "carried_load", "segment_mass"
LABELS, BODY, FORCES = 0.1, 0.6, 0.9  # of the work, where its parts end (chosen)
_MOVED = 0.3  # deviations by which sizes must move to be worth tracking anew (chosen)

_TUNED, _IN_TUNE = 6, 0.005
"""Times that what swings is tuned and tracked anew, and the share of its frequency at which that ends
(chosen)."""
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
    """What is assumed by now: labels, body and forces, one after the other."""

    fit: Fit
    origin: Origin
    steps: Steps
    named: list[Named] = field(default_factory=list)
    refused: set[str] = field(default_factory=set)  # keys
    tried: dict[str, Tried] = field(default_factory=dict)
    covariances: dict[str, Array] = field(default_factory=dict)
    leanings: dict[str, Leaning] = field(default_factory=dict)
    last: dict[Seen, list[Ranked]] = field(default_factory=dict)  # as they were ranked last

    @property
    def settings(self) -> DiscoverySettings:
        """How strict it is."""
        return self.fit.settings

    # Labels

    def find_labels(self) -> None:
        """Exchanges, one after the other, before anything else is believed of the markers."""
        self.steps.begin("looking for exchanged labels", 0.0, LABELS)
        for _ in range(self.settings.most):
            found = [one for some in map_parallel(find_exchanges, self.fit.tracked) for one in some]
            ranked = sorted((Ranked(odds, c) for odds, c in found), key=lambda one: -one.odds)
            if not self._name_first(self._track_pairs(ranked), self._refit_labels, {}):
                break

    def _track_pairs(self, ranked: list[Ranked]) -> list[Ranked]:
        """With the pair first that leaves least of the first one's recording, once it is tracked with each.

        A body that turned round to fit two exchanged markers wants others exchanged.
        """
        likely = [r for r in ranked if r.odds >= self.settings.odds and r.candidate.key not in self.refused]
        rivals = [r for r in likely if r.candidate.trials == likely[0].candidate.trials]
        if len(rivals) < 2:
            return ranked

        def measure_rest(one: Ranked) -> float:
            fit = self._refit_labels((*self.fit.effects, Estimate(one.candidate, np.zeros(0))))
            left = rms_by_place(fit, one.candidate.trials, forces=False)
            return sum(rms**2 for rms in left.values())

        best = min(rivals, key=measure_rest)
        return [best, *(r for r in ranked if r is not best)]

    def _refit_labels(self, effects: Sequence[Estimate]) -> Fit:
        """From the start: the body may have turned to fit labels that were wrong."""
        return fit_recordings(self.fit.context, effects)

    # The body

    def search_body(self) -> BodyTable:
        """Until nothing of the body and its markers stands out; the last table."""
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
            if count == self.settings.most:
                break
            chosen = self._reorder(body, ranked)
            classes = self._tell_classes(chosen, body.compare)
            if not self._name_first(chosen, self._refit_markers, classes):
                astray = body.list_astray(self.settings.unexplained)
                if not (unproven := [n for n in self.named if set(n.ranked.candidate.where) & astray]):
                    break
                # what is there is something else
                self._take_back(min(unproven, key=lambda n: n.ranked.odds).ranked.candidate.key)
        return body

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
        again = body.reestimate()
        self.covariances |= {e.candidate.key: covariance for e, covariance in again}
        unmet = [e for e, _ in again if not is_met(e.candidate, e.size, self.fit.model)]
        unmet += [
            e
            for e in self.fit.effects
            if isinstance(e.candidate.change, Swinging) and not is_met(e.candidate, e.size, self.fit.model)
        ]
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
        weight = balance_weight(self.fit)
        weighed = self._is_weighed()
        contacts: list[tuple[float, Candidate]] = []

        def list_touches(noise: Array) -> list[Touch]:
            contacts.extend(find_contacts(self.fit, noise))
            return [make_touch(self.fit, candidate) for _, candidate in contacts]

        loads = score_loads(
            self.fit,
            choice,
            named,
            mass_sd=find_usual_mass(self.fit.model),
            weighed=weighed,
            each=weight is not None and weight.disagree,
            touching=[
                make_touch(self.fit, e.candidate)
                for e in self.fit.effects
                if isinstance(e.candidate.change, Contact)
            ],
            touches=list_touches,
        )
        self.covariances |= {e.candidate.key: covariance for e, covariance in loads.named}
        moved = {e.candidate.key: e for e, c in loads.named if self._has_moved(e, c)}
        if moved:
            self.fit = self._refit_forces([moved.get(e.candidate.key, e) for e in self.fit.effects])
        places = Counter(c.kind for c, _ in choice)
        ranked = [
            Ranked(s.bayes - math.log(places[c.kind]), c, s)
            for (c, _), s in zip(choice, self._hear_declared(choice, loads, weight), strict=True)
        ]
        ranked += [
            Ranked(bayes + prior, candidate)
            for bayes, (prior, candidate) in zip(loads.touched, contacts, strict=True)
        ]
        ranked.sort(key=lambda one: -one.odds)
        declared = None if weighed else self.origin.declared_kg
        mass = None if declared is None else make_candidate(self.fit, declared)
        if mass is not None and weight is not None:
            of_mass = Ranked(loads.mass, mass)
            at = bisect_left(ranked, -of_mass.odds, key=lambda one: -one.odds)
            if weight.disagree:  # which is one number with gains and biases of their plates
                of_plates = (k for k, one in enumerate(ranked) if is_of_plate(one.candidate))
                at = min(at, next(of_plates, at))
            ranked.insert(at if of_mass.odds >= self.settings.odds else len(ranked), of_mass)
        return loads, ranked

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
            if not self._is_met(one.candidate, size):
                self.refused.add(key)
                continue
            effect = Estimate(one.candidate, size)
            fit = refit((*self.fit.effects, effect))
            gain, by_blocks = self._measure_gain(fit, one.candidate)
            usual = look_up_usual_sizes(one.candidate, self.fit.model)
            shown = ((usual(name), value) for name, value in describe_details(effect, fit).items())
            if gain is None or any(met and not met.low <= value <= met.high for met, value in shown):
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

    def _is_met(self, candidate: Candidate, size: Array) -> bool:
        """Whether its size is one that laboratories meet; else it is something else."""
        met = is_met(candidate, size, self.fit.model)
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
            self.tried[r.candidate.key] = Tried(
                candidate=r.candidate, odds=r.odds, gain=gain, smallest=self._find_smallest(r)
            )
        for r in ranked:
            if r.scored is not None and r.candidate.kind in OF_MODELS and not r.candidate.trials:
                s = r.scored
                self.leanings[r.candidate.key] = Leaning.of(r.candidate, s.size, s.covariance, s.sd)

    def list_standing(self) -> list[Ranked]:
        """What has the odds and was refused: of a size that nobody meets, or worse on unseen recordings."""
        every = [r for ranked in self.last.values() for r in ranked]
        return [r for r in every if r.odds >= self.settings.odds and r.candidate.key in self.refused]

    def list_leanings(self) -> list[Leaning]:
        """What the recordings say of every effect of the model, named or not."""
        for effect in self.fit.effects:
            key, sd = effect.candidate.key, list_usual_deviations(effect.candidate, self.fit.model)
            if key in self.leanings and sd is not None:
                self.leanings[key] = Leaning.of(effect.candidate, effect.size, self.covariances[key], sd)
        return list(self.leanings.values())


def is_of_forces(candidate: Candidate) -> bool:
    """Whether a candidate is a sum of columns of the wrench."""
    return bool(candidate.columns) and all(column.load is not None for column in candidate.columns)


def is_of_plate(candidate: Candidate) -> bool:
    """Whether a candidate is a fault of a plate."""
    return any(isinstance(column.load, PlateFault) for column in candidate.columns)


def is_of_markers(candidate: Candidate) -> bool:
    """Whether a candidate shows among the markers."""
    return candidate.seen_in == "markers"


def _pitch(effects: Sequence[Estimate]) -> list[float]:
    """Frequencies of what swings, Hz."""
    swinging = (e.candidate.change for e in effects)
    return [change.frequency_hz for change in swinging if isinstance(change, Swinging)]


@dataclass(frozen=True, slots=True, eq=False)
class Alike:
    """Cosine between what two candidates of the wrench explain, as they were found.

    Touches of one recording may take any course, so that they explain the same.
    """

    loads: Loads
    choice: Sequence[Candidate]

    def __call__(self, one: Ranked, other: Ranked) -> float:
        """0 of what has no columns, 1 of touches."""
        if isinstance(one.candidate.change, Contact) and isinstance(other.candidate.change, Contact):
            return float(one.candidate.trials == other.candidate.trials)
        if one.scored is None or other.scored is None:
            return 0.0
        table, keys = self.loads.table, [c.key for c in self.choice]
        scale = np.sqrt(table.weight) / (table.sd * self.loads.none.levels)
        a, b = (
            (scale * table.explain(table.numbers[keys.index(r.candidate.key)], s.size)).ravel()
            for r, s in ((one, one.scored), (other, other.scored))
        )
        return float(a @ b / math.sqrt(max(float(a @ a) * float(b @ b), 1e-300)))
