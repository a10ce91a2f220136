"""What a search found, as frozen values: where, what, how much of the gap closed, what is left."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from scaling_service.capabilities.discovery.evidence.scoring import ScoredCandidate
from scaling_service.capabilities.discovery.evidence.statistics import Fitted, HeldOut
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Estimate
from scaling_service.capabilities.discovery.observations.wrench import COMPONENTS
from scaling_service.numerics.multibody.laws import Array

Verdict = Literal["found", "nothing", "unexplained"]
Observable = Literal["marker", "force", "moment"]


def classify_place(place: str) -> Observable:
    """What kind of place a name is."""
    if place not in COMPONENTS:
        return "marker"
    return "force" if place.startswith("f") else "moment"


@dataclass(frozen=True, slots=True, kw_only=True)
class Disagreement:
    """Where simulation and measurement differ, before anything was added."""

    where: str  # a marker, or a component of the ground wrench (``fx`` …)
    observable: Observable
    rms: float  # rms, floor: SI (m, N, N m): the difference, and what noise alone would leave
    floor: float
    share: float  # of all that stands above the floors
    p: float  # of standing so far above its floor by chance, over all places looked at
    trials: Mapping[str, float] = field(default_factory=dict)  # trial to its RMS (SI)
    when: str = ""  # when it is largest, in words: a trial and a block of time
    along: str = ""  # the coordinate that it follows best, if any, and how


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class NamedEffect:
    """An effect that passed."""

    effect: Estimate  # with its size once everything was estimated together
    covariance: Array  # (k, k): of its size (SI), whatever the memory of the noise
    fitted: Fitted  # as it stood when it was named
    p_family: float  # over the whole catalogue
    held_out: HeldOut
    # column to the size (as in the results) from which it is named nine times in ten
    smallest: Mapping[str, float] = field(default_factory=dict)
    # its equivalence class: those that this recording does not tell from it, the nearest first, each with
    # how likely chance alone makes its lead
    equivalents: Mapping[Candidate, float] = field(default_factory=dict)
    would_separate: str = ""  # the ordinary movement that would
    rivals: tuple[Candidate, ...] = ()  # those that explained most beside it when it was named
    # further numbers by the names of the results (``rms_deg``, ``start_s``, ``frequency_hz``)
    details: Mapping[str, float] = field(default_factory=dict)
    # standard deviations of those of them that have one, and of sizes that are estimated together with these
    spreads: Mapping[str, float] = field(default_factory=dict)

    @property
    def candidate(self) -> Candidate:
        """What it is, and where."""
        return self.effect.candidate

    @property
    def member(self) -> float:
        """Probability that it is this one of its class: each lead's chance as a posterior."""
        chances = [min(p, 0.5) for p in self.equivalents.values()]
        return 1.0 / (1.0 + sum(p / (1.0 - p) for p in chances))

    @property
    def key(self) -> str:
        """The candidate's."""
        return self.effect.candidate.key


@dataclass(frozen=True, slots=True, kw_only=True)
class Level:
    """Before and after, between what noise leaves and what is not explained."""

    # before, after, floor, ceiling: RMS, SI; ``ceiling`` is what a black-box correction with as many
    # numbers reaches
    before: float
    after: float
    floor: float
    ceiling: float
    low: float  # low, high: 95 % interval of ``after``, over blocks of time
    high: float


@dataclass(frozen=True, slots=True)
class Gap:
    """The gap of the recordings of one role."""

    # ``whitened``, ``markers``, ``force``, ``moment`` (those observed) to their levels
    levels: Mapping[str, Level]
    places: Mapping[str, Level]  # marker or component to its levels
    # whitened RMS that is reached where the calibration's own parameters take up what they can instead
    absorbed: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Unexplained:
    """What is left above the floor and matches no effect."""

    where: tuple[str, ...]
    observable: Observable
    law: str  # the simplest sum of simple functions that describes it, in words and numbers
    rms: float  # SI, as the floor
    floor: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Findings:
    """The whole story."""

    verdict: Verdict
    disagreements: tuple[Disagreement, ...]  # the largest first
    named: tuple[NamedEffect, ...]
    # fit, held_out: ``held_out`` comes from blocks of time where no trial was held out; then ``folds`` is
    # true
    fit: Gap
    held_out: Gap
    folds: bool
    tried: tuple[ScoredCandidate, ...]  # the best that were not named
    unexplained: tuple[Unexplained, ...]
    reason: str  # why the search stopped
    notes: tuple[str, ...]  # what could not be tried and why
