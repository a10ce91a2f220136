"""The statistics of a cohort, from its subjects' summaries alone (Puchaud 2019, sections 2.3 and 3)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from scaling_service.capabilities.cohort.document import GATE_MAX_M, GATE_RMS_M
from scaling_service.capabilities.cohort.groups import ScalarComparison, compare_scalars, too_few
from scaling_service.capabilities.cohort.summary import IMAGED, TRUTH, MethodSummary, SubjectSummary
from scaling_service.core.streams import stream
from scaling_service.model.results import Array
from scaling_service.numerics.statistics.agreement import Agreement, agreement
from scaling_service.numerics.statistics.complete import Panel, panels
from scaling_service.numerics.statistics.cycles import Curves
from scaling_service.numerics.statistics.waveforms import (
    WaveformComparison,
    WaveformSettings,
    compare_waveforms,
)


@dataclass(frozen=True, slots=True)
class CohortSettings:
    """How a cohort is compared."""

    alpha: float = 0.05  # of every test of single numbers
    waveforms: WaveformSettings = field(default_factory=WaveformSettings)
    confidence: float = 0.95  # of the intervals of agreement


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
    """Everything that is compared over a cohort, subjects and methods in the order given."""

    subjects: tuple[str, ...]
    methods: tuple[str, ...]  # those that some subject has
    scalars: tuple[ScalarComparison, ...]
    curves: tuple[CurveComparison, ...]
    agreements: tuple[CohortAgreement, ...]
    gates: tuple[GateCount, ...]
    notes: tuple[str, ...]  # what limits all this, plain English

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


_STILL_M = 1e-6  # chosen: what varies less over persons than a micrometre is a constant of its frame

FEWEST = 3
"""Subjects that agreement needs: below, its intervals are not defined."""


@dataclass(frozen=True, slots=True)
class CohortAgreement:
    """A method against a reference."""

    quantity: str  # a length (femur_r), or a joint centre's coordinate in the proximal segment (hip_r.x), m
    result: Agreement
    subjects: tuple[str, ...]  # those that have both
    excluded: tuple[str, ...]  # the others
    reference_sd: float  # over the subjects, m: about zero where the segment's frame fixes the coordinate

    @property
    def varies(self) -> bool:
        """Whether the reference differs between persons at all; else intraclass correlations say nothing."""
        return self.reference_sd > _STILL_M


def agreements(
    subjects: Sequence[SubjectSummary], methods: Sequence[str], confidence: float = 0.95
) -> Iterator[CohortAgreement | str]:
    """Every method's lengths and joint centres against each reference; a sentence where too few have one."""
    for reference in (IMAGED, TRUTH):
        tables = _tables(subjects, reference)
        known = {s for table in tables.values() for s, values in table.items() if reference in values}
        if 0 < len(known) < FEWEST:
            yield (
                f"only {', '.join(sorted(known))} can be compared with {reference}: "
                f"agreement needs {FEWEST} subjects"
            )
        for quantity, table in tables.items():
            for method in methods:
                if method != reference:
                    yield from _agree(quantity, table, method, reference, confidence)


def _agree(
    quantity: str, table: Mapping[str, Mapping[str, float]], method: str, reference: str, confidence: float
) -> Iterator[CohortAgreement]:
    both = {s: values for s, values in table.items() if method in values and reference in values}
    if len(both) >= FEWEST:
        yield CohortAgreement(
            quantity,
            agreement(both, method, reference, quantity=quantity, confidence=confidence),
            tuple(both),
            tuple(s for s in table if s not in both),
            float(np.std([values[reference] for values in both.values()], ddof=1)),
        )


def _tables(subjects: Sequence[SubjectSummary], reference: str) -> dict[str, dict[str, dict[str, float]]]:
    """Quantity to subject to method (the reference among them) to value, m."""
    tables: dict[str, dict[str, dict[str, float]]] = {}
    for subject in subjects:
        for quantity, values in _quantities(subject, reference):
            row = tables.setdefault(quantity, {s.subject: {} for s in subjects})
            row[subject.subject].update(values)
    return tables


