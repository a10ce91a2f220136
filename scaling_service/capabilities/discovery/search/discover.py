"""Find what is missing, and show what it was.

Round after round names are given until nothing passes; then what is superfluous is dropped. What is dropped
may have stood in the place of something else, so the search goes on where something was.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from scaling_service.capabilities.discovery.disturbances.disturbance import (
    Disturbance,
    find_disturbance,
    is_better_than_effects,
)
from scaling_service.capabilities.discovery.disturbances.free_marker import find_free_marker
from scaling_service.capabilities.discovery.effects.catalogue import ask_questions
from scaling_service.capabilities.discovery.evidence.fit import Fit, Recording, SearchContext, fit_recordings
from scaling_service.capabilities.discovery.evidence.markers import MARKERS
from scaling_service.capabilities.discovery.evidence.scoring import ScoredCandidates
from scaling_service.capabilities.discovery.evidence.settings import DiscoverySettings
from scaling_service.capabilities.discovery.evidence.wrench import WRENCH
from scaling_service.capabilities.discovery.laws.candidates import Estimate, Masked
from scaling_service.capabilities.discovery.search.elimination import (
    drop_insufficient,
    drop_negligible,
    drop_predictable,
    eliminate_backward,
    settle,
    withdraw_answers,
)
from scaling_service.capabilities.discovery.search.estimation import (
    ROUGHLY,
    estimate,
    remove,
    select_observations,
)
from scaling_service.capabilities.discovery.search.findings import Findings, NamedEffect
from scaling_service.capabilities.discovery.search.naming import name_effect, name_tuned, tell_classes
from scaling_service.capabilities.discovery.search.rivals import (
    find_marker_pair,
    is_plate_pair,
    rename,
    replace_by_plate_pair,
)
from scaling_service.capabilities.discovery.search.selection import score_all, select, try_in_full
from scaling_service.capabilities.discovery.search.summarise import summarise
from scaling_service.core.progress import Progress, Steps, show_nothing
from scaling_service.model.body import BodyModel

_TIMES = 3  # that names are given and looked back at, at most (chosen)
_DONE, _SETTLING, _MEASURING = 0.8, 0.85, 0.9  # of the work, where its last parts begin (chosen)


@dataclass(frozen=True, slots=True, eq=False)
class Discovery:
    """The whole story, and the two fits between which it goes."""

    findings: Findings
    before: Fit
    after: Fit


def discover(
    model: BodyModel,
    recordings: Sequence[Recording],
    free: Sequence[Estimate] = (),
    settings: DiscoverySettings = DiscoverySettings(),
    progress: Progress | None = None,
    notes: Sequence[str] = (),
) -> Discovery:
    """Search the catalogue for what the model does not have.

    Parameters
    ----------
    model : BodyModel
        Without parameters; with mass where forces are given.
    recordings : sequence of Recording
        Not smoothed, not filled.
    free : sequence of Estimate
        What the calibration could have explained, at zero.
    notes : sequence of str
        What is known already of what could not be tried.

    Raises
    ------
    TrialUnusable
        A trial shows no marker of the model.
    """
    steps = Steps(report=progress or show_nothing)
    steps.begin("following the recordings", 0.0, _DONE)
    before = fit_recordings(
        SearchContext(model=model, recordings=recordings, settings=settings, advance=steps.advance), free
    )
    search = Search(fit=estimate(before, (), ROUGHLY) if free else before, steps=steps)
    scored = search.finish()
    steps.begin("settling all numbers", _SETTLING, _MEASURING)
    named, fit = drop_predictable(search.named, search.fit, before)
    named, fit = settle(named, fit)
    named, fit, negligible = drop_negligible(named, fit, before)
    named, fit, insufficient = drop_insufficient(named, fit, before)
    fit, seen = _unmask_markers(fit)
    steps.begin("measuring the gap", _MEASURING, 1.0)
    findings = summarise(
        tell_classes(named, fit),
        scored,
        search.disturbance,
        (before, fit, seen),
        (*notes, *negligible, *insufficient),
    )
    steps.begin("done", 1.0, 1.0)
    return Discovery(findings, before, fit)


@dataclass(slots=True, eq=False, kw_only=True)
class Search:
    """What was named so far, and what was tried without success."""

    fit: Fit  # with all that was named
    steps: Steps
    named: list[NamedEffect] = field(default_factory=list)
    refused: set[str] = field(default_factory=set)  # keys of candidates
    # those of them that may be tried again when more is known of the forces
    early: set[str] = field(default_factory=set)
    scored: ScoredCandidates | None = None  # what the last round saw
    disturbance: Disturbance | None = None  # one that no effect has and that ends the search
    questioned: bool = False  # whether the questions that come before the search were asked

    def finish(self) -> ScoredCandidates:
        """Until nothing passes and nothing is superfluous; returns what the last round saw."""
        for _ in range(_TIMES):
            while self._round():
                pass
            self.steps.begin("looking back", _DONE, _SETTLING)
            assert self.scored is not None
            if not self._eliminate(self.scored) or self.disturbance is not None:
                break
        self._yield_to_disturbance()
        assert self.scored is not None
        return self.scored

    def _yield_to_disturbance(self) -> None:
        """Take back what was named in the stead of the disturbance: what its law explains better."""
        law = self.disturbance
        same = [n for n in self.named if law is not None and n.candidate.seen_in == law.seen_in]
        if law is None or not same:
            return
        without = remove(self.fit, [n.effect for n in same])
        if is_better_than_effects(law, without, self.fit):
            self.named = [n for n in self.named if n not in same]
            self.fit = without

    def _round(self) -> bool:
        """Name what passes best; whether to go on."""
        fit, settings = self.fit, self.fit.settings
        share = _DONE * len(self.named) / settings.most
        self.steps.begin(f"looking for effect {len(self.named) + 1}", share, _DONE)
        self.scored = scored = score_all(fit, self.scored)
        if not self.questioned:
            self.questioned = True
            answers = [name_effect(found, fit, scored) for found in ask_questions(fit, scored.best)]
            if answers:
                self.named += answers
                added = [n.effect for n in answers]
                self.fit = estimate(fit, added, ROUGHLY, observations=select_observations(added))
                return True
        selection = select(fit, scored, self.named, self.refused)
        self.refused |= selection.refused
        law = find_disturbance(fit, scored)
        self.disturbance = None if law is None or is_plate_pair(law, fit, scored.count) else law
        if self.disturbance is not None:
            return False
        masked = [e for e in fit.effects if isinstance(e.candidate.change, Masked)]
        odd = find_free_marker(fit, scored) if len(masked) < settings.most_masked else None
        name = partial(name_tuned, among=scored)
        pair = [] if odd is None else find_marker_pair(odd, fit, name, scored.count, self.refused)
        if odd is not None and not pair:
            left_out = Estimate(odd.candidate, np.zeros(0))
            self.fit = MARKERS.refit(fit, fit.free, (*fit.effects, left_out))
            return True
        found = pair or selection.named
        if found:
            self._try(found, scored)
        return bool(found)

    def _try(self, found: Sequence[NamedEffect], scored: ScoredCandidates) -> None:
        """Add what holds, and compare names that were given before with their rivals."""
        tried = try_in_full(self.fit, found)
        self.fit = tried.fit
        self.early |= tried.early
        self.refused |= tried.refused | tried.early
        if any(WRENCH.shows(n.candidate) for n in tried.added):
            self.refused -= self.early
            self.early.clear()
        if tried.added:
            named = [*self.named, *tried.added]
            self.named, self.fit = rename(named, self.fit, partial(name_tuned, among=scored))

    def _eliminate(self, scored: ScoredCandidates) -> bool:
        """Whether something of what was named is superfluous; it is dropped, and refused from now on."""
        if self.named or self.disturbance is None:  # nothing is named in the stead of a disturbance
            name = partial(name_tuned, among=scored)
            self.named, self.fit = replace_by_plate_pair(self.named, self.fit, name, scored.count)
        given = {n.key for n in self.named}
        self.named, self.fit = withdraw_answers(self.named, self.fit)
        self.named, self.fit = eliminate_backward(self.named, self.fit)
        dropped = given - {n.key for n in self.named}
        self.refused |= dropped
        return bool(dropped)


def _unmask_markers(fit: Fit) -> tuple[Fit, Fit]:
    """The fit with every marker again, and one of all markers whose motion the odd ones do not pull."""
    kept = [e for e in fit.effects if not isinstance(e.candidate.change, Masked)]
    if len(kept) == len(fit.effects):
        return fit, fit
    whole = MARKERS.refit(fit, fit.free, kept)
    pairs = zip(whole.tracked, fit.tracked, strict=True)
    return whole, replace(whole, tracked=tuple(replace(item, q=other.q) for item, other in pairs))
