"""A cohort in tables and figures: single numbers with their tests, and joint angles over the gait cycle."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go

from scaling_service.capabilities.cohort.groups import ScalarComparison
from scaling_service.capabilities.cohort.statistics import CurveComparison
from scaling_service.core.text import p_words
from scaling_service.numerics.statistics.permutation_tests import CurveTest
from scaling_service.report.blocks import Block, Cell, Grid, Row, Table, Text
from scaling_service.report.figures import Figure, chart, cycle_figure, plain, ranges, stretches
from scaling_service.report.methods import INK, method_columns, method_legend, styles, words

_JITTER = 0.28  # chosen: of two methods' distance, so that dots of one value do not hide each other
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


def dots(scalar: ScalarComparison, unit: Unit, caption: str) -> Figure:
    """Every subject's value under each method, with mean and SD."""
    methods = scalar.panel.methods
    known = styles(list(methods))
    count = max(len(scalar.values) - 1, 1)
    traces = [
        go.Scatter(
            x=[k + _JITTER * (2.0 * n / count - 1.0) for n in range(len(scalar.values))],
            y=[unit.factor * of[method] for of in scalar.values.values()],
            mode="markers",
            marker={"color": known[method].colour, "size": 5, "opacity": 0.6},
            text=[plain(subject) for subject in scalar.values],
            hovertemplate=f"%{{text}}: %{{y:.{unit.digits}f}}<extra></extra>",
        )
        for k, method in enumerate(methods)
    ]
    mean = [unit.factor * scalar.mean[m] for m in methods]
    sd = [unit.factor * scalar.sd.get(m, 0.0) for m in methods]
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
    figure = chart(traces, y_title=unit.name, hovermode="closest")
    figure.update_xaxes(tickvals=list(range(len(methods))), ticktext=[plain(m) for m in methods])
    described = ", ".join(f"{m} {a:.1f} ± {b:.1f}" for m, a, b in zip(methods, mean, sd, strict=True))
    return Figure(figure, caption, f"{caption}: {described} {unit.name}.", 240)


def angle_blocks(curves: Sequence[CurveComparison]) -> Iterator[Block]:
    """Every angle's curves and tests; a sentence where nobody walked."""
    if not curves:
        yield Text("No subject has a whole stride, so joint angles over the gait cycle are not compared.")
        return
    methods = list(dict.fromkeys(m for c in curves for m in c.panel.methods))
    yield Text(
        "Mean and SD (shaded) over subjects; each subject's strides are averaged first, so that a subject "
        "counts once. Grey bars: where the methods differ (repeated-measures analysis of variance along the "
        "curve, thresholds by permutation, 5 % for each angle)."
    )
    yield method_legend(methods)
    yield Grid([_figure(curve) for curve in curves if curve.mean])
    yield _table(curves)


def _figure(curve: CurveComparison) -> Figure:
    mean = {method: np.degrees(values) for method, values in curve.mean.items()}
    sd = {method: np.degrees(values) for method, values in curve.sd.items()}
    count = len(curve.panel.subjects)
    title = f"{words(curve.coordinate)} ({count} subject{'s' if count != 1 else ''})"
    test = None if curve.test is None else curve.test.anova
    return cycle_figure(title, f"{title} over the gait cycle by method. {ranges(mean)}", mean, sd, test)


def _table(curves: Sequence[CurveComparison]) -> Table:
    rows = []
    for curve in curves:
        count = str(len(curve.panel.subjects))
        if curve.test is None:
            rows.append(Row(words(curve.coordinate), [count, "–", "–", curve.note]))
            continue
        anova = curve.test.anova
        pairs = "; ".join(f"{' / '.join(pair.methods)}: {_pair(pair.test)}" for pair in curve.test.pairs)
        said = pairs or "not asked, for the analysis of variance finds nothing"
        p = p_words(anova.p) if anova.can_decide else "too few subjects to decide"
        rows.append(Row(words(curve.coordinate), [count, p, stretches(anova), said]))
    reference = next((c.reference for c in curves if c.reference is not None), None)
    return Table(
        "Do the methods differ along the curve?",
        [
            "angle",
            "subjects",
            "p",
            "where, % of the cycle",
            f"pairs with {reference}" if reference else "pairs",
        ],
        rows,
        "Pairs are paired t tests by permutation and share 5 % (Bonferroni).",
        words=True,
    )


def _pair(test: CurveTest) -> str:
    return stretches(test) if test.can_decide else "too few subjects"
