"""The statistics of a cohort, from its subjects' summaries alone (Puchaud 2019, sections 2.3 and 3)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from scaling_service.capabilities.cohort.agreement import CohortAgreement, agreements
from scaling_service.capabilities.cohort.curves import CurveComparison, compare_curves
from scaling_service.capabilities.cohort.scalars import ScalarComparison, compare_scalars
from scaling_service.capabilities.cohort.subject_summary import MethodSummary, SubjectSummary
from scaling_service.numerics.statistics.waveforms import WaveformSettings

GATE_RMS_M, GATE_MAX_M = 0.02, 0.04
"""OpenSim's guideline for inverse kinematics: marker errors below 2 cm RMS and 2 to 4 cm at most (Hicks et
al. 2015, J Biomech Eng 137:020905; the larger limit is taken). Necessary, not sufficient: fitted
numbers absorb errors."""


@dataclass(frozen=True, slots=True)
class CohortSettings:
    """How a cohort is compared.

    Parameters
    ----------
    alpha : float
        Of every test of single numbers.
    waveforms : WaveformSettings
        Of joint angles.
    confidence : float
        Of the intervals of agreement.
    """

    alpha: float = 0.05
    waveforms: WaveformSettings = field(default_factory=WaveformSettings)
    confidence: float = 0.95


@dataclass(frozen=True, slots=True)
class GateCount:
    """How many subjects keep OpenSim's limits under a method, in all trials that show a marker."""

    method: str
    subjects: int
    subjects_passed: int
    trials: int
    trials_passed: int


@dataclass(frozen=True, slots=True, eq=False)
class CohortStatistics:
    """Everything that is compared over a cohort.

    Parameters
    ----------
    subjects, methods : tuples of str
        In the order given; methods that no subject has are not among them.
    scalars : tuple of ScalarComparison
    curves : tuple of CurveComparison
    agreements : tuple of CohortAgreement
    gates : tuple of GateCount
    notes : tuple of str
        What limits all this, plain English.
    """

    subjects: tuple[str, ...]
    methods: tuple[str, ...]
    scalars: tuple[ScalarComparison, ...]
    curves: tuple[CurveComparison, ...]
    agreements: tuple[CohortAgreement, ...]
    gates: tuple[GateCount, ...]
    notes: tuple[str, ...]

    def scalar(self, kind: str, quantity: str) -> ScalarComparison:
        """The first comparison of a quantity: that of most methods (KeyError if there is none)."""
        for found in self.scalars:
            if (found.kind, found.quantity) == (kind, quantity):
                return found
        raise KeyError((kind, quantity))

    def curve(self, coordinate: str) -> CurveComparison:
        """The first comparison of a joint angle (KeyError if there is none)."""
        for found in self.curves:
            if found.coordinate == coordinate:
                return found
        raise KeyError(coordinate)


def cohort_statistics(
    subjects: Sequence[SubjectSummary],
    methods: Sequence[str],
    *,
    seed: int = 0,
    settings: CohortSettings | None = None,
) -> CohortStatistics:
    """Compare methods over a cohort.

    Parameters
    ----------
    subjects : sequence of SubjectSummary
        Each under a name of its own. Their order changes no number.
    methods : sequence of str
        Those of interest, in the order to show.
    seed : int
        Of the rearrangements of joint angles.
    settings : CohortSettings, optional

    Returns
    -------
    CohortStatistics
        Each comparison is over the subjects that have all its methods; the others are named in its
        ``panel``.
    """
    chosen = settings or CohortSettings()
    # Sorted, so that sums and random numbers meet subjects in one order whatever order they come in.
    ordered = sorted(subjects, key=lambda s: s.subject)
    present = tuple(m for m in methods if any(m in s.methods for s in ordered))
    curves = tuple(compare_curves(ordered, present, seed, chosen.waveforms))
    compared = list(agreements(ordered, present, chosen.confidence))
    return CohortStatistics(
        subjects=tuple(s.subject for s in subjects),
        methods=present,
        scalars=tuple(compare_scalars(ordered, present, chosen.alpha)),
        curves=curves,
        agreements=tuple(a for a in compared if isinstance(a, CohortAgreement)),
        gates=tuple(_gate(ordered, method) for method in present),
        notes=(*_references(curves), *(a for a in compared if isinstance(a, str))),
    )


def _gate(subjects: Sequence[SubjectSummary], method: str) -> GateCount:
    passed = [_passed(s.methods[method]) for s in subjects if method in s.methods]
    return GateCount(
        method,
        len(passed),
        sum(all(trials) for trials in passed),
        sum(len(trials) for trials in passed),
        sum(sum(trials) for trials in passed),
    )


def _passed(method: MethodSummary) -> list[bool]:
    seen = [t for t in method.trials.values() if math.isfinite(t.mean)]
    return [t.rms < GATE_RMS_M and t.max < GATE_MAX_M for t in seen]


def _references(curves: Sequence[CurveComparison]) -> list[str]:
    """What joint angles were compared to, where it is not what the paper takes."""
    if not curves:
        return ["no subject has a whole stride: joint angles over the gait cycle are not compared"]
    used = list(dict.fromkeys(c.reference for c in curves if c.test is not None and c.reference != "EB_am"))
    return [
        "joint angles are compared in all pairs: neither EB_am nor MB_am is there"
        if reference is None
        else f"joint angles are compared to {reference}, for EB_am is not there for all subjects compared"
        for reference in used
    ]
