"""The report of a cohort: what it shows, then the numbers that say so."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from scaling_service.capabilities.cohort.document import CohortDocument, SubjectEntry
from scaling_service.capabilities.cohort.figures import (
    DEG,
    MM,
    Unit,
    angle_blocks,
    dots,
    quantity_table,
    quantity_words,
)
from scaling_service.capabilities.cohort.groups import ScalarComparison
from scaling_service.capabilities.cohort.statistics import CohortAgreement, CohortStatistics
from scaling_service.capabilities.cohort.summary import IMAGED, TRUTH
from scaling_service.core.text import p_words
from scaling_service.report.blocks import Block, Bullets, Callout, Details, Grid, Row, Table, Text
from scaling_service.report.methods import words
from scaling_service.report.page import Page, Section

_GEOMETRY: tuple[tuple[str, str, Unit], ...] = (
    ("segment_length", "Segment lengths", MM),
    ("knee_axis", "Knee axes, turns from the thigh's z", DEG),
    ("marker_shift", "Marker shifts", MM),
)
_TRUTH: tuple[tuple[str, str, Unit], ...] = (
    ("from_truth_m", "Distance from the truth", MM),
    ("from_truth_rad", "Joint angles, RMS distance from the truth", DEG),
)


def cohort_page(document: CohortDocument, found: CohortStatistics) -> Page:
    """The page of a cohort: its document says who the subjects are, the statistics are over those done."""
    return Page(
        "Scaling methods compared over a cohort",
        [
            Section("What this cohort shows", list(_summary(found))),
            *statistics_sections(found),
            Section("Subjects", list(_subjects(document)), new_page=True),
        ],
        subtitle=document.cohort,
        footer=f"scaling-service {document.code_version}. The numbers are in cohort.json, too.",
    )


def statistics_sections(found: CohortStatistics) -> list[Section]:
    """The chapters that every cohort has: errors, geometry, angles, agreement, and the truth where known."""
    sections = [
        Section("Kinematic errors", list(_quantity_blocks(found, "kinematic_error", "Kinematic error", MM))),
        Section(
            "Lengths, axes, marker shifts",
            [b for kind, title, unit in _GEOMETRY for b in _quantity_blocks(found, kind, title, unit)],
            new_page=True,
        ),
        Section("Joint angles over the gait cycle", list(angle_blocks(found.curves)), new_page=True),
        Section("Agreement", list(_agreement(found.agreements)), new_page=True),
    ]
    truth = [b for kind, title, unit in _TRUTH for b in _quantity_blocks(found, kind, title, unit)]
    return [*sections, *([Section("Distance from the truth", truth, new_page=True)] if truth else [])]


def _quantity_blocks(found: CohortStatistics, kind: str, title: str, unit: Unit) -> Iterator[Block]:
    scalars = [s for s in found.scalars if s.kind == kind and s.mean]
    if not scalars:
        return
    yield quantity_table(f"{title} (mean ± SD over subjects)", scalars, unit, _excluded(scalars))
    first = {s.quantity: s for s in reversed(scalars)}  # the comparison of most methods comes first
    several = [s for s in reversed(first.values()) if len(s.values) > 1]
    figures = [dots(s, unit, f"{title}, {quantity_words(s.quantity)}") for s in several]
    if figures:
        yield Grid(figures)


def _excluded(scalars: Sequence[ScalarComparison]) -> str:
    """Who is not counted, and why."""
    why = {s: reason for scalar in scalars for s, reason in scalar.panel.excluded.items()}
    return "Not counted: " + ", ".join(f"{s} ({reason})" for s, reason in why.items()) + "." if why else ""


def _subjects(document: CohortDocument) -> Iterator[Block]:
    rows = [
        Row(s.id, [s.status, _said(s), ", ".join(s.methods), f"{s.wall_s:.1f}"]) for s in document.subjects
    ]
    yield Table("How every subject ended", ["", "status", "why", "methods", "s"], rows, words=True)
    if document.notes:
        yield Bullets(document.notes)
    settings = [Row(name, [str(value)]) for name, value in document.settings.items()]
    yield Details("Settings", [Table("Settings", ["", ""], settings, f"Seed {document.seed}.", words=True)])


def _said(subject: SubjectEntry) -> str:
    left_out = "; ".join(f"no {method}: {why}" for method, why in subject.left_out.items())
    kept = "kept from an earlier run" if subject.kept else ""
    return "; ".join(text for text in (subject.reason, left_out, kept) if text)


def _summary(found: CohortStatistics) -> Iterator[Block]:
    """The headline, what it rests on, and OpenSim's limits."""
    sentences = [*_errors(found), *_lengths(found), *_nearest(found), *_angles(found)]
    yield Callout(
        f"{len(found.subjects)} subjects, {len(found.methods)} methods",
        [Bullets(sentences), Text("A small error alone is no proof of a right model: see agreement below.")],
    )
    yield _gates(found)
    if found.notes:
        yield Bullets(found.notes)


def _scalar(found: CohortStatistics, kind: str, quantity: str) -> ScalarComparison | None:
    return next((s for s in found.scalars if (s.kind, s.quantity) == (kind, quantity)), None)


