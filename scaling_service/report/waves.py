"""Joint angles over the gait cycle as figures: each method's mean and scatter, and where methods differ."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import plotly.graph_objects as go

from scaling_service.model.results import Array
from scaling_service.numerics.statistics.waveform_clusters import CurveTest
from scaling_service.report.figures import Figure, chart
from scaling_service.report.methods import lines
from scaling_service.report.palette import styles


def cycle_figure(
    title: str, description: str, mean: Mapping[str, Array], sd: Mapping[str, Array], test: CurveTest | None
) -> Figure:
    """One angle over the gait cycle.

    Parameters
    ----------
    mean, sd : mapping
        Method to its curve, (n_nodes,), degrees; methods without ``sd`` have no shade.
    test : CurveTest, optional
        Its clusters are bars at the foot of the chart.
    """
    percent = np.linspace(0.0, 100.0, len(next(iter(mean.values()))))
    known = styles(list(mean))
    bands = [
        go.Scatter(
            x=np.concatenate([percent, percent[::-1]]).astype(np.float32),
            y=np.concatenate([mean[name] + spread, (mean[name] - spread)[::-1]]).astype(np.float32),
            fill="toself",
            fillcolor=_faded(known[name].colour),
            line={"width": 0},
            mode="lines",
            hoverinfo="skip",
        )
        for name, spread in sd.items()
    ]
    drawn = chart(
        [*bands, *lines(percent, mean)], x_title="gait cycle, %", y_title="degrees", shapes=_bars(test)
    )
    return Figure(drawn, title, description, 230)


def ranges(mean: Mapping[str, Array]) -> str:
    """The least and the largest value of each method, for readers who do not see the figure."""
    return "Ranges: " + ", ".join(f"{name} {m.min():.0f} to {m.max():.0f}" for name, m in mean.items())


def stretches(test: CurveTest) -> str:
    """Where along the cycle methods differ, %."""
    return ", ".join(f"{c.start:.0f}–{c.end:.0f}" for c in test.clusters) or "nowhere"


def _bars(test: CurveTest | None) -> list[dict[str, Any]]:
    return (
        []
        if test is None
        else [
            {
                "type": "rect",
                "xref": "x",
                "yref": "paper",
                "x0": c.start,
                "x1": c.end,
                "y0": 0.0,
                "y1": 0.035,
                "fillcolor": "#52606d",
                "line": {"width": 0},
            }
            for c in test.clusters
        ]
    )


def _faded(colour: str) -> str:
    red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    return f"rgba({red},{green},{blue},0.15)"
