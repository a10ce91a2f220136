"""Candidates side by side: fitted, and tried on what did not fit them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.evidence.statistics import (
    Fitted,
    HeldOut,
    explain,
    fit_each,
    try_held_out,
)
from scaling_service.capabilities.discovery.evidence.sums import Evidence, select_fitting_blocks
from scaling_service.capabilities.discovery.evidence.wrench import choose_observation
from scaling_service.capabilities.discovery.laws.candidates import Candidate
from scaling_service.capabilities.discovery.observations.tracked import TrackedTrial
from scaling_service.numerics.multibody.laws import Array


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ScoredCandidate:
    """What could be the next effect."""

    candidate: Candidate
    fitted: Fitted
    gains: Array | None  # (n_blocks,), or None: what it takes off each block that fits it
    held_out: HeldOut
    equivalents: tuple[Candidate, ...] = ()  # those that are known to be indistinguishable from it

    def p_family(self, count: int) -> float:
        """Of as much by chance in a catalogue of so many: in the fit and in recordings that fitted nothing.

        These are other data, so the two combine (Fisher 1932, Statistical Methods for Research Workers,
        21.1): a fit of few blocks of time cannot pay for the whole catalogue, however much it explains. Not
        so for gains below the noise, as noise in the motion gives them to masses that oscillate with it.
        """
        p = self.fitted.p
        if self.held_out.outweighs_noise and not self.held_out.folds:
            product = max(p * self.held_out.p, 1e-300)
            p = product * (1.0 - math.log(product))
        return min(1.0, count * p)

    def does_good(self, level: float) -> bool:
        """Whether it surely lowers what recordings that did not fit it disagree."""
        return self.held_out.p <= level and self.held_out.gain > 0.0


@dataclass(frozen=True, slots=True, eq=False)
class ScoredCandidates:
    """The best, the best first, and among how many they were selected."""

    best: list[ScoredCandidate]
    count: int
    # those of the best that are sums of columns among the markers, and those that were searched for there
    of_markers: tuple[Sequence[ScoredCandidate], Sequence[ScoredCandidate]] = ((), ())
    tracked: tuple[TrackedTrial, ...] = ()  # the recordings that these were scored on


def score_candidates(fit: Fit, choice: Sequence[Candidate], shortlist: int) -> list[ScoredCandidate]:
    """The likely ones of candidates that all show in the same observation, the best first."""
    if not choice:
        return []
    observation, picked = choose_observation(choice[0]), choice
    if len(choice) > shortlist:
        rough = observation.gather_beside(fit, choice, together=False, rough=True)
        picked = [choice[k] for k, _ in keep_likely(rough, choice)[:shortlist]]
    return score_gathered(observation.gather_beside(fit, picked, together=True), picked)


def score_gathered(evidence: Evidence, choice: Sequence[Candidate]) -> list[ScoredCandidate]:
    """The likely ones of candidates whose evidence was gathered together, the best first."""
    found = []
    for k, fitted in keep_likely(evidence, choice):
        gains = explain(evidence, k, select_fitting_blocks(evidence.blocks, choice[k])).gains
        held_out = try_held_out(evidence, k, choice[k], fitted.by_chance / max(len(fitted.size), 1))
        found.append(ScoredCandidate(candidate=choice[k], fitted=fitted, gains=gains, held_out=held_out))
    return found


def keep_likely(evidence: Evidence, choice: Sequence[Candidate]) -> list[tuple[int, Fitted]]:
    """Which of them have plausible numbers, the best first."""
    fitted = fit_each(evidence, choice)
    likely = [(k, f) for k, (c, f) in enumerate(zip(choice, fitted, strict=True)) if _is_plausible(c, f)]
    return sorted(likely, key=lambda one: one[1].rank)


def _is_plausible(candidate: Candidate, fitted: Fitted) -> bool:
    """Whether every number lies in its range, give or take its own deviation, and all do together."""
    if not len(fitted.size):
        return False
    spread = np.sqrt(np.diag(fitted.covariance))
    nearest = [
        next((x for x in (size, size - sd, size + sd) if column.plausible(x)), size)
        for column, size, sd in zip(candidate.columns, fitted.size.tolist(), spread.tolist(), strict=True)
    ]
    return candidate.plausible(np.array(nearest))
