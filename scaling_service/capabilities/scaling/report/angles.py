"""The chapter on joint angles: over the gait cycle where there is one, over time elsewhere."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.capabilities.scaling.report.data import Curves, CycleCurves, Gait, SubjectData
from scaling_service.numerics.statistics.waveform_clusters import CurveTest
from scaling_service.report.blocks import Block, Details, Grid, Heading, Row, Table, Text
from scaling_service.report.figures import Figure, chart
from scaling_service.report.methods import lines, method_legend, words
from scaling_service.report.page import Section
from scaling_service.report.waves import cycle_figure, ranges, stretches


def angles_section(data: SubjectData) -> Section:
    """Joint angles by each method."""
    return Section("Joint angles", list(_blocks(data)), new_page=True)


def _blocks(data: SubjectData) -> Iterator[Block]:
    if not data.angles and not data.gait.curves:
        yield Text("No movement was recorded, so there are no joint angles.")
        return
    yield method_legend(list(data.document.methods))
    if data.gait.curves:
        yield from _gait(data.gait)
    else:
        yield Text(f"No gait cycle is shown: {data.gait.reason}.", quiet=True)
    if data.angles:
        trial = data.angles[0]
        title = f"Over time: {trial.trial} ({'held out' if trial.held_out else 'used to fit'})"
        grid = Grid([_over_time(curve) for curve in data.angles])
        if data.gait.curves:
            yield Details(title, [grid])
        else:
            yield Heading(title)
            yield grid


def _gait(gait: Gait) -> Iterator[Block]:
    where = ", ".join(gait.trials)
    counts = sorted({curve.n_cycles for curve in gait.curves})
    span = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    many = "one cycle" if counts == [1] else f"{span} cycles"
    yield Heading("Over the gait cycle")
    yield Text(
        f"{'Mean and SD (shaded) over' if counts[-1] > 1 else 'From'} {many} of each leg from {where} "
        f"({'held out' if gait.held_out else 'used to fit'}), from contact to contact of the same foot, as "
        "the markers show it."
    )
    tested = [curve for curve in gait.curves if curve.anova is not None]
    yield Text(_said(tested))
    yield Grid([_over_cycle(curve) for curve in gait.curves])
    if tested:
        yield _tests(tested, gait)


def _said(tested: list[CycleCurves]) -> str:
    """What the tests along the curve can and cannot say of one person."""
    if not tested:
        return "Methods were not tested against each other: that takes two cycles and two methods."
    undecided = [c for c in tested if c.anova is not None and not c.anova.can_decide]
    if undecided:
        return (
            "There are too few cycles for a test by permutation to decide anything at 5 %: read the curves "
            "as a description of these cycles."
        )
    return (
        "Grey bars: where the methods differ over these cycles (analysis of variance along the curve by "
        "permutation, 5 % for each angle). Cycles of one person are not persons: this says that the methods "
        "differ for this person, not which is right, nor that they differ for others."
    )


def _over_cycle(curve: CycleCurves) -> Figure:
    title = words(curve.name)
    described = (
        f"{title} over the gait cycle by method, degrees, mean of {curve.n_cycles} cycles. "
        f"{ranges(curve.mean)}"
    )
    sd = curve.sd if curve.n_cycles > 1 else {}
    return cycle_figure(title, described, curve.mean, sd, curve.anova)


def _tests(tested: list[CycleCurves], gait: Gait) -> Table:
    rows = []
    for curve in tested:
        assert curve.anova is not None
        rows.append(
            Row(
                words(curve.name),
                [str(curve.n_cycles), _p(curve.anova), stretches(curve.anova), _pairs(curve)],
            )
        )
    return Table(
        "Do the methods differ along the curve?",
        ["angle", "cycles", "p", "where, % of the cycle", f"pairs with {gait.reference}"],
        rows,
        "Statistical parametric mapping by permutation; pairs share 5 % (Bonferroni).",
        words=True,
    )


def _p(test: CurveTest) -> str:
    if not test.can_decide:
        return f"cannot decide (smallest possible {test.smallest_p:.2g})"
    return f"{test.p:.3f}"


def _pairs(curve: CycleCurves) -> str:
    if not curve.pairs:
        return "not tested"
    said = []
    for method, test in curve.pairs.items():
        where = stretches(test) if test.can_decide else "too few cycles"
        said.append(f"{method}: {where}")
    return "; ".join(said)


def _over_time(curve: Curves) -> Figure:
    title = words(curve.name)
    return Figure(
        chart(lines(curve.x, curve.values), x_title="time, s", y_title="degrees"),
        title,
        f"{title} over time in {curve.trial} by method, degrees.",
        210,
    )
