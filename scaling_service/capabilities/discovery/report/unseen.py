"""The fourth picture: whether the gap closes on recordings that fitted nothing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import plotly.graph_objects as go

from scaling_service.capabilities.discovery.document import DiscoveryDocument, GapDocument, LevelDocument
from scaling_service.capabilities.discovery.report.data import DiscoveryData
from scaling_service.capabilities.discovery.report.style import AFTER, BEFORE, CEILING, FLOOR, digits
from scaling_service.report.blocks import Block, Cell, Grid, Row, Table, Text
from scaling_service.report.figures import Figure, chart
from scaling_service.report.page import Section

_KINDS = (
    ("whitened", "All together, each divided by its floor", "times the floor"),
    ("markers_mm", "Markers", "mm"),
    ("force_N", "Ground force", "N"),
    ("moment_Nm", "Moment", "N m"),
)


def unseen_section(data: DiscoveryData) -> Section:
    """Before, after, floor and ceiling on both kinds of recordings."""
    return Section("4. On unseen data", list(_blocks(data.document)), new_page=True)


def _blocks(document: DiscoveryDocument) -> Iterator[Block]:
    yield Text(
        f"What fits the recordings that it was fitted to is no proof. {_unseen(document)} Ceiling: what a "
        "black-box correction with as many numbers reaches, which knows nothing of bodies."
    )
    found = [kind for kind in _KINDS if getattr(document.gap.held_out, kind[0]) is not None]
    gaps = _gaps(document)
    yield Grid([_figure(gaps, *kind) for kind in found])
    yield from _absorbed(document.gap.held_out)
    yield _places(gaps)


def _unseen(document: DiscoveryDocument) -> str:
    if document.held_out_trials:
        held = ", ".join(document.held_out_trials)
        return f"The right half of each picture shows recordings that fitted nothing: {held}."
    return (
        "No recording was held out: effects had to prove themselves on blocks of time that did not fit them, "
        "and the picture shows the recordings that were fitted."
    )


def _gaps(document: DiscoveryDocument) -> dict[str, GapDocument]:
    """Role of recordings to their gap; one only where none was held out."""
    found = {"used to fit": document.gap.fit}
    return found | ({"held out": document.gap.held_out} if document.held_out_trials else {})


def _figure(gaps: Mapping[str, GapDocument], kind: str, title: str, unit: str) -> Figure:
    every: list[tuple[str, LevelDocument | None]] = [(name, getattr(g, kind)) for name, g in gaps.items()]
    roles = [(name, level) for name, level in every if level is not None]
    x = [name for name, _ in roles]
    levels = [level for _, level in roles]
    bars = (
        ("before", BEFORE, [v.before for v in levels]),
        ("after", AFTER, [v.after for v in levels]),
        ("ceiling", CEILING, [v.ceiling for v in levels]),
        ("floor", FLOOR, [v.floor for v in levels]),
    )
    traces = [
        go.Bar(
            x=x, y=values, name=name, marker={"color": colour},
            error_y=_error(levels) if name == "after" else None,
            text=[digits(v) for v in values], textposition="outside" if name == "floor" else "inside",
            insidetextanchor="start", textangle=0, textfont={"size": 10}, cliponaxis=False,
            hovertemplate="%{y:.3g}",
        )
        for name, colour, values in bars
    ]  # fmt: skip
    figure = chart(
        traces, y_title=f"RMS, {unit}", barmode="group", bargap=0.25, showlegend=True,
        legend={"orientation": "h", "y": -0.16, "x": 0}, margin={"l": 50, "r": 8, "t": 18, "b": 60},
        yaxis_rangemode="tozero",
    )  # fmt: skip
    said = "; ".join(
        f"{name}: {digits(v.before)} before, {digits(v.after)} after, floor {digits(v.floor)}"
        for name, v in roles
    )
    return Figure(figure, f"{title}, {unit}", f"{said} {unit}.", 290)


def _error(levels: list[LevelDocument]) -> dict[str, object]:
    """The 95 % interval as lengths to either side."""
    above = [0.0 if v.high is None or v.after is None else max(v.high - v.after, 0.0) for v in levels]
    below = [0.0 if v.low is None or v.after is None else max(v.after - v.low, 0.0) for v in levels]
    return {"type": "data", "symmetric": False, "array": above, "arrayminus": below, "thickness": 1.5}


def _absorbed(gap: GapDocument) -> Iterator[Block]:
    """Naming against letting the calibration swallow it."""
    level = gap.whitened
    if gap.absorbed is None or level is None or level.after is None:
        return
    verdict = "naming does better" if level.after < gap.absorbed else "naming does no better"
    yield Text(
        f"Were it absorbed by segment sizes, knee axes and marker places instead of named, "
        f"{digits(gap.absorbed)} times the floor would be left on what did not fit it, against "
        f"{digits(level.after)}: {verdict}."
    )


def _places(gaps: Mapping[str, GapDocument]) -> Table:
    """Place by place; the gap closed is what of before minus floor is gone."""
    last = list(gaps.values())[-1].places
    order = sorted(last, key=lambda name: -_ratio(last[name]))
    rows = [
        Row(f"{name}, {last[name].unit}", [c for g in gaps.values() for c in _cells(g.places, name)])
        for name in order
    ]
    columns = [f"{role}: before" if k == 0 else c for role in gaps for k, c in enumerate(_COLUMNS)]
    return Table(
        f"Place by place: {', then '.join(gaps)}",
        ["place", *columns],
        rows,
        "Closed: the share of what stood above the floor that is gone; none where hardly anything did.",
    )


_COLUMNS = ("before", "after", "floor", "closed")


def _ratio(level: LevelDocument) -> float:
    return (level.before or 0.0) / (level.floor or 1.0)


def _cells(places: Mapping[str, LevelDocument], name: str) -> list[str | Cell]:
    level = places.get(name)
    if level is None:
        return ["–"] * 4
    closed = _closed(level)
    told = Cell(
        "–" if closed is None else f"{closed:.0%}", shade=None if closed is None else max(closed, 0.0)
    )
    return [digits(level.before), digits(level.after), digits(level.floor), told]


def _closed(level: LevelDocument) -> float | None:
    if level.before is None or level.after is None or level.floor is None:
        return None
    room = level.before - level.floor
    return (level.before - level.after) / room if room > 0.2 * level.floor else None
