"""What is said of Muller 2017 done again: claims, means, and what only truth tells."""

from __future__ import annotations

from collections import abc

import numpy as np

from scaling_service.capabilities.kinetics.inverse_dynamics import COMPONENTS
from scaling_service.report import tables
from scaling_service.report.summary import Summary
from scaling_service.studies.claims import summarise_study
from scaling_service.studies.muller2017 import result as documents

_AXES = "X forward, Y up, Z right: the paper's vertical Fz and Mz are fy and my here."


_MEANS = (
    ("Residual dr", "dr"),
    ("Uncertainty, eq. 12", "total"),
    ("SD by the markers' errors", "markers_sd"),
    ("True error of the measurement", "true_measurement_error"),
    ("True error of the inertia", "true_inertial_error"),
)


def summarise(document: documents.Muller2017Document) -> Summary:
    """The study in short, with what only virtual persons can tell and where the uncertainty comes from."""
    persons = document.persons
    further = [
        _tabulate_identified("Identified beside the tables", [p.identified_beside_tables for p in persons]),
        _tabulate_identified("Identified with hardly any tables", [p.identified_freely for p in persons]),
        *_make_source_tables(persons[0]),
    ]
    return summarise_study("Muller et al. 2017", document, [*make_tables(document), *further])


def make_tables(document: documents.Muller2017Document) -> list[tables.Table]:
    """Means over persons, and real recordings."""
    rows = [
        tables.Row(
            title, _format_percent(np.mean([getattr(person, name) for person in document.persons], axis=0))
        )
        for title, name in _MEANS
    ]
    coverage = 100 * np.mean([person.coverage for person in document.persons], axis=0)
    rows.append(tables.Row("True errors within 1.96 SD, % of frames", [f"{c:.1f}" for c in coverage]))
    return [
        tables.Table(
            caption="Means over persons, % of weight and of weight times stature",
            columns=["", *COMPONENTS],
            rows=rows,
            note=_AXES,
        ),
        *_tabulate_real(document.recordings),
    ]


def _format_percent(shares: abc.Iterable[float]) -> list[str]:
    return [f"{100 * share:.2f}" for share in shares]


def _tabulate_identified(title: str, entries: abc.Sequence[object]) -> tables.Table:
    rows = []
    for said, before, after in (
        ("held-out residual", "residual_before", "residual_after"),
        ("true held-out error of inertia", "true_error_before", "true_error_after"),
    ):
        first, second = (np.array([getattr(e, name) for e in entries]) for name in (before, after))
        for label, values in (("before", first), ("after", second)):
            rows.append(tables.Row(f"{said}, {label}", [f"{100 * m:.3f}" for m in values.mean(axis=0)]))
        better = (second < first).sum(axis=0)
        rows.append(tables.Row(f"{said}, persons better", [f"{k} of {len(entries)}" for k in better]))
    return tables.Table(
        caption=f"{title}, against the verdict: means, %", columns=["", *COMPONENTS], rows=rows
    )


def _tabulate_real(recordings: abc.Sequence[documents.PropagatedEntry]) -> list[tables.Table]:
    return [
        tables.Table(
            caption=f"{recording.name}: {recording.reconstruction_error_mm:.1f} mm over {recording.frames} "
            "frames",
            columns=["", *COMPONENTS],
            rows=[
                tables.Row("residual dr, %", _format_percent(recording.dr)),
                tables.Row("uncertainty, %", _format_percent(recording.total)),
                tables.Row("slope per cm", [f"{v:.4f}" for v in recording.slopes_per_cm]),
                tables.Row("R2", [f"{v:.3f}" for v in recording.r2]),
            ],
            note=recording.verdict,
        )
        for recording in recordings
    ]


def _make_source_tables(person: documents.PersonEntry) -> abc.Iterator[tables.Table]:
    yield tables.Table(
        caption=f"Markers that carry most of the uncertainty, {person.name}: % of the variance",
        columns=["marker", "own error, mm", *COMPONENTS],
        rows=[
            tables.Row(m.marker, [f"{m.sd_mm:.1f}", *(f"{100 * s:.1f}" for s in m.shares)])
            for m in person.markers
        ],
        note="A segment's common error is divided among its markers.",
    )
    yield tables.Table(
        caption=f"Windows worth calibrating with, the best first, {person.name}",
        columns=["window, s", "information, nats", "force SD, % of weight"],
        rows=[
            tables.Row(f"{w.start_s:.1f} to {w.stop_s:.1f}", [f"{w.gain:.2f}", f"{100 * w.uncertainty:.2f}"])
            for w in person.windows
        ],
        note=f"Together {100 * person.windows_share:.0f} % of what the whole recording tells of the inertia.",
    )
