"""Figures of a cohort: every subject's numbers, and joint angles over the gait cycle."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go

from scaling_service.capabilities.cohort.document import CurveEntry, QuantityEntry
from scaling_service.report.figures import Figure, chart, cycle_figure, plain, ranges
from scaling_service.report.methods import INK, styles, words

_JITTER = 0.28  # chosen: of two methods' distance, so that dots of one value do not hide each other


def draw_dots(entry: QuantityEntry, unit: str, caption: str) -> Figure:
    """Every subject's value under each method, with mean and SD."""
    methods = entry.compared.methods
    known = styles(methods)
    count = max(len(entry.values) - 1, 1)
    traces = [
        go.Scatter(
            x=[k + _JITTER * (2.0 * n / count - 1.0) for n in range(len(entry.values))],
            y=[of[method] for of in entry.values.values()],
            mode="markers",
            marker={"color": known[method].colour, "size": 5, "opacity": 0.6},
            text=[plain(subject) for subject in entry.values],
            hovertemplate="%{text}: %{y:.1f}<extra></extra>",
        )
        for k, method in enumerate(methods)
    ]
    mean = [entry.mean[m] for m in methods]
    sd = [entry.sd.get(m, 0.0) for m in methods]
    traces.append(
        go.Scatter(
            x=list(range(len(methods))),
            y=mean,
            error_y={"type": "data", "array": sd, "color": INK, "thickness": 1.5},
            mode="markers",
            marker={"color": INK, "size": 9, "symbol": "line-ew-open", "line": {"width": 2}},
            hoverinfo="skip",
        )
    )
    figure = chart(traces, y_title=unit, hovermode="closest")
    figure.update_xaxes(tickvals=list(range(len(methods))), ticktext=[plain(m) for m in methods])
    described = ", ".join(f"{m} {a:.1f} ± {b:.1f}" for m, a, b in zip(methods, mean, sd, strict=True))
    return Figure(figure, caption, f"{caption}: {described} {unit}.", 240)


def draw_curves(curve: CurveEntry) -> Figure:
    """A joint angle by each method, grey bars where they differ."""
    mean, sd = ({m: np.array(v) for m, v in of.items()} for of in (curve.mean_deg, curve.sd_deg))
    count = len(curve.compared.subjects)
    title = f"{words(curve.coordinate)} ({count} subject{'s' if count != 1 else ''})"
    differ = [] if curve.anova is None else curve.anova.spans
    return cycle_figure(title, f"{title} over the gait cycle by method. {ranges(mean)}", mean, sd, differ)