def _errors(found: CohortStatistics) -> Iterator[str]:
    for role, said in (("evaluation", "on held-out trials"), ("calibration", "on trials used to fit")):
        scalar = _scalar(found, "kinematic_error", role)
        if scalar is None or len(scalar.mean) < 2:
            continue
        order = sorted(scalar.mean, key=scalar.mean.__getitem__)
        ranked = ", ".join(f"{m} {MM.factor * scalar.mean[m]:.1f}" for m in order)
        yield f"Kinematic error {said}, mm, smallest first: {ranked}.{_tested(scalar)}"


def _tested(scalar: ScalarComparison) -> str:
    if scalar.test is None:
        return f" Not tested: {scalar.note}."
    said = "The methods differ" if scalar.test.significant else "No difference between methods is found"
    return f" {said} (Friedman p {p_words(scalar.test.p)})."


def _lengths(found: CohortStatistics) -> Iterator[str]:
    tests = [s.test for s in found.scalars if s.kind == "segment_length" and s.test is not None]
    if not tests:
        return
    differ = [words(t.quantity) for t in tests if t.significant]
    yield (
        f"Segment lengths differ between methods for {', '.join(dict.fromkeys(differ))}."
        if differ
        else "No segment length is found to differ between methods."
    )


def _nearest(found: CohortStatistics) -> Iterator[str]:
    """Which method's lengths lie nearest to each reference, by the RMS over lengths and subjects."""
    for reference, said in ((IMAGED, "the image"), (TRUTH, "the truth")):
        squares: dict[str, list[float]] = {}
        for item in found.agreements:
            if item.result.reference == reference and "." not in item.quantity:
                squares.setdefault(item.result.method, []).append(item.result.rmse**2)
        if squares:
            rms = {m: (sum(v) / len(v)) ** 0.5 for m, v in squares.items()}
            order = sorted(rms, key=rms.__getitem__)
            ranked = ", ".join(f"{m} {MM.factor * rms[m]:.1f}" for m in order)
            yield f"Lengths against {said}, RMS in mm, nearest first: {ranked}."


def _angles(found: CohortStatistics) -> Iterator[str]:
    tested = [c for c in found.curves if c.test is not None]
    if not tested:
        return
    differ = [words(c.coordinate) for c in tested if c.test is not None and c.test.anova.significant]
    yield (
        f"Joint angles differ between methods in the gait cycle for {'; '.join(dict.fromkeys(differ))}."
        if differ
        else "No joint angle is found to differ between methods over the gait cycle."
    )


def _gates(found: CohortStatistics) -> Table:
    rows = [
        Row(g.method, [f"{g.subjects_passed} of {g.subjects}", f"{g.trials_passed} of {g.trials}"])
        for g in found.gates
    ]
    return Table(
        "OpenSim's limits for marker errors: RMS below 20 mm, largest below 40 mm",
        ["", "subjects that keep them", "trials that keep them"],
        rows,
        "Necessary, not sufficient: fitted numbers absorb errors.",
    )


def _agreement(agreements: Sequence[CohortAgreement]) -> Iterator[Block]:
    """A table for each reference: lengths first, joint centres when asked for."""
    references = list(dict.fromkeys(item.result.reference for item in agreements))
    if not references:
        yield Text("Too few subjects were imaged, and no truth is known, so agreement cannot be stated.")
        return
    yield Text(
        "Bias is the method minus the reference, with its 95 % interval; 95 % of the differences lie within "
        "the limits (Bland and Altman). ICC is that of absolute agreement."
    )
    for reference in references:
        own = [item for item in agreements if item.result.reference == reference]
        lengths = [item for item in own if "." not in item.quantity]
        centres = [item for item in own if "." in item.quantity]
        name = "the image (EB)" if reference == "EB" else reference
        if lengths:
            yield _table(f"Segment lengths against {name}, mm", lengths)
        if centres:
            yield Details(
                f"Joint centres against {name}", [_table(f"Joint centres against {name}, mm", centres)]
            )


def _table(caption: str, items: Sequence[CohortAgreement]) -> Table:
    rows = []
    for item in items:
        found = item.result.bland_altman
        bias = f"{_signed(found.bias.value)} ({_signed(found.bias.low)} to {_signed(found.bias.high)})"
        limits = f"{_signed(found.lower.value)} to {_signed(found.upper.value)}"
        joint, _, axis = item.quantity.partition(".")
        label = f"{f'{words(joint)} {axis}'.strip()}, {item.result.method}"
        rmse = f"{MM.factor * item.result.rmse:.1f}"
        rows.append(Row(label, [str(len(item.subjects)), bias, limits, rmse, _icc(item)]))
    return Table(caption, ["", "subjects", "bias (95 %)", "limits of agreement", "RMS", "ICC"], rows)


def _signed(metres: float) -> str:
    return f"{MM.factor * metres:+.1f}"


def _icc(item: CohortAgreement) -> str:
    found = item.result.icc_agreement
    if not item.varies or not math.isfinite(found.value):
        return "–"
    interval = f" ({found.low:.2f} to {found.high:.2f})" if math.isfinite(found.low) else ""
    return f"{found.value:.2f}{interval}"
