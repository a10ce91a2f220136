"""The chapter on the bodies themselves: lengths, joint centres, knee axes, marker shifts."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import plotly.graph_objects as go

from scaling_service.capabilities.scaling.report.data import SubjectData
from scaling_service.documents.results import JointCentre, MethodResult
from scaling_service.report.blocks import Block, Cell, Grid, Heading, Row, Table, Text
from scaling_service.report.figures import Figure, chart, plain
from scaling_service.report.methods import method_columns, number, signed, union, words
from scaling_service.report.page import Section
from scaling_service.report.palette import INK, styles

_FAR = 20.0  # mm; the darkest shade. Chosen: twice what counts as agreeing with an image
_SHIFTED = (
    40.0  # mm; the darkest shade of marker shifts. Chosen: a little less than their usual bound of 50 mm
)


def geometry_section(data: SubjectData) -> Section:
    """Lengths against the image, or the truth, or only beside each other; centres, axes, shifts."""
    return Section("Lengths, joint centres, axes", list(_blocks(data)), new_page=True)


def _blocks(data: SubjectData) -> Iterator[Block]:
    methods = data.document.methods
    reference, title = _reference_lengths(data)
    yield _lengths(data, reference, title)
    yield from _rests_on(methods)
    if reference:
        yield _length_differences(methods, reference, title)
    else:
        yield Text(
            "Neither an image nor the truth is known: the lengths can only be compared with each other."
        )
    if any(_hips(m) for m in methods.values()):
        yield Heading("Hip centres in the pelvis")
        yield from _hip_blocks(data)
    if any(m.knee_axis_deg for m in methods.values()):
        yield _axes(methods)
    moved = {name: m for name, m in methods.items() if any(m.marker_shift_mm.values())}
    if moved:
        yield _shifts(moved)


def _reference_lengths(data: SubjectData) -> tuple[Mapping[str, float], str]:
    """What lengths are held against, mm, and what it is called."""
    if data.document.truth is not None:
        return data.document.truth.segment_lengths_mm, "truth"
    if data.reference is not None:
        lengths = data.document.methods[data.reference].segment_lengths_mm
        return {name: lengths[name] for name in data.imaged_lengths if name in lengths}, "image"
    return {}, ""


def _lengths(data: SubjectData, reference: Mapping[str, float], title: str) -> Table:
    methods = data.document.methods
    names = union(m.segment_lengths_mm for m in methods.values())
    rows = []
    for name in names:
        cells: list[str | Cell] = []
        for method in methods.values():
            value, against = method.segment_lengths_mm.get(name), reference.get(name)
            estimate = method.length_estimates.get(name)
            text = number(value) + (f" ± {number(estimate.sd_mm)}" if estimate is not None else "")
            if value is not None and against is not None:
                cells.append(Cell(f"{text} ({signed(value - against)})", shade=abs(value - against) / _FAR))
            else:
                cells.append(text)
        rows.append(Row(words(name), [*cells, *([number(reference.get(name))] if reference else [])]))
    columns: list[str | Cell] = ["", *method_columns(list(methods)), *([title] if reference else [])]
    note = "± is one standard deviation, from the errors of markers and sizes."
    note += f" In brackets: the difference from the {title}." if reference else ""
    if title == "image":
        note += " Only lengths between imaged joint centres are held against the image."
    return Table("Segment lengths between joint centres, mm", columns, rows, note)


def _rests_on(methods: Mapping[str, MethodResult]) -> Iterator[Block]:
    """What decides the lengths of linear scaling, and where they were measured from."""
    method = next((m for m in methods.values() if m.length_estimates), None)
    if method is None:
        return
    yield Table(
        f"What the lengths of {plain(method.method)} rest on, %",
        ["", "own distances", "other segments", "persons of this size"],
        [
            Row(words(name), [f"{100 * share:.0f}" for share in (e.measured, e.others, e.expected)])
            for name, e in method.length_estimates.items()
        ],
        "A share may be negative where distances of other segments correct a marker that two segments share.",
    )
    if method.person_centres:
        yield Table(
            "Joint centres that distances were measured from",
            ["", "found by", "± forward, up, right, mm"],
            [
                Row(words(name), [plain(centre.source), ", ".join(number(sd) for sd in centre.sd_mm)])
                for name, centre in method.person_centres.items()
            ],
        )


def _length_differences(
    methods: Mapping[str, MethodResult], reference: Mapping[str, float], title: str
) -> Figure:
    known = styles(list(methods))
    names = list(reference)[::-1]
    traces = [
        go.Scatter(
            x=[m.segment_lengths_mm[n] - reference[n] for n in names if n in m.segment_lengths_mm],
            y=[plain(words(n)) for n in names if n in m.segment_lengths_mm],
            mode="markers",
            name=plain(method),
            marker={
                "color": known[method].colour,
                "size": max(17 - 2 * k, 5),
                "symbol": _SYMBOLS[k % len(_SYMBOLS)],
                "line": {"width": 1, "color": "#fff"},
            },
            hovertemplate="%{x:+.1f} mm",
        )
        for k, (method, m) in enumerate(methods.items())
    ]
    figure = chart(
        traces,
        x_title=f"model minus {title}, mm",
        showlegend=True,
        hovermode="closest",
        legend={"orientation": "h", "y": -0.25, "x": 0},
        xaxis_zerolinecolor=INK,
    )
    figure.update_layout(margin={"l": 90, "r": 10, "t": 6, "b": 70})
    return Figure(
        figure,
        f"Differences of lengths from the {title}",
        f"For each segment and method the model's length minus the {title}'s; the table above has them.",
        130 + 32 * len(names),
    )


_SYMBOLS = ("circle", "square", "diamond", "triangle-up", "x")
"""Of each method in turn, each smaller than the one before, so that those in one place all show."""


def _hips(method: MethodResult) -> dict[str, JointCentre]:
    return {n: c for n, c in method.joint_centres_mm.items() if n.startswith("hip") and c.frame == "pelvis"}


def _hip_blocks(data: SubjectData) -> Iterator[Block]:
    methods = data.document.methods
    names = union(_hips(m) for m in methods.values())
    imaged = {} if data.reference is None else _hips(methods[data.reference])
    rows = []
    for name in names:
        rows.append(Row(words(name)))
        for method, m in methods.items():
            centre = _hips(m).get(name)
            if centre is not None:
                cells: list[str | Cell] = [f"{v:.1f}" for v in centre.xyz]
                if imaged:
                    gap = math.dist(centre.xyz, imaged[name].xyz)
                    cells.append(Cell(f"{gap:.1f}", shade=gap / _FAR))
                rows.append(Row(Cell(method, colour=styles(list(methods))[method].colour), cells))
    columns = ["", "x forward", "y up", "z right", *(["from the image"] if imaged else [])]
    yield Table(
        "Hip centres in the frame of the pelvis, mm",
        columns,
        rows,
        "Origin half-way between the front spines in the built-in models; models from files keep their own.",
    )
    yield Grid(
        [
            _hip_view(methods, 2, 0, "Seen from above", "z, right, mm", "x, forward, mm"),
            _hip_view(methods, 2, 1, "Seen from behind", "z, right, mm", "y, up, mm"),
        ]
    )


def _hip_view(
    methods: Mapping[str, MethodResult], across: int, up: int, title: str, x_title: str, y_title: str
) -> Figure:
    known = styles(list(methods))
    traces = []
    for k, (method, m) in enumerate(methods.items()):
        centres = [c.xyz for c in _hips(m).values()]
        traces.append(
            go.Scatter(
                x=[c[across] for c in centres],
                y=[c[up] for c in centres],
                mode="markers",
                name=plain(method),
                marker={
                    "color": known[method].colour,
                    "size": max(17 - 2 * k, 5),
                    "symbol": _SYMBOLS[k % len(_SYMBOLS)],
                    "line": {"width": 1, "color": "#fff"},
                },
                hovertemplate="%{x:.1f}, %{y:.1f} mm",
            )
        )
    figure = chart(
        traces,
        x_title=x_title,
        y_title=y_title,
        hovermode="closest",
        showlegend=True,
        legend={"orientation": "h", "y": -0.3, "x": 0},
        yaxis_scaleanchor="x",
    )
    figure.update_layout(margin={"l": 50, "r": 10, "t": 6, "b": 80})
    return Figure(
        figure,
        title,
        f"Hip centres of all methods in the pelvis, {title.lower()}; the numbers are in the table.",
        280,
    )


def _axes(methods: Mapping[str, MethodResult]) -> Table:
    sides = union(m.knee_axis_deg for m in methods.values())
    rows = []
    for side in sides:
        for axis in ("x", "y"):
            cells = [
                signed(getattr(m.knee_axis_deg[side], axis)) if side in m.knee_axis_deg else "–"
                for m in methods.values()
            ]
            name = {"r": "right", "l": "left"}.get(side, side)
            rows.append(Row(f"{name}, about {axis}", cells))
    return Table(
        "Knee axes: turned from the thigh's z axis, degrees",
        ["", *method_columns(list(methods))],
        rows,
        "Over 26 persons the turns were within 2° on average and 2 to 4° SD (Puchaud 2019, table 3).",
    )


def _shifts(methods: Mapping[str, MethodResult]) -> Table:
    markers = union(m.marker_shift_mm for m in methods.values())
    rows = [
        Row(
            marker,
            [
                Cell(number(shift), shade=None if shift is None else shift / _SHIFTED)
                for shift in (m.marker_shift_mm.get(marker) for m in methods.values())
            ],
        )
        for marker in markers
    ]
    return Table(
        "Marker shifts: how far the fit moved each marker on its segment, mm",
        ["marker", *method_columns(list(methods))],
        rows,
        "Over 26 persons: 5.6 ± 12.7 mm (MB_lam), 12.3 ± 9.8 mm (MB_am), 6.3 ± 7.8 mm (EB_am; Puchaud 2019, "
        "section 3.1).",
    )
