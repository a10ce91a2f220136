"""The chapter on joint angles: over the gait cycle where there is one, over time elsewhere."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from scaling_service.capabilities.scaling.comparison.curves import Curves, CycleCurves, Gait
from scaling_service.report.blocks import Block, Details, Grid, Heading, Row, Table, Text
from scaling_service.report.figures import Figure, chart, cycle_figure, lines, ranges
from scaling_service.report.methods import method_legend, percent_spans, words
from scaling_service.report.page import Section


def angles_section(methods: Sequence[str], angles: Sequence[Curves], gait: Gait) -> Section:
    """Joint angles by each method, over time in one trial and over the gait cycle."""
    return Section("Joint angles", list(_blocks(methods, angles, gait)), new_page=True)


def _blocks(methods: Sequence[str], angles: Sequence[Curves], gait: Gait) -> Iterator[Block]:
    if not angles and not gait.curves:
        yield Text("No movement was recorded, so there are no joint angles.")
        return
    yield method_legend(methods)
    if gait.curves:
        yield from _gait(gait)
    else:
        yield Text(f"No gait cycle is shown: {gait.reason}.", quiet=True)
    if angles:
        title = f"Over time: {angles[0].trial} ({_role(angles[0].held_out)})"
        grid = Grid([_over_time(curve) for curve in angles])
        if gait.curves:
            yield Details(title, [grid])
        else:
            yield Heading(title)
            yield grid


def _role(held_out: bool) -> str:
    return "held out" if held_out else "used to fit"


def _gait(gait: Gait) -> Iterator[Block]:
    where = ", ".join(gait.trials)
    counts = sorted({curve.n_cycles for curve in gait.curves})
    span = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    many = "one cycle" if counts == [1] else f"{span} cycles"
    yield Heading("Over the gait cycle")
    yield Text(
        f"{'Mean and SD (shaded) over' if counts[-1] > 1 else 'From'} {many} of each leg from {where} "
        f"({_role(gait.held_out)}), from contact to contact of the same foot, as "
        "the markers show it."
    )
    tested = [curve for curve in gait.curves if curve.anova is not None]
    yield Text(_said(tested))
    yield Grid([_over_cycle(curve) for curve in gait.curves])
    if tested:
        yield _tests(tested, gait)


def _said(tested: Sequence[CycleCurves]) -> str:
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
    return cycle_figure(title, described, curve.mean, sd, [] if curve.anova is None else curve.anova.spans)


def _tests(tested: Sequence[CycleCurves], gait: Gait) -> Table:
    rows = []
    for curve in tested:
        test = curve.anova
        assert test is not None
        p = f"{test.p:.3f}" if test.can_decide else f"cannot decide (smallest possible {test.smallest_p:.2g})"
        pairs = [
            f"{method}: {percent_spans(pair.spans) if pair.can_decide else 'too few cycles'}"
            for method, pair in curve.pairs.items()
        ]
        cells = [str(curve.n_cycles), p, percent_spans(test.spans), "; ".join(pairs) or "not tested"]
        rows.append(Row(words(curve.name), cells))
    return Table(
        "Do the methods differ along the curve?",
        ["angle", "cycles", "p", "where, % of the cycle", f"pairs with {gait.reference}"],
        rows,
        "Statistical parametric mapping by permutation; pairs share 5 % (Bonferroni).",
        words=True,
    )


def _over_time(curve: Curves) -> Figure:
    title = words(curve.name)
    return Figure(
        chart(lines(curve.x, curve.values), x_title="time, s", y_title="degrees"),
        title,
        f"{title} over time in {curve.trial} by method, degrees.",
        210,
    )
