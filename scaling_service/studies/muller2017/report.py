"""The page of Muller 2017 done again: claims first, then figures 7, 8 and 10, then what only truth tells."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
import plotly.graph_objects as go

from scaling_service.capabilities.kinetics.inverse_dynamics import COMPONENTS
from scaling_service.report.blocks import Block, Cell, Grid, Legend, Page, Row, Section, Table, Text
from scaling_service.report.figures import Figure, draw_grouped_bars, make_chart
from scaling_service.report.methods import FAINT, INK
from scaling_service.studies.claims import build_study_page
from scaling_service.studies.muller2017.document import Muller2017Document, PersonEntry, PropagatedEntry

_BLUE, _ORANGE = "#0072B2", "#D55E00"  # Okabe & Ito 2008

_BARS = (
    ("residual", INK, "solid"),
    ("uncertainty", FAINT, "solid"),
    ("SD by the markers' errors", _BLUE, "solid"),
    ("true error of the measurement", _ORANGE, "solid"),
)
"""Of figure 10: names, colours and the legend's lines."""

_AXES = "X forward, Y up, Z right: the paper's vertical Fz and Mz are fy and my here."


_MEANS = (
    ("Residual dr", "dr"),
    ("Uncertainty, eq. 12", "total"),
    ("SD by the markers' errors", "markers_sd"),
    ("True error of the measurement", "true_measurement_error"),
    ("True error of the inertia", "true_inertial_error"),
)


def build_page(document: Muller2017Document) -> Page:
    """The page of the study, all from ``study.json``."""
    persons = document.persons
    return build_study_page(
        "Muller et al. 2017",
        document,
        [
            Section("The paper's figures", list(_build_figures(persons)), new_page=True),
            Section("What only virtual persons can tell", list(_build_truth(persons)), new_page=True),
            Section("Where the uncertainty comes from", list(_build_sources(persons)), new_page=True),
            *(
                [Section("Real recordings", _tabulate_real(document.recordings))]
                if document.recordings
                else []
            ),
        ],
    )


def make_tables(document: Muller2017Document) -> list[Table]:
    """Means over persons, and real recordings."""
    return [_tabulate_means(document.persons), *_tabulate_real(document.recordings)]


def _format_percent(shares: Iterable[float]) -> list[str]:
    return [f"{100 * share:.2f}" for share in shares]


def _build_figures(persons: Sequence[PersonEntry]) -> Iterator[Block]:
    yield Text(_AXES, quiet=True)
    yield Grid([_draw_growth(persons, k) for k in range(len(COMPONENTS))])
    yield _draw_boxes(persons)
    yield Legend(_BARS)
    yield Grid([_draw_beside(person) for person in persons])


def _draw_growth(persons: Sequence[PersonEntry], k: int) -> Figure:
    """Figure 7: dispersion against added error, each person's points and line."""
    traces = []
    for person in persons:
        x = [level.added_mm / 10.0 for level in person.levels]
        traces.append(
            go.Scatter(
                x=x,
                y=[level.dispersion[k] for level in person.levels],
                mode="markers",
                marker={"color": INK, "size": 4},
                hoverinfo="skip",
            )
        )
        ends = [0.0, max(x)]
        traces.append(
            go.Scatter(
                x=ends,
                y=[person.slopes_per_cm[k] * end for end in ends],
                mode="lines",
                line={"color": _BLUE, "width": 1},
                hoverinfo="skip",
            )
        )
    name = COMPONENTS[k]
    steepest = max(person.slopes_per_cm[k] for person in persons)
    figure = make_chart(traces, x_title="added error, cm", y_title=name, hovermode=False)
    said = (
        f"Dispersion of {name} grows with the added reconstruction error, by at most {steepest:.3f} per cm."
    )
    return Figure(figure, f"Figure 7, {name}: dispersion against added reconstruction error", said, 220)


def _draw_boxes(persons: Sequence[PersonEntry]) -> Figure:
    """Figure 8: slopes over persons."""
    slopes = np.array([person.slopes_per_cm for person in persons])
    traces = [
        go.Box(y=slopes[:, k].tolist(), name=name, marker={"color": _BLUE}, boxpoints="all")
        for k, name in enumerate(COMPONENTS)
    ]
    described = "; ".join(f"{n} {np.median(slopes[:, k]):.3f}" for k, n in enumerate(COMPONENTS))
    figure = make_chart(traces, y_title="slope, 1/cm", hovermode="closest")
    return Figure(figure, "Figure 8: slopes over persons", f"Median slopes per cm: {described}.", 300)


