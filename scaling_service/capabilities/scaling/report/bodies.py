"""The chapters on the bodies: how closely each follows the markers; lengths, centres, axes, shifts."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import plotly.graph_objects as go

from scaling_service.capabilities.scaling.comparison.curves import Curves
from scaling_service.capabilities.scaling.report.tables import (
    FAR_MM,
    Methods,
    tabulate_axes,
    tabulate_errors,
    tabulate_lengths,
)
from scaling_service.documents.results import ComparisonDocument, JointCentre, MethodResult
from scaling_service.report.blocks import Block, Cell, Grid, Heading, Row, Section, Table, Text
from scaling_service.report.figures import Figure, draw_lines, escape_plain, make_chart
from scaling_service.report.methods import (
    INK,
    list_method_columns,
    list_styles,
    make_method_legend,
    number,
    spell_name,
    unite_keys,
)

_ROLES = (("evaluation", "Held out: never fitted"), ("calibration", "Used to fit"))
_DARKEST = 30.0  # mm; chosen: beyond it a marker is lost rather than badly followed
_SHIFTED = 40.0  # mm; of marker shifts. Chosen: a little less than their usual bound of 50 mm
_SYMBOLS = ("circle", "square", "diamond", "triangle-up", "x")
"""Of each method in turn, each smaller than the one before, so that those in one place all show."""


def build_errors_section(methods: Methods, curves: Sequence[Curves]) -> Section:
    """Mean errors of all trials, errors over time and per marker; held-out and fitted trials apart."""
    return Section("Distance to the measured markers", list(_build_errors(methods, curves)), new_page=True)


def _build_errors(methods: Methods, curves: Sequence[Curves]) -> Iterator[Block]:
    trials = {role: _list_trials(methods, role) for role, _ in _ROLES}
    if not any(trials.values()):
        yield Text("No movement was recorded, so there is nothing to follow.")
        return
    yield Text(
        "Fitted trials flatter a fit. Held-out ones do less, above all where they show another movement than "
        "the fitted ones: skin that slides the same way in both is not found out."
    )
    yield tabulate_errors(methods)
    yield make_method_legend(list(methods))
    for role, title in _ROLES:
        drawn = [c for c in curves if c.held_out == (role == "evaluation")]
        per_marker = {name: _average_per_marker(m, trials[role]) for name, m in methods.items()}
        if drawn or any(per_marker.values()):
            yield Heading(title)
        if drawn:
            yield Grid([_draw_over_time(curve) for curve in drawn])
        if any(per_marker.values()):
            yield _tabulate_heat_map(
                f"{title}: mean distance per marker, mm",
                per_marker,
                _DARKEST,
                "Mean over the trials that show the marker. The darker, the further.",
            )


def _list_trials(methods: Methods, role: str) -> list[str]:
    return unite_keys(
        {t: e for t, e in m.kinematic_error_mm.items() if e.role == role} for m in methods.values()
    )


def _draw_over_time(curve: Curves) -> Figure:
    said = ", ".join(f"{name} {np.nanmean(values):.1f}" for name, values in curve.values.items())
    drawn = make_chart(
        draw_lines(curve.x, curve.values),
        x_title="time, s",
        y_title="mean distance, mm",
        yaxis_rangemode="tozero",
    )
    return Figure(
        drawn,
        curve.trial,
        f"Mean distance between measured and model markers over time in {curve.trial}, mm. Means: {said}.",
        220,
    )


def _average_per_marker(method: MethodResult, trials: Sequence[str]) -> dict[str, float]:
    """Marker to the mean over trials, mm."""
    errors = [method.kinematic_error_mm[t].per_marker for t in trials if t in method.kinematic_error_mm]
    seen = {marker: [error[marker] for error in errors if marker in error] for marker in unite_keys(errors)}
    return {marker: sum(values) / len(values) for marker, values in seen.items()}


def _tabulate_heat_map(
    caption: str, values: Mapping[str, Mapping[str, float]], darkest: float, note: str
) -> Table:
    """A value of each marker by method, the larger the darker."""
    rows = []
    for marker in unite_keys(values.values()):
        known = [own.get(marker) for own in values.values()]
        cells = [Cell(number(v), shade=None if v is None else v / darkest) for v in known]
        rows.append(Row(marker, cells))
    return Table(
        caption=caption, columns=["marker", *list_method_columns(list(values))], rows=rows, note=note
    )


def build_geometry_section(
    document: ComparisonDocument, imaged: str | None, imaged_lengths: Sequence[str]
) -> Section:
    """Lengths against the image, or the truth, or only beside each other; centres, axes, shifts.

    ``imaged``: the method whose lengths and joint centres are the image's.
    ``imaged_lengths``: segment lengths between imaged joint centres.
    """
    blocks = list(_build_geometry(document, imaged, imaged_lengths))
    return Section("Lengths, joint centres, axes", blocks, new_page=True)


def _build_geometry(
    document: ComparisonDocument, imaged: str | None, imaged_lengths: Sequence[str]
) -> Iterator[Block]:
    methods = document.methods
    reference: Mapping[str, float] = {}
    title = ""
    if document.truth is not None:
        reference, title = document.truth.segment_lengths_mm, "truth"
    elif imaged is not None:
        lengths = methods[imaged].segment_lengths_mm
        reference, title = {name: lengths[name] for name in imaged_lengths if name in lengths}, "image"
    yield tabulate_lengths(methods, reference, title)
    yield from _build_sources(methods)
    if reference:
        yield _draw_length_differences(methods, reference, title)
    else:
        yield Text(
            "Neither an image nor the truth is known: the lengths can only be compared with each other."
        )
    hips = {name: _list_hips(m) for name, m in methods.items()}
    if any(hips.values()):
        yield Heading("Hip centres in the pelvis")
        yield _tabulate_hips(hips, {} if imaged is None else hips[imaged])
        yield Grid(
            [
                _draw_hips(hips, 0, "Seen from above", "x, forward, mm"),
                _draw_hips(hips, 1, "Seen from behind", "y, up, mm"),
            ]
        )
    if any(m.knee_axis_deg for m in methods.values()):
        yield tabulate_axes(methods)
    moved = {name: m.marker_shift_mm for name, m in methods.items() if any(m.marker_shift_mm.values())}
    if moved:
        yield _tabulate_heat_map(
            "Marker shifts: how far the fit moved each marker on its segment, mm",
            moved,
            _SHIFTED,
            "Over 26 persons: 5.6 ± 12.7 mm (MB_lam), 12.3 ± 9.8 mm (MB_am), 6.3 ± 7.8 mm (EB_am; Puchaud "
            "2019, section 3.1).",
        )


def _build_sources(methods: Methods) -> Iterator[Block]:
    """What decides the lengths of linear scaling, and where they were measured from."""
    method = next((m for m in methods.values() if m.length_estimates), None)
    if method is None:
        return
    yield Table(
        caption=f"What the lengths of {escape_plain(method.method)} rest on, %",
        columns=["", "own distances", "other segments", "persons of this size"],
        rows=[
            Row(spell_name(name), [f"{100 * share:.0f}" for share in (e.measured, e.others, e.expected)])
            for name, e in method.length_estimates.items()
        ],
        note="A share may be negative where distances of other segments correct a marker that two "
        "segments share.",
    )


def _draw_length_differences(methods: Methods, reference: Mapping[str, float], title: str) -> Figure:
    names = list(reference)[::-1]
    points = {
        method: [
            (m.segment_lengths_mm[n] - reference[n], escape_plain(spell_name(n)))
            for n in names
            if n in m.segment_lengths_mm
        ]
        for method, m in methods.items()
    }
    figure = _scatter(points, "%{x:+.1f} mm", f"model minus {title}, mm", "", -0.25)
    figure.update_layout(margin={"l": 90, "r": 10, "t": 6, "b": 70}, xaxis_zerolinecolor=INK)
    return Figure(
        figure,
        f"Differences of lengths from the {title}",
        f"For each segment and method the model's length minus the {title}'s; the table above has them.",
        130 + 32 * len(names),
    )


def _scatter(
    points: Mapping[str, Sequence[tuple[float, float | str]]],
    hover: str,
    x_title: str,
    y_title: str,
    legend: float,
) -> go.Figure:
    """Places of each method, with its colour and symbol."""
    known = list_styles(list(points))
    traces = [
        go.Scatter(
            x=[x for x, _ in places],
            y=[y for _, y in places],
            mode="markers",
            name=escape_plain(method),
            marker={
                "color": known[method].colour,
                "size": max(17 - 2 * k, 5),
                "symbol": _SYMBOLS[k % len(_SYMBOLS)],
                "line": {"width": 1, "color": "#fff"},
            },
            hovertemplate=hover,
        )
        for k, (method, places) in enumerate(points.items())
    ]
    below = {"orientation": "h", "y": legend, "x": 0}
    return make_chart(
        traces, x_title=x_title, y_title=y_title, showlegend=True, hovermode="closest", legend=below
    )


def _list_hips(method: MethodResult) -> dict[str, JointCentre]:
    return {n: c for n, c in method.joint_centres_mm.items() if n.startswith("hip") and c.frame == "pelvis"}


def _tabulate_hips(hips: Mapping[str, Mapping[str, JointCentre]], imaged: Mapping[str, JointCentre]) -> Table:
    known, rows = list_styles(list(hips)), []
    for name in unite_keys(hips.values()):
        rows.append(Row(spell_name(name)))
        for method, centres in hips.items():
            if name in centres:
                xyz = centres[name].xyz
                sds = centres[name].sd_mm or (math.nan,) * 3
                cells: list[str | Cell] = [
                    f"{v:.1f}" if math.isnan(sd) else f"{v:.1f} ± {sd:.1f}"
                    for v, sd in zip(xyz, sds, strict=True)
                ]
                if imaged:
                    gap = math.dist(xyz, imaged[name].xyz)
                    cells.append(Cell(f"{gap:.1f}", shade=gap / FAR_MM))
                rows.append(Row(Cell(method, colour=known[method].colour), cells))
    return Table(
        caption="Hip centres in the frame of the pelvis, mm",
        columns=["", "x forward", "y up", "z right", *(["from the image"] if imaged else [])],
        rows=rows,
        note="Origin half-way between the front spines in the built-in models; models from files "
        "keep their own.",
    )


def _draw_hips(hips: Mapping[str, Mapping[str, JointCentre]], up: int, title: str, y_title: str) -> Figure:
    points = {name: [(c.xyz[2], c.xyz[up]) for c in centres.values()] for name, centres in hips.items()}
    figure = _scatter(points, "%{x:.1f}, %{y:.1f} mm", "z, right, mm", y_title, -0.3)
    figure.update_layout(margin={"l": 50, "r": 10, "t": 6, "b": 80}, yaxis_scaleanchor="x")
    return Figure(
        figure,
        title,
        f"Hip centres of all methods in the pelvis, {title.lower()}; the numbers are in the table.",
        280,
    )
