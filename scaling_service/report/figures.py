"""Figures of plotly as blocks of a page: drawn when they come into sight, static and resized in print."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import plotly.graph_objects as go

from scaling_service.report.palette import FAINT, INK

FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, sans-serif"


@dataclass(frozen=True, slots=True, eq=False)
class Figure:
    """A plotly figure with its caption.

    Parameters
    ----------
    figure : plotly.graph_objects.Figure
    caption : str
    description : str
        What it shows, for readers who do not see it.
    height : int, px
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
            f'style="height:{self.height}px"></div>{data_script(self.figure.to_json())}</figure>'
        )


def data_script(content: str) -> str:
    """JSON within a page; ``<`` is written so that no text can end the element.

    Parameters
    ----------
    content : str
        JSON.
    """
    safe = content.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")
    return f'<script type="application/json">{safe}</script>'


def to_data(content: object) -> str:
    """A document as JSON within a page; see :func:`data_script`."""
    return data_script(json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":")))


def plain(text: str) -> str:
    """Text for plotly, which takes some HTML in titles and labels: shown as it is.

    Examples
    --------
    >>> plain("<b>S1</b>")
    '&lt;b&gt;S1&lt;/b&gt;'
    """
    return escape(text, quote=False)


def chart(
    traces: Sequence[Any],
    *,
    x_title: str = "",
    y_title: str = "",
    shapes: Sequence[dict[str, Any]] = (),
    **layout: Any,
) -> go.Figure:
    """A quiet chart: white, thin grid lines, no zooming, so that a finger scrolls the page and not the chart.

    Parameters
    ----------
    traces : sequence of plotly traces
    x_title, y_title : str
        With the unit.
    shapes : sequence of plotly shapes
    layout : plotly layout, over the defaults
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
        xaxis={**axis, "title": {"text": plain(x_title), "standoff": 6}},
        yaxis={**axis, "title": {"text": plain(y_title), "standoff": 6}},
    )
    figure.update_layout(**layout)
    return figure
