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


def observable_of(place: str) -> Observable:
    """What kind of place a name is."""
    if place not in COMPONENTS:
        return "marker"
    return "force" if place.startswith("f") else "moment"


@dataclass(frozen=True, slots=True)
class Disagreement:
    """Where simulation and measurement differ, before anything was added.

    Parameters
    ----------
    where : str
        A marker, or a component of the ground wrench (``fx`` …).
    observable : 'marker', 'force' or 'moment'
    rms, floor : float
        SI (m, N, N m): the difference, and what noise alone would leave.
    share : float
        Of all that stands above the floors.
    p : float
        Of standing so far above its floor by chance, over all places looked at.
    trials : mapping
        Trial to its RMS (SI).
    when : str
        When it is largest, in words: a trial and a block of time.
    along : str
        The coordinate that it follows best, if any, and how.
    """

    where: str
    observable: Observable
    rms: float
    floor: float
    share: float
    p: float
    trials: Mapping[str, float] = field(default_factory=dict)
    when: str = ""
    along: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class NamedEffect:
    """An effect that passed.

    Parameters
    ----------
    effect : Estimate
        With its size once everything was estimated together.
    covariance : ndarray, shape (k, k)
        Of its size (SI), whatever the memory of the noise.
    fitted : Fitted
        As it stood when it was named.
    p_family : float
        Over the whole catalogue.
    smallest : mapping
        Column to the size (as in the results) from which it is named nine times in ten.
    equivalents : tuple of Candidate
        Its equivalence class: those that this recording does not tell from it.
    would_separate : str
        The ordinary movement that would.
    rivals : tuple of Candidate
        Those that explained most beside it when it was named.
    details : mapping
        Further numbers by the names of the results (``rms_deg``, ``start_s``, ``frequency_hz``).
    spreads : mapping
        Standard deviations of those of them that have one.
    """

    effect: Estimate
    covariance: Array
    fitted: Fitted
    p_family: float
    held_out: HeldOut
    smallest: Mapping[str, float] = field(default_factory=dict)
    equivalents: tuple[Candidate, ...] = ()
    would_separate: str = ""
    rivals: tuple[Candidate, ...] = ()
    details: Mapping[str, float] = field(default_factory=dict)
    spreads: Mapping[str, float] = field(default_factory=dict)

    @property
    def candidate(self) -> Candidate:
        """What it is, and where."""
        return self.effect.candidate

    @property
    def key(self) -> str:
        """The candidate's."""
        return self.effect.candidate.key


@dataclass(frozen=True, slots=True)
class Level:
    """Before and after, between what noise leaves and what is not explained.

    Parameters
    ----------
    before, after, floor, ceiling : float
        RMS, SI; ``ceiling`` is what a black-box correction with as many numbers reaches.
    low, high : float
        95 % interval of ``after``, over blocks of time.
    """

    before: float
    after: float
    floor: float
    ceiling: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Gap:
    """The gap of the recordings of one role.

    Parameters
    ----------
    levels : mapping
        ``whitened``, ``markers``, ``force``, ``moment`` (those observed) to their levels.
    places : mapping
        Marker or component to its levels.
    absorbed : float
        Whitened RMS that is reached where the calibration's own parameters take up what they can instead.
    """

    levels: Mapping[str, Level]
    places: Mapping[str, Level]
    absorbed: float


@dataclass(frozen=True, slots=True)
class Unexplained:
    """What is left above the floor and matches no effect.

    Parameters
    ----------
    observable : 'marker', 'force' or 'moment'
    law : str
        The simplest sum of simple functions that describes it, in words and numbers.
    rms, floor : float
        SI.
    """

    where: tuple[str, ...]
    observable: Observable
    law: str
    rms: float
    floor: float


@dataclass(frozen=True, slots=True, eq=False)
class Findings:
    """The whole story.

    Parameters
    ----------
    verdict : 'found', 'nothing' or 'unexplained'
    disagreements : tuple of Disagreement
        The largest first.
    fit, held_out : Gap
        ``held_out`` comes from blocks of time where no trial was held out; then ``folds`` is true.
    tried : tuple of Option
        The best that were not named.
    reason : str
        Why the search stopped.
    notes : tuple of str
        What could not be tried and why.
    """

    verdict: Verdict
    disagreements: tuple[Disagreement, ...]
    named: tuple[NamedEffect, ...]
    fit: Gap
    held_out: Gap
    folds: bool
    tried: tuple[ScoredCandidate, ...]
    unexplained: tuple[Unexplained, ...]
    reason: str
    notes: tuple[str, ...]