def _draw_beside(person: PersonEntry) -> Figure:
    """Figure 10: residuals beside their uncertainty, and what the truth adds; a scale of powers of ten."""
    values = (person.dr, person.total, person.markers_sd, person.true_measurement_error)
    series = [(name, colour, row) for (name, colour, _), row in zip(_BARS, values, strict=True)]
    figure = draw_grouped_bars(
        COMPONENTS,
        series,
        y_title="share of weight",
        yaxis={"type": "log", "dtick": 1, "gridcolor": "#e4e7eb", "fixedrange": True, "automargin": True},
    )
    said = "; ".join(f"{name}: {', '.join(f'{v:.4f}' for v in values)}" for name, _, values in series)
    return Figure(figure, f"Figure 10, {person.name}", f"{said}.", 260)


def _tabulate_means(persons: Sequence[PersonEntry]) -> Table:
    rows = [
        Row(title, _format_percent(np.mean([getattr(person, name) for person in persons], axis=0)))
        for title, name in _MEANS
    ]
    coverage = 100 * np.mean([person.coverage for person in persons], axis=0)
    rows.append(Row("True errors within 1.96 SD, % of frames", [f"{c:.1f}" for c in coverage]))
    return Table(
        caption="Means over persons, % of weight and of weight times stature",
        columns=["", *COMPONENTS],
        rows=rows,
        note=_AXES,
    )


def _build_truth(persons: Sequence[PersonEntry]) -> Iterator[Block]:
    yield _tabulate_means(persons)
    for title, name in (
        ("Identified beside the tables", "identified_beside_tables"),
        ("Identified with hardly any tables", "identified_freely"),
    ):
        yield _tabulate_identified(title, [getattr(person, name) for person in persons])


def _tabulate_identified(title: str, entries: Sequence[object]) -> Table:
    rows = []
    for said, before, after in (
        ("held-out residual", "residual_before", "residual_after"),
        ("true held-out error of inertia", "true_error_before", "true_error_after"),
    ):
        first, second = (np.array([getattr(e, name) for e in entries]) for name in (before, after))
        for label, values in (("before", first), ("after", second)):
            rows.append(Row(f"{said}, {label}", [f"{100 * m:.3f}" for m in values.mean(axis=0)]))
        better = (second < first).sum(axis=0)
        rows.append(Row(f"{said}, persons better", [f"{k} of {len(entries)}" for k in better]))
    return Table(caption=f"{title}, against the verdict: means, %", columns=["", *COMPONENTS], rows=rows)


def _tabulate_real(recordings: Sequence[PropagatedEntry]) -> list[Table]:
    return [
        Table(
            caption=f"{recording.name}: {recording.reconstruction_error_mm:.1f} mm over {recording.frames} "
            "frames",
            columns=["", *COMPONENTS],
            rows=[
                Row("residual dr, %", _format_percent(recording.dr)),
                Row("uncertainty, %", _format_percent(recording.total)),
                Row("slope per cm", [f"{v:.4f}" for v in recording.slopes_per_cm]),
                Row("R2", [f"{v:.3f}" for v in recording.r2]),
            ],
            note=recording.verdict,
        )
        for recording in recordings
    ]


def _build_sources(persons: Sequence[PersonEntry]) -> Iterator[Block]:
    person = persons[0]
    yield Table(
        caption=f"Markers that carry most of the uncertainty, {person.name}: % of the variance",
        columns=["marker", "own error, mm", *COMPONENTS],
        rows=[
            Row(m.marker, [f"{m.sd_mm:.1f}", *(Cell(f"{100 * s:.1f}", shade=4 * s) for s in m.shares)])
            for m in person.markers
        ],
        note="A segment's common error is divided among its markers.",
    )
    yield Table(
        caption=f"Windows worth calibrating with, the best first, {person.name}",
        columns=["window, s", "information, nats", "force SD, % of weight"],
        rows=[
            Row(f"{w.start_s:.1f} to {w.stop_s:.1f}", [f"{w.gain:.2f}", f"{100 * w.uncertainty:.2f}"])
            for w in person.windows
        ],
        note=f"Together {100 * person.windows_share:.0f} % of what the whole recording tells of the inertia.",
    )
