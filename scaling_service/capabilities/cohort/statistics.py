"""The statistics of a cohort, from its subjects' summaries alone (Puchaud 2019, sections 2.3 and 3)."""

from __future__ import annotations

import dataclasses
import math
from collections import abc

import numpy as np

from scaling_service.capabilities.cohort import groups
from scaling_service.capabilities.cohort import result as documents
from scaling_service.capabilities.cohort import summary as summaries
from scaling_service.core.arrays import Array
from scaling_service.core.streams import stream
from scaling_service.core.text import list_few
from scaling_service.numerics.statistics import agreement, complete
from scaling_service.numerics.statistics import waveforms as statistics_waveforms
from scaling_service.numerics.statistics.permutation_tests import CurveTest

GATE_RMS_M, GATE_MAX_M = 0.02, 0.04
"""OpenSim's guideline for inverse kinematics: marker errors below 2 cm RMS and 2 to 4 cm at most (Hicks et
al. 2015, J Biomech Eng 137:020905; the larger limit is taken). Necessary, not sufficient: fitted
numbers absorb errors."""

REFERENCES = ("EB_am", "MB_am")
"""What joint angles are compared to: Puchaud 2019 (section 2.3) takes EB_am; where nobody was imaged, MB_am,
which the paper found to come nearest to it."""

FEWEST = 3
"""Subjects that agreement needs: below, its intervals are not defined."""

_STILL_MM = 1e-3  # chosen: what varies less over persons than a micrometre is a constant of its frame
_MM = 1e3


@dataclasses.dataclass(frozen=True, slots=True)
class CohortSettings:
    """How a cohort is compared."""

    alpha: float = 0.05  # of every test of single numbers
    waveforms: statistics_waveforms.WaveformSettings = dataclasses.field(
        default_factory=statistics_waveforms.WaveformSettings
    )
    confidence: float = 0.95  # of the intervals of agreement


def compute_cohort_statistics(
    subjects: abc.Sequence[summaries.SubjectSummary],
    methods: abc.Sequence[str],
    *,
    seed: int = 0,
    settings: CohortSettings = CohortSettings(),
) -> documents.StatisticsDocument:
    """Compare methods over a cohort.

    Each comparison is over the subjects that have all its methods; the others are named with it.

    ``subjects``: each under a name of its own; their order changes no number. ``methods``: those of interest,
    in the order to show. ``seed``: of the rearrangements of joint angles.
    """
    # Sorted, so that sums and random numbers meet subjects in one order whatever order they come in.
    ordered = sorted(subjects, key=lambda s: s.subject)
    present = tuple(m for m in methods if any(m in s.methods for s in ordered))
    curves = list(compare_curves(ordered, present, seed, settings.waveforms))
    compared = list(compare_with_references(ordered, present, settings.confidence))
    # What joint angles were compared to, where it is not what the paper takes
    if not curves:
        references = ["no subject has a whole stride: joint angles over the gait cycle are not compared"]
    else:
        used = dict.fromkeys(c.reference for c in curves if c.anova is not None and c.reference != "EB_am")
        references = [
            "joint angles are compared in all pairs: neither EB_am nor MB_am is there"
            if reference is None
            else f"joint angles are compared with {reference}, because not every subject has EB_am"
            for reference in used
        ]
    alike: dict[str, list[str]] = {}
    for one in ordered:
        if one.methods:
            alike.setdefault(repr(one.methods), []).append(one.subject)
    twins = [
        f"{list_few(names)} are one person: all their figures are the same. Their recordings count "
        f"{len(names)} times, so that spreads and p values are too small: leave all but one out"
        for names in alike.values()
        if len(names) > 1
    ]
    gate = []
    for method in present:
        passed = []
        for s in ordered:
            if method in s.methods:
                of = s.methods[method]
                seen = [t for t in of.trials.values() if math.isfinite(t.mean)]
                passed.append([t.rms < GATE_RMS_M and t.max < GATE_MAX_M for t in seen])
        gate.append(
            documents.GateEntry(
                method=method,
                subjects=len(passed),
                subjects_passed=sum(all(trials) for trials in passed),
                trials=sum(len(trials) for trials in passed),
                trials_passed=sum(sum(trials) for trials in passed),
            )
        )
    return documents.StatisticsDocument(
        **groups.compare_quantities(ordered, present, settings.alpha),
        joint_angles=curves,
        agreement=[a for a in compared if isinstance(a, documents.AgreementEntry)],
        opensim_limits=documents.Gates(
            rms_below_mm=GATE_RMS_M * _MM,
            max_below_mm=GATE_MAX_M * _MM,
            methods=gate,
        ),
        notes=[*twins, *references, *(a for a in compared if isinstance(a, str))],
    )