def _quantities(subject: SubjectSummary, reference: str) -> Iterator[tuple[str, dict[str, float]]]:
    for method, summary in subject.methods.items():
        yield from ((name, {method: length}) for name, length in summary.lengths.items())
    if reference == TRUTH:
        yield from ((name, {TRUTH: length}) for name, length in subject.true_lengths.items())
    for method, joints in subject.centres.get(reference, {}).items():
        for joint, place in joints.items():
            for axis, value in zip("xyz", place, strict=True):
                yield f"{joint}.{axis}", {method: value}


REFERENCES = ("EB_am", "MB_am")
"""What others are compared to: Puchaud 2019 (section 2.3) takes EB_am; where nobody was imaged, MB_am, which
the paper found to come nearest to it."""


@dataclass(frozen=True, slots=True, eq=False)
class CurveComparison:
    """One joint angle over the gait cycle, over a cohort; curves are (n_nodes,), rad."""

    coordinate: str
    panel: Panel  # who walked and has all methods; the others with the reason
    strides: Mapping[str, int]  # subject to the number of strides behind its curve
    reference: str | None  # pairs are tested against it; None where no reference is there: all pairs are
    mean: Mapping[str, Array]
    sd: Mapping[str, Array]  # n - 1; empty for a single subject
    test: WaveformComparison | None  # repeated-measures ANOVA by permutation, and the pairs after it
    note: str = ""  # why there is no test, or why it could not have found anything


def compare_curves(
    subjects: Sequence[SubjectSummary],
    methods: Sequence[str],
    seed: int,
    settings: WaveformSettings | None = None,
) -> Iterator[CurveComparison]:
    """Every joint angle over every panel; each comparison draws rearrangements from a stream of its own."""
    coordinates = dict.fromkeys(c for s in subjects for m in s.methods.values() for c in m.curves)
    for coordinate in coordinates:
        has = {
            s.subject: [name for name, method in s.methods.items() if coordinate in method.curves]
            for s in subjects
        }
        for panel in panels(has, methods):
            rng = stream(seed, "cohort", "curves", coordinate, *panel.methods)
            yield _compare_curve(coordinate, _explained(panel, coordinate, subjects), subjects, rng, settings)


def _explained(panel: Panel, coordinate: str, subjects: Sequence[SubjectSummary]) -> Panel:
    """The panel with the reason of those who did not walk."""
    side = coordinate.rpartition("_")[2]
    reasons = {s.subject: s.no_strides[side] for s in subjects if side in s.no_strides}
    return replace(panel, excluded={s: reasons.get(s, why) for s, why in panel.excluded.items()})


def _compare_curve(
    coordinate: str,
    panel: Panel,
    subjects: Sequence[SubjectSummary],
    rng: np.random.Generator,
    settings: WaveformSettings | None,
) -> CurveComparison:
    counted = [s for s in subjects if s.subject in panel.subjects]
    values = np.array([[s.methods[m].curves[coordinate] for m in panel.methods] for s in counted])
    side = coordinate.rpartition("_")[2]
    reference = next((m for m in REFERENCES if m in panel.methods), None)
    note, test = too_few(panel), None
    if not note:
        curves = Curves(coordinate, tuple(s.subject for s in counted), panel.methods, values)
        test = compare_waveforms(curves, rng, reference=reference, settings=settings)
        note = _undecidable(test)
    return CurveComparison(
        coordinate=coordinate,
        panel=panel,
        strides={s.subject: s.strides[side] for s in counted},
        reference=reference,
        mean={m: values[:, k].mean(axis=0) for k, m in enumerate(panel.methods)} if counted else {},
        sd={m: values[:, k].std(axis=0, ddof=1) for k, m in enumerate(panel.methods)}
        if len(counted) > 1
        else {},
        test=test,
        note=note,
    )


def _undecidable(test: WaveformComparison) -> str:
    """A word where too few subjects make significance impossible."""
    n = len(test.subjects)
    if not test.anova.can_decide:
        return f"{n} subjects are too few for any difference to be significant"
    if any(not pair.test.can_decide for pair in test.pairs):
        return f"{n} subjects are too few for any pair to be significant after {test.n_pairs} comparisons"
    return ""
