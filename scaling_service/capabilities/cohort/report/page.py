"""The report of a cohort: what it shows, then the numbers that say so."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from scaling_service.capabilities.cohort.document import CohortDocument, SubjectEntry
from scaling_service.capabilities.cohort.report.agreement import agreement_blocks
from scaling_service.capabilities.cohort.report.angles import angle_blocks
from scaling_service.capabilities.cohort.report.quantities import (
    DEG,
    MM,
    Unit,
    dots,
    quantity_table,
    quantity_words,
)
from scaling_service.capabilities.cohort.report.summary import summary_blocks
from scaling_service.capabilities.cohort.scalars import ScalarComparison
from scaling_service.capabilities.cohort.statistics import CohortStatistics
from scaling_service.report.blocks import Block, Bullets, Details, Grid, Row, Table
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
    """The page of a cohort.

    Parameters
    ----------
    document : CohortDocument
        Who the subjects are and how each ended.
    found : CohortStatistics
        Over those that are done.
    """
    return Page(
        "Scaling methods compared over a cohort",
        [
            Section("What this cohort shows", list(summary_blocks(found))),
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
        Section("Agreement", list(agreement_blocks(found.agreements)), new_page=True),
    ]
    truth = [b for kind, title, unit in _TRUTH for b in _quantity_blocks(found, kind, title, unit)]
    return [*sections, *([Section("Distance from the truth", truth, new_page=True)] if truth else [])]


def _quantity_blocks(found: CohortStatistics, kind: str, title: str, unit: Unit) -> Iterator[Block]:
    scalars = [s for s in found.scalars if s.kind == kind and s.mean]
    if not scalars:
        return
    yield quantity_table(f"{title} (mean ± SD over subjects)", scalars, unit, _excluded(scalars))
    first = {s.quantity: s for s in reversed(scalars)}  # the comparison of most methods comes first
    figures = [
        dots(s, unit, f"{title}, {quantity_words(name)}")
        for name, s in reversed(first.items())
        if len(s.values) > 1
    ]
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
    return "; ".join(
        text
        for text in (subject.reason, left_out, "kept from an earlier run" if subject.kept else "")
        if text
    )