def compare_with_references(
    subjects: abc.Sequence[summaries.SubjectSummary], methods: abc.Sequence[str], confidence: float = 0.95
) -> abc.Iterator[documents.AgreementEntry | str]:
    """Every method's lengths and joint centres against each reference; a sentence where too few have one."""
    for reference in (summaries.IMAGED, summaries.TRUTH):
        # Quantity to subject to method (the reference among them) to value, mm
        tables: dict[str, dict[str, dict[str, float]]] = {}
        for subject in subjects:
            for measured, column, metres in _list_quantities(subject, reference):
                row = tables.setdefault(measured, {s.subject: {} for s in subjects})
                row[subject.subject][column] = _MM * metres
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
    quantity: str,
    table: abc.Mapping[str, abc.Mapping[str, float]],
    method: str,
    reference: str,
    confidence: float,
) -> abc.Iterator[documents.AgreementEntry]:
    both = {s: values for s, values in table.items() if method in values and reference in values}
    if len(both) < FEWEST:
        return
    found = agreement.measure_agreement(both, method, reference, quantity=quantity, confidence=confidence)
    # Where the reference does not differ between persons, intraclass correlations say nothing.
    varies = np.std([values[reference] for values in both.values()], ddof=1) > _STILL_MM
    make = documents.Interval.model_validate
    yield documents.AgreementEntry(
        quantity=quantity,
        method=method,
        reference=reference,
        subjects=list(both),
        excluded=[s for s in table if s not in both],
        bias_mm=make(found.bland_altman.bias),
        sd_mm=found.bland_altman.sd,
        lower_mm=make(found.bland_altman.lower),
        upper_mm=make(found.bland_altman.upper),
        rmse_mm=found.rmse,
        icc_agreement=make(found.icc_agreement) if varies else None,
        icc_consistency=make(found.icc_consistency) if varies else None,
        confidence=confidence,
    )


def _list_quantities(
    subject: summaries.SubjectSummary, reference: str
) -> abc.Iterator[tuple[str, str, float]]:
    """Quantity, method and value: lengths, and joint centres' coordinates in the proximal segment."""
    for method, summary in subject.methods.items():
        yield from ((name, method, length) for name, length in summary.lengths.items())
    if reference == summaries.TRUTH:
        yield from ((name, summaries.TRUTH, length) for name, length in subject.true_lengths.items())
    for method, joints in subject.centres.get(reference, {}).items():
        for joint, place in joints.items():
            for axis, value in zip("xyz", place, strict=True):
                yield f"{joint}.{axis}", method, value


def compare_curves(
    subjects: abc.Sequence[summaries.SubjectSummary],
    methods: abc.Sequence[str],
    seed: int,
    settings: statistics_waveforms.WaveformSettings,
) -> abc.Iterator[documents.CurveEntry]:
    """Every joint angle over every panel; each comparison draws rearrangements from a stream of its own."""
    coordinates = dict.fromkeys(c for s in subjects for m in s.methods.values() for c in m.curves)
    for coordinate in coordinates:
        has = {
            s.subject: [name for name, method in s.methods.items() if coordinate in method.curves]
            for s in subjects
        }
        for panel in complete.list_panels(has, methods):
            rng = stream(seed, "cohort", "curves", coordinate, *panel.methods)
            yield _compare_curve(coordinate, panel, subjects, rng, settings)


def _compare_curve(
    coordinate: str,
    panel: complete.Panel,
    subjects: abc.Sequence[summaries.SubjectSummary],
    rng: np.random.Generator,
    settings: statistics_waveforms.WaveformSettings,
) -> documents.CurveEntry:
    side = coordinate.rpartition("_")[2]
    counted = [s for s in subjects if s.subject in panel.subjects]
    sat = {s.subject: s.no_strides[side] for s in subjects if side in s.no_strides}
    known = dataclasses.replace(panel, excluded={s: sat.get(s, why) for s, why in panel.excluded.items()})
    values = np.array([[s.methods[m].curves[coordinate] for m in panel.methods] for s in counted])
    reference = next((m for m in REFERENCES if m in panel.methods), None)
    note, test = groups.explain_too_few(panel), None
    if not note:
        curves = statistics_waveforms.Curves(coordinate, panel.subjects, panel.methods, values)
        test = statistics_waveforms.compare_waveforms(curves, rng, reference=reference, settings=settings)
        # A note where too few subjects make significance impossible
        n = len(test.subjects)
        if not test.anova.can_decide:
            note = f"{n} subjects are too few for any difference to be significant"
        elif any(not pair.test.can_decide for pair in test.pairs):
            note = f"{n} subjects are too few for any pair to be significant after {test.n_pairs} comparisons"
        else:
            note = ""
    degrees = np.degrees(values)
    return documents.CurveEntry(
        coordinate=coordinate,
        compared=documents.Compared.model_validate(known),
        strides={s.subject: s.strides[side] for s in counted},
        reference=reference,
        mean_deg=_by_method(panel, degrees.mean(axis=0)),
        sd_deg=_by_method(panel, degrees.std(axis=0, ddof=1)) if len(counted) > 1 else {},
        anova=None if test is None else _make_curve_test(test.anova),
        pairs=[
            documents.CurvePairEntry(
                methods=pair.methods,
                difference_mean_deg=np.degrees(pair.difference_mean).tolist(),
                test=_make_curve_test(pair.test),
            )
            for pair in (() if test is None else test.pairs)
        ],
        note=note,
    )


def _by_method(panel: complete.Panel, curves: Array) -> dict[str, list[float]]:
    return dict(zip(panel.methods, curves.tolist(), strict=True))


def _make_curve_test(test: CurveTest) -> documents.CurveTestEntry:
    return documents.CurveTestEntry(
        statistic=test.statistic.tolist(),
        threshold=test.threshold,
        p=test.p,
        alpha=test.alpha,
        significant=test.significant,
        clusters=[
            documents.ClusterEntry(start_percent=c.start, end_percent=c.end, p=c.p) for c in test.clusters
        ],
        rearrangements=test.rearrangements,
        exact=test.exact,
        can_decide=test.can_decide,
    )
