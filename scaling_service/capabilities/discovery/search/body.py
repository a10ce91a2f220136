"""The search, first half: labels, then the body and its markers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from scaling_service.capabilities.discovery.effects.marker_swap import find_exchanges
from scaling_service.capabilities.discovery.effects.sizes import is_met, list_usual_deviations, settle_size
from scaling_service.capabilities.discovery.evidence.fit import Fit, fit_recordings
from scaling_service.capabilities.discovery.laws.candidates import Estimate, Exchange, Swinging
from scaling_service.capabilities.discovery.search.cameras import describe_cameras
from scaling_service.capabilities.discovery.search.jumps import Jump, list_jumps
from scaling_service.capabilities.discovery.search.markers import BodyTable, Ranked, is_of_body
from scaling_service.capabilities.discovery.search.naming import Naming, is_of_markers
from scaling_service.core.arrays import Array
from scaling_service.core.threads import map_parallel
from scaling_service.recording.faults import OF_CAMERAS

LABELS, BODY = 0.1, 0.6  # of the work, where its parts end (chosen)
_MOVED = 0.3  # deviations by which sizes must move to be worth tracking anew (chosen)

_LIVELY = 1.645
"""Deviations by which a marker whose effect was named may be livelier than others of its part: 95 of 100."""

MANY = 3  # others alike, from which what is there is not told (chosen: a person can check as many)
LIVELY = "most like {}, which leaves its place livelier than others"
DRIFTS = "most like {}, but of a size that changes in the course of a recording, or from one to another"
ONE_OF_MANY = "most like {}, and as much like several others"
CARRIED = "most like {}, but what markers there do is not explained"
CAMERAS = "cameras misread, as by no known fault; most simply, {}: only what is likelier than that is named"

_TUNED, _IN_TUNE = 6, 0.005
"""Times that what swings is tuned and tracked anew, and the share of its frequency at which that ends
(chosen)."""


@dataclass(slots=True, eq=False, kw_only=True)
class BodySearch(Naming):
    """Labels and body, one after the other."""

    # log odds of cameras that misread: the motion is not what was done; infinite where readings show it
    distorted: float = -math.inf
    jumps: list[Jump] = field(default_factory=list)
    astray: set[str] = field(default_factory=set)  # segments and joints at markers that are not explained

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
            elif len(one.equivalents) >= MANY:
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


def _pitch(effects: Sequence[Estimate]) -> list[float]:
    """Frequencies of what swings, Hz."""
    swinging = (e.candidate.change for e in effects)
    return [change.frequency_hz for change in swinging if isinstance(change, Swinging)]
