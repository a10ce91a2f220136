"""Joint angles over the gait cycle of a cohort, with where methods differ."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from scaling_service.capabilities.cohort.curves import CurveComparison
from scaling_service.capabilities.cohort.report.quantities import p_words
from scaling_service.numerics.statistics.permutation_tests import CurveTest
from scaling_service.report.blocks import Block, Grid, Row, Table, Text
from scaling_service.report.figures import Figure, cycle_figure, ranges, stretches
from scaling_service.report.methods import method_legend, words


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
        rows.append(Row(words(curve.coordinate), [count, _p(anova), stretches(anova), said]))
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


def _p(test: CurveTest) -> str:
    return p_words(test.p) if test.can_decide else "too few subjects to decide"


def _pair(test: CurveTest) -> str:
    return stretches(test) if test.can_decide else "too few subjects"
