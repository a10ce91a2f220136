"""Figures of plotly as blocks of a page: drawn when they come into sight, static and resized in print."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
import plotly.graph_objects as go

from scaling_service.model.results import Array
from scaling_service.report.methods import FAINT, INK, list_styles

FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, sans-serif"


@dataclass(frozen=True, slots=True, eq=False)
class Figure:
    """A plotly figure with its caption.

    ``description``: what it shows, for readers who do not see it.
    ``height``: int, px.
    """

    figure: go.Figure
    caption: str
    description: str
    height: int = 260

    def html(self) -> str:
        """One ``figure``: a place to draw in, and what to draw as JSON that no browser executes."""
        return (
            f'<figure class="figure"><figcaption>{escape(self.caption)}</figcaption>'
            f'<div class="plot" role="img" aria-label="{escape(self.description)}" '
            f'style="height:{self.height}px"></div>{write_data_script(self.figure.to_json())}</figure>'
        )


def write_data_script(content: str) -> str:
    """JSON within a page; ``<`` is written so that no text can end the element.

    ``content``: JSON.
    """
    safe = content.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")
    return f'<script type="application/json">{safe}</script>'


def to_data(content: object) -> str:
    """A document as JSON within a page; see :func:`write_data_script`."""
    return write_data_script(json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":")))


def escape_plain(text: str) -> str:
    """Text for plotly, which takes some HTML in titles and labels: shown as it is.

    Examples
    --------
    >>> escape_plain("<b>S1</b>")
    '&lt;b&gt;S1&lt;/b&gt;'
    """
    return escape(text, quote=False)


def make_chart(
    traces: Sequence[Any],
    *,
    x_title: str = "",
    y_title: str = "",
    shapes: Sequence[dict[str, Any]] = (),
    **layout: Any,
) -> go.Figure:
    """A quiet chart: white, thin grid lines, no zooming, so that a finger scrolls the page and not the chart.

    ``x_title``, ``y_title``: with the unit.
    ``shapes``: plotly shapes.
    """
    axis = {
        "gridcolor": "#e4e7eb",
        "zerolinecolor": FAINT,
        "zerolinewidth": 1,
        "fixedrange": True,
        "automargin": True,
        "title": {"standoff": 6},
    }
    figure = go.Figure(list(traces))
    figure.update_layout(
        template="none",
        font={"family": FONT, "size": 12, "color": INK},
        paper_bgcolor="rgba(0,0,0,0)",
        plot_bgcolor="rgba(0,0,0,0)",
        margin={"l": 44, "r": 8, "t": 8, "b": 38},
        showlegend=False,
        dragmode=False,
        hovermode="x unified",
        shapes=list(shapes),
        xaxis={**axis, "title": {"text": escape_plain(x_title), "standoff": 6}},
        yaxis={**axis, "title": {"text": escape_plain(y_title), "standoff": 6}},
    )
    figure.update_layout(**layout)
    return figure


def draw_grouped_bars(
    labels: Sequence[str],
    series: Sequence[tuple[str, str | Sequence[str], Sequence[float | None]]],
    sds: Sequence[Sequence[float | None]] = (),
    **layout: Any,
) -> go.Figure:
    """A group of bars at each label, one of each series: its name, its colour or colours, its values.

    ``sds``: of every series, whiskers on its bars.
    """
    whiskers: list[dict[str, Any] | None] = [None] * len(series)
    if sds:
        whiskers = [{"type": "data", "array": list(sd), "thickness": 1} for sd in sds]
    x = [escape_plain(label) for label in labels]
    traces = [
        go.Bar(x=x, y=list(values), name=name, marker={"color": colour}, error_y=whisker)
        for (name, colour, values), whisker in zip(series, whiskers, strict=True)
    ]
    return make_chart(traces, barmode="group", **layout)


def draw_cycle(
    title: str,
    description: str,
    mean: Mapping[str, Array],
    sd: Mapping[str, Array],
    differ: Sequence[tuple[float, float]],
) -> Figure:
    """One angle over the gait cycle.

    ``mean``, ``sd``: method to its curve, (n_nodes,), degrees; methods without ``sd`` have no shade.
    ``differ``: where methods differ, start and end in %: bars at the foot of the chart.
    """
    percent = np.linspace(0.0, 100.0, len(next(iter(mean.values()))))
    known = list_styles(list(mean))
    bands = [draw_band(mean[name], spread, fade(known[name].colour)) for name, spread in sd.items()]
    drawn = make_chart(
        [*bands, *draw_lines(percent, mean)],
        x_title="gait cycle, %",
        y_title="degrees",
        shapes=_list_bars(differ),
    )
    return Figure(drawn, title, description, 230)


def describe_ranges(mean: Mapping[str, Array]) -> str:
    """The least and the largest value of each method, for readers who do not see the figure."""
    return "Ranges: " + ", ".join(f"{name} {m.min():.0f} to {m.max():.0f}" for name, m in mean.items())


def draw_band(mean: Array, sd: Array, colour: str) -> go.Scatter:
    """The range within one standard deviation over the gait cycle, (n_nodes,) each, as a shade."""
    percent = np.linspace(0.0, 100.0, len(mean))
    return go.Scatter(
        x=np.concatenate([percent, percent[::-1]]).astype(np.float32),
        y=np.concatenate([mean + sd, (mean - sd)[::-1]]).astype(np.float32),
        fill="toself",
        fillcolor=colour,
        line={"width": 0},
        mode="lines",
        hoverinfo="skip",
    )


def fade(colour: str) -> str:
    """A colour, ``#rrggbb``, seen through."""
    red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    return f"rgba({red},{green},{blue},0.15)"


def _list_bars(spans: Sequence[tuple[float, float]]) -> list[dict[str, Any]]:
    look = {"type": "rect", "xref": "x", "yref": "paper", "y0": 0.0, "y1": 0.035, "fillcolor": "#52606d"}
    return [{**look, "x0": start, "x1": end, "line": {"width": 0}} for start, end in spans]


def draw_lines(x: Array, values: Mapping[str, Array], digits: int = 1) -> list[go.Scatter]:
    """One line for each method."""
    known = list_styles(list(values))
    return [
        go.Scatter(
            x=np.round(x, 4),
            y=np.round(y, 3).astype(np.float32),
            name=escape_plain(name),
            mode="lines",
            line={"color": known[name].colour, "dash": known[name].dash, "width": 2},
            hovertemplate=f"%{{y:.{digits}f}}",
        )
        for name, y in values.items()
    ]
