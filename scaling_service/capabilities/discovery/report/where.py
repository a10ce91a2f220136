"""The first picture: where the model and the recordings disagree, and when."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Literal

import numpy as np
import plotly.graph_objects as go

from scaling_service.capabilities.discovery.document import DisagreementDocument
from scaling_service.capabilities.discovery.report.data import DiscoveryData, HeatMap
from scaling_service.capabilities.discovery.report.style import BEFORE, HEAT, chance, digits
from scaling_service.report.blocks import Block, Cell, Row, Table, Text
from scaling_service.report.figures import Figure, chart, plain
from scaling_service.report.methods import INK
from scaling_service.report.page import Section

_SHOWN = 12
"""Chosen: places in the table; the picture and discovery.json have all."""

_ROW_PX, _LEAST_PX = 15, 150


def where_section(data: DiscoveryData) -> Section:
    """Places ranked with their floors, and when each stands out."""
    return Section("1. Where: model and recordings before", list(_blocks(data)))


def _blocks(data: DiscoveryData) -> Iterator[Block]:
    places = data.document.disagreements
    yield Text(
        "The model follows every recording as closely as it can. What is left over is compared with the "
        "floor: what the noise of the recording itself would leave. Places whose bar ends at the mark are "
        "explained."
    )
    for observable, title, unit in _OBSERVABLES:
        chosen = [p for p in places if p.observable == observable]
        if chosen:
            yield _ranked(chosen, title, unit)
    if places:
        yield _table(places[:_SHOWN], len(places))
    yield from heat_maps(data.maps, "before")


_OBSERVABLES = (("marker", "Markers", "mm"), ("force", "Ground force", "N"), ("moment", "Moment", "N m"))


def _ranked(places: Sequence[DisagreementDocument], title: str, unit: str) -> Figure:
    order = sorted(places, key=lambda p: p.rms)
    names = [plain(p.where) for p in order]
    traces = [
        go.Bar(
            x=[round(p.rms, 3) for p in order], y=names, orientation="h", marker={"color": BEFORE},
            name="left over", hovertemplate=f"%{{x:.1f}} {unit}",
        ),
        go.Scatter(
            x=[p.floor for p in order], y=names, mode="markers", name="floor",
            marker={"symbol": "line-ns", "size": 11, "line": {"width": 3, "color": INK}},
            hovertemplate=f"%{{x:.2f}} {unit}",
        ),
    ]  # fmt: skip
    figure = chart(
        traces, x_title=f"RMS of what is left over, {unit}", hovermode="y unified", bargap=0.25,
        showlegend=True, legend={"orientation": "h", "y": 1.0, "yanchor": "bottom", "x": 0},
        margin={"l": 70, "r": 10, "t": 28, "b": 40}, xaxis_rangemode="tozero",
    )  # fmt: skip
    worst = ", ".join(f"{p.where} {p.rms:.1f}" for p in order[::-1][:3])
    return Figure(
        figure,
        f"{title}: what is left over, and its floor (black marks)",
        f"Bars of all places, the largest first: {worst} {unit}.",
        max(_LEAST_PX, 90 + 18 * len(order)),
    )


def _table(places: Sequence[DisagreementDocument], total: int) -> Table:
    rows = [
        Row(
            p.where,
            [
                f"{digits(p.rms)} {p.unit}",
                f"{digits(p.floor)} {p.unit}",
                Cell("–" if p.share is None else f"{p.share:.0%}", shade=p.share),
                chance(p.p),
                p.when or "–",
                p.along or "–",
            ],
        )
        for p in places
    ]
    more = (
        f" The first {len(places)} of {total}; the others are in discovery.json."
        if total > len(places)
        else ""
    )
    return Table(
        "Where, when, and along with what",
        ["place", "left over", "floor", "share", "by chance", "most", "follows"],
        rows,
        f"Share: of all that stands above the floors. By chance: p over all places looked at.{more}",
    )


def heat_maps(maps: Sequence[HeatMap], which: Literal["before", "after"]) -> Iterator[Block]:
    """Places against time, one recording after the other; before and after have the same colours."""
    for unit, name, colours in _UNITS:
        chosen = [m for m in maps if m.unit == unit]
        top = _darkest(chosen)
        for heat in chosen:
            if top > 0.0:
                yield _heat_map(heat, which, top, name, colours)


def _darkest(maps: Sequence[HeatMap]) -> float:
    """What is drawn darkest: what only a few places and times exceed, so that these do not hide the rest."""
    known = [m.before[np.isfinite(m.before)] for m in maps]
    every = np.concatenate(known) if known else np.zeros(0)
    return float(np.percentile(every, _DARKEST)) if len(every) else 0.0


_DARKEST = 98.0
"""Per cent of places and times that are lighter than the darkest (chosen)."""

_UNITS = (("mm", "distance from the model", "mm"), ("floors", "wrench over its floor", "times"))


def _heat_map(heat: HeatMap, which: Literal["before", "after"], top: float, name: str, unit: str) -> Figure:
    values = heat.before if which == "before" else heat.after
    trace = go.Heatmap(
        x=np.round(heat.times, 3), y=[plain(p) for p in heat.places],
        z=np.round(values, 2).astype(np.float32),
        zmin=0.0, zmax=top, colorscale=HEAT, colorbar={"title": {"text": unit}, "thickness": 12, "len": 1.0},
        hovertemplate=f"%{{y}} at %{{x:.2f}} s: %{{z:.1f}} {unit}<extra></extra>",
    )  # fmt: skip
    figure = chart(
        [trace], x_title="time, s", hovermode="closest", yaxis_autorange="reversed",
        yaxis_tickfont={"size": 10}, yaxis_dtick=1, margin={"l": 70, "r": 8, "t": 6, "b": 38},
    )  # fmt: skip
    role = "held out" if heat.held_out else "used to fit"
    words = "before" if which == "before" else "with what was named"
    return Figure(
        figure,
        f"{heat.trial} ({role}), {words}: {name}; darkest {digits(top)} {unit} or more",
        f"{name} of {len(heat.places)} places over time in {heat.trial}, {words}; the most is "
        f"{np.nanmax(values) if np.isfinite(values).any() else 0.0:.1f} {unit}.",
        max(_LEAST_PX, 60 + _ROW_PX * len(heat.places)),
    )
