"""Single numbers of a cohort: a table with its tests, and every subject as a dot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import plotly.graph_objects as go

from scaling_service.capabilities.cohort.scalars import ScalarComparison
from scaling_service.report.blocks import Cell, Row, Table
from scaling_service.report.figures import Figure, chart, plain
from scaling_service.report.methods import INK, method_columns, styles, words

_JITTER = (
    0.28  # chosen: of the distance between two methods, so that dots of one value do not hide each other
)
_NAMES = {
    "calibration": "trials used to fit",
    "evaluation": "held-out trials",
    "mean_over_markers": "mean over markers",
    "r_x": "right, about x",
    "r_y": "right, about y",
    "l_x": "left, about x",
    "l_y": "left, about y",
}


@dataclass(frozen=True, slots=True)
class Unit:
    """How SI values are shown."""

    name: str
    factor: float
    digits: int = 1


MM, DEG = Unit("mm", 1e3), Unit("degrees", 180.0 / math.pi)


def quantity_words(name: str) -> str:
    """A quantity's name for people."""
    return _NAMES.get(name, words(name))


def p_words(p: float) -> str:
    """A probability as papers give it.

    Examples
    --------
    >>> p_words(0.0004), p_words(0.0321)
    ('< 0.001', '0.032')
    """
    return "< 0.001" if p < 0.001 else f"{p:.3f}"


def quantity_table(caption: str, scalars: Sequence[ScalarComparison], unit: Unit, note: str = "") -> Table:
    """Mean ± SD over the subjects for each method, Friedman's p, and the pairs that differ."""
    methods = list(dict.fromkeys(m for s in scalars for m in s.panel.methods))
    columns: list[str | Cell] = ["", "subjects", *method_columns(methods), "Friedman p"]
    said = " ".join(text for text in (*(_said(s) for s in scalars), note) if text)
    return Table(f"{caption}, {unit.name}", columns, [_row(s, methods, unit) for s in scalars], said)


def _said(scalar: ScalarComparison) -> str:
    """Which pairs differ, or why nothing was tested."""
    name = quantity_words(scalar.quantity)
    if scalar.test is None:
        return f"{name}: {scalar.note}."
    differ = [" / ".join(pair.methods) for pair in scalar.test.pairs if pair.significant]
    return f"{name}: {', '.join(differ)} differ (Tukey's HSD)." if differ else ""


def _row(scalar: ScalarComparison, methods: Sequence[str], unit: Unit) -> Row:
    cells: list[str | Cell] = [str(len(scalar.panel.subjects)), *(_spread(scalar, m, unit) for m in methods)]
    test = scalar.test
    return Row(quantity_words(scalar.quantity), [*cells, "–" if test is None else p_words(test.p)])


def _spread(scalar: ScalarComparison, method: str, unit: Unit) -> str:
    if method not in scalar.mean:
        return "–"
    mean = f"{unit.factor * scalar.mean[method]:.{unit.digits}f}"
    return f"{mean} ± {unit.factor * scalar.sd[method]:.{unit.digits}f}" if method in scalar.sd else mean


def dots(scalar: ScalarComparison, unit: Unit, caption: str, *, less: str | None = None) -> Figure:
    """Every subject's value under each method, with mean and SD.

    Parameters
    ----------
    less : str, optional
        A method whose value is taken off each subject's others.
    """
    methods = [m for m in scalar.panel.methods if m != less]
    known = styles(list(scalar.panel.methods))
    traces = []
    for k, method in enumerate(methods):
        values = [
            unit.factor * (of[method] - (of[less] if less is not None else 0.0))
            for of in scalar.values.values()
        ]
        count = max(len(values) - 1, 1)
        traces.append(
            go.Scatter(
                x=[k + _JITTER * (2.0 * n / count - 1.0) for n in range(len(values))],
                y=values,
                mode="markers",
                marker={"color": known[method].colour, "size": 5, "opacity": 0.6},
                text=[plain(subject) for subject in scalar.values],
                hovertemplate=f"%{{text}}: %{{y:.{unit.digits}f}}<extra></extra>",
            )
        )
    shown = [_mean_sd(trace.y) for trace in traces]
    traces.append(
        go.Scatter(
            x=list(range(len(methods))),
            y=[mean for mean, _ in shown],
            error_y={"type": "data", "array": [sd for _, sd in shown], "color": INK, "thickness": 1.5},
            mode="markers",
            marker={"color": INK, "size": 9, "symbol": "line-ew-open", "line": {"width": 2}},
            hoverinfo="skip",
        )
    )
    figure = chart(traces, y_title=unit.name, hovermode="closest")
    figure.update_xaxes(tickvals=list(range(len(methods))), ticktext=[plain(m) for m in methods])
    described = ", ".join(f"{m} {mean:.1f} ± {sd:.1f}" for m, (mean, sd) in zip(methods, shown, strict=True))
    return Figure(figure, caption, f"{caption}: {described} {unit.name}.", 240)


def _mean_sd(values: Sequence[float]) -> tuple[float, float]:
    mean = math.fsum(values) / len(values)
    if len(values) < 2:
        return mean, 0.0
    return mean, math.sqrt(math.fsum((v - mean) ** 2 for v in values) / (len(values) - 1))
