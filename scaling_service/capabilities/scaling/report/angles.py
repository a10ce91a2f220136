"""The chapters on joint angles: by method over time and the gait cycle, and as a clinic reads them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final, Literal

import numpy as np
import plotly.graph_objects as go

from scaling_service.capabilities.scaling.clinical_gait import VARIABLES, Band, read_schwartz2008
from scaling_service.capabilities.scaling.comparison.curves import Curves, CycleCurves, Gait
from scaling_service.documents.results import ClinicalCurve, ClinicalDocument, MethodResult
from scaling_service.model.anatomy.frames import ANGLES, WAYS
from scaling_service.report.blocks import (
    Block,
    Bullets,
    Callout,
    Cell,
    Details,
    Grid,
    Heading,
    Legend,
    Row,
    Section,
    Table,
    Text,
)
from scaling_service.report.figures import (
    Figure,
    describe_ranges,
    draw_band,
    draw_cycle,
    draw_lines,
    fade,
    make_chart,
)
from scaling_service.report.methods import (
    FAINT,
    Style,
    describe_spans,
    list_method_columns,
    make_method_legend,
    number,
    spell_name,
)


def build_angles_section(methods: Sequence[str], angles: Sequence[Curves], gait: Gait) -> Section:
    """Joint angles by each method, over time in one trial and over the gait cycle."""
    return Section("Joint angles", list(_build_blocks(methods, angles, gait)), new_page=True)


def _build_blocks(methods: Sequence[str], angles: Sequence[Curves], gait: Gait) -> Iterator[Block]:
    if not angles and not gait.curves:
        yield Text("No movement was recorded, so there are no joint angles.")
        return
    yield make_method_legend(methods)
    if gait.curves:
        yield from _build_gait(gait)
    else:
        yield Text(f"No gait cycle is shown: {gait.reason}.", quiet=True)
    if angles:
        title = f"Over time: {angles[0].trial} ({_describe_role(angles[0].held_out)})"
        grid = Grid([_draw_over_time(curve) for curve in angles])
        if gait.curves:
            yield Details(title, [grid])
        else:
            yield Heading(title)
            yield grid


def _describe_role(held_out: bool) -> str:
    return "held out" if held_out else "used to fit"


def _build_gait(gait: Gait) -> Iterator[Block]:
    where = ", ".join(gait.trials)
    counts = sorted({curve.n_cycles for curve in gait.curves})
    span = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    many = "one cycle" if counts == [1] else f"{span} cycles"
    yield Heading("Over the gait cycle")
    yield Text(
        f"{'Mean and SD (shaded) over' if counts[-1] > 1 else 'From'} {many} of each leg from {where} "
        f"({_describe_role(gait.held_out)}), from contact to contact of the same foot, as "
        "the markers show it."
    )
    tested = [curve for curve in gait.curves if curve.anova is not None]
    yield Text(_describe_tests(tested))
    yield Grid([_draw_over_cycle(curve) for curve in gait.curves])
    if tested:
        yield _tabulate_tests(tested, gait)


def _describe_tests(tested: Sequence[CycleCurves]) -> str:
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


def _draw_over_cycle(curve: CycleCurves) -> Figure:
    title = spell_name(curve.name)
    described = (
        f"{title} over the gait cycle by method, degrees, mean of {curve.n_cycles} cycles. "
        f"{describe_ranges(curve.mean)}"
    )
    sd = curve.sd if curve.n_cycles > 1 else {}
    return draw_cycle(title, described, curve.mean, sd, [] if curve.anova is None else curve.anova.spans)


def _tabulate_tests(tested: Sequence[CycleCurves], gait: Gait) -> Table:
    rows = []
    for curve in tested:
        test = curve.anova
        assert test is not None
        p = f"{test.p:.3f}" if test.can_decide else f"cannot decide (smallest possible {test.smallest_p:.2g})"
        pairs = [
            f"{method}: {describe_spans(pair.spans) if pair.can_decide else 'too few cycles'}"
            for method, pair in curve.pairs.items()
        ]
        cells = [str(curve.n_cycles), p, describe_spans(test.spans), "; ".join(pairs) or "not tested"]
        rows.append(Row(spell_name(curve.name), cells))
    return Table(
        caption="Do the methods differ along the curve?",
        columns=["angle", "cycles", "p", "where, % of the cycle", f"pairs with {gait.reference}"],
        rows=rows,
        note="Statistical parametric mapping by permutation; pairs share 5 % (Bonferroni).",
        words=True,
    )


def _draw_over_time(curve: Curves) -> Figure:
    title = spell_name(curve.name)
    return Figure(
        make_chart(draw_lines(curve.x, curve.values), x_title="time, s", y_title="degrees"),
        title,
        f"{title} over time in {curve.trial} by method, degrees.",
        210,
    )


_Side = Literal["r", "l"]

_SIDES: Final[Mapping[_Side, tuple[str, Style]]] = {
    "l": ("left", Style("#D55E00", "dash")),
    "r": ("right", Style("#0072B2", "solid")),
}
"""As gait laboratories draw them, left in red; colours of Okabe & Ito 2008."""

_BAND = "rgba(154,165,177,0.35)"
"""The palette's faint grey, seen through."""

_RESTS_ON = (
    "Hip, knee, ankle: turns between frames through the model's joint centres and lateral knee and ankle "
    "markers (Kadaba 1990, Davis 1991). Knee rotation counts from the model's neutral pose, so that tibial "
    "torsion does not show.",
    "Pelvis: rotation, obliquity and tilt in this order (Baker 2001). Rotation and foot progression count "
    "from where the pelvis goes during each cycle.",
    "Foot: the line from heel to second metatarsal head, level where the model stands on a flat sole. A "
    "laboratory takes this from its standing trial, so dorsiflexion may differ from its own by a constant.",
    "Gait Variable Score: RMS distance of a cycle from the reference's mean, averaged over cycles. Gait "
    "Profile Score: RMS of nine of them; of both sides, with the pelvis counted once (Baker 2009).",
)


def build_clinical_section(methods: Mapping[str, MethodResult], method: str) -> Section:
    """Conventional angles of the verdict's method, its profile, and the scores of all methods."""
    return Section("Angles as a clinic reads them", list(_build_clinical(methods, method)), new_page=True)


def _build_clinical(methods: Mapping[str, MethodResult], method: str) -> Iterator[Block]:
    found = {name: m.clinical for name, m in methods.items() if m.clinical is not None}
    shown = found.get(method)
    if shown is None or not shown.sides:
        yield Text(
            f"No gait cycle is shown: {shown.reason if shown else 'no movement was recorded'}.", quiet=True
        )
        yield from _build_left_out(shown)
        return
    if shown.doubtful:
        yield Callout("Read with doubt", [Bullets([f"{said}." for said in shown.doubtful])], "poor")
    yield Text(_describe_cycles(method, shown))
    yield Legend([(name, style.colour, style.dash) for name, style in _SIDES.values()])
    bands = read_schwartz2008().bands
    yield Grid(
        [
            _draw_figure(angle, shown, bands[angle])
            for angle in ANGLES
            if angle in bands and _has(shown, angle)
        ]
    )
    yield Heading("Movement Analysis Profile and Gait Profile Score")
    yield _draw_profile(shown)
    yield Text(_score_in_words(method, shown))
    yield from _build_left_out(shown)
    yield from _build_scores(found)
    yield Details("What these angles and scores rest on", [Bullets(_RESTS_ON)])


def _describe_cycles(method: str, shown: ClinicalDocument) -> str:
    counts = " and ".join(
        f"{len(shown.sides[side].cycles)} {name}" for side, (name, _) in _SIDES.items() if side in shown.sides
    )
    trials = dict.fromkeys(cycle.trial for side in shown.sides.values() for cycle in side.cycles)
    several = any(curve.sd_deg is not None for side in shown.sides.values() for curve in side.curves.values())
    drawn = "Mean and SD (shaded)" if several else "Angles"
    role = "held out" if shown.held_out else "used to fit"
    return (
        f"{drawn} of {method} over gait cycles ({counts}) from {', '.join(trials)} ({role}). Grey: mean ± 1 "
        f"SD of {shown.population} at free speed (Schwartz 2008). An adult, or a person who walks faster or "
        "slower, is not one of them."
    )


def _has(shown: ClinicalDocument, angle: str) -> bool:
    return any(angle in side.curves for side in shown.sides.values())


def _draw_figure(angle: str, shown: ClinicalDocument, usual: Band) -> Figure:
    title, low, high = WAYS[angle]
    traces = [draw_band(np.degrees(usual.mean), np.degrees(usual.sd), _BAND)]
    curves = {side: shown.sides[side].curves[angle] for side in _SIDES if _in(shown, side, angle)}
    for side, curve in curves.items():
        if curve.sd_deg is not None:
            traces.append(
                draw_band(np.array(curve.mean_deg), np.array(curve.sd_deg), fade(_SIDES[side][1].colour))
            )
    traces += [_draw_line(side, curve) for side, curve in curves.items()]
    said = "; ".join(
        f"{_SIDES[side][0]} {min(curve.mean_deg):.0f} to {max(curve.mean_deg):.0f}"
        for side, curve in curves.items()
    )
    described = f"{title} over the gait cycle, degrees, {high} positive. Ranges: {said}."
    drawn = make_chart(traces, x_title="gait cycle, %", y_title="degrees")
    return Figure(drawn, f"{title}: {high} +, {low} −", described, 230)


def _in(shown: ClinicalDocument, side: _Side, angle: str) -> bool:
    return side in shown.sides and angle in shown.sides[side].curves


def _draw_line(side: _Side, curve: ClinicalCurve) -> go.Scatter:
    name, style = _SIDES[side]
    return go.Scatter(
        x=np.linspace(0.0, 100.0, len(curve.mean_deg)),
        y=np.asarray(curve.mean_deg, dtype=np.float32),
        name=name,
        mode="lines",
        line={"color": style.colour, "dash": style.dash, "width": 2},
        hovertemplate="%{y:.1f}",
    )


def _draw_profile(shown: ClinicalDocument) -> Figure:
    scored = [a for a in VARIABLES if any(a in side.gvs_deg for side in shown.sides.values())]
    whole = any(side.gps_deg is not None for side in shown.sides.values())
    names = [*(WAYS[angle][0] for angle in scored), *(["GPS"] if whole else [])]
    labels = [name.replace(" ", "<br>") for name in names]
    bars: list[go.Bar | go.Scatter] = []
    said = []
    for side, (name, style) in _SIDES.items():
        if side not in shown.sides:
            continue
        scores = shown.sides[side]
        values = [*(scores.gvs_deg.get(angle) for angle in scored), *([scores.gps_deg] if whole else [])]
        bars.append(
            go.Bar(x=labels, y=values, name=name, marker={"color": style.colour}, hovertemplate="%{y:.1f}")
        )
        known = [f"{n} {v:.1f}" for n, v in zip(names, values, strict=True) if v is not None]
        said.append(f"{name}: {', '.join(known)}")
    typical = [shown.reference_gvs_deg[angle] for angle in scored]
    typical += [shown.reference_gps_deg] if whole else []
    bars.append(
        go.Scatter(
            x=labels,
            y=typical,
            name="reference",
            mode="markers",
            marker={"symbol": "line-ew-open", "size": 34, "color": FAINT, "line": {"width": 3}},
            hovertemplate="%{y:.1f}",
        )
    )
    drawn = make_chart(bars, y_title="degrees", barmode="group", bargap=0.35)
    drawn.update_xaxes(tickangle=0)
    return Figure(
        drawn,
        "Movement Analysis Profile: distance of each angle from the reference's mean (grey mark: RMS of the "
        "reference's own members)",
        f"Gait Variable Scores, degrees. {'. '.join(said)}.",
        300,
    )


def _score_in_words(method: str, shown: ClinicalDocument) -> str:
    if shown.gps_deg is None:
        missing = [
            WAYS[angle][0] for angle in VARIABLES if not all(_in(shown, side, angle) for side in _SIDES)
        ]
        return f"No Gait Profile Score of both sides is given by {method}: it lacks {', '.join(missing)}."
    sides = ", ".join(f"{_SIDES[s][0]} {number(shown.sides[s].gps_deg)}" for s in _SIDES if s in shown.sides)
    return (
        f"Gait Profile Score by {method}: {shown.gps_deg:.1f} degrees ({sides}). The reference's own members "
        f"lie {shown.reference_gps_deg:.1f} degrees (RMS) from its mean. A part of any distance is how this "
        "laboratory places markers, not how this person walks."
    )


def _build_scores(found: Mapping[str, ClinicalDocument]) -> Iterator[Block]:
    columns: list[str | Cell] = ["", *list_method_columns(list(found))]
    documents = list(found.values())
    sides = {side: [d.sides.get(side) for d in documents] for side in _SIDES}
    totals = [
        _make_row(f"GPS, {_SIDES[s][0]}", [None if x is None else x.gps_deg for x in of])
        for s, of in sides.items()
    ]
    totals.append(_make_row("GPS, both sides", [d.gps_deg for d in documents]))
    if any(totals):
        yield Table(
            caption="Gait Profile Score by method, degrees",
            columns=columns,
            rows=[row for row in totals if row],
        )
    rows = [
        _make_row(
            f"{WAYS[angle][0]}, {_SIDES[s][0]}", [None if x is None else x.gvs_deg.get(angle) for x in of]
        )
        for s, of in sides.items()
        for angle in VARIABLES
    ]
    table = Table(
        caption="Gait Variable Scores by method, degrees", columns=columns, rows=[row for row in rows if row]
    )
    yield Details("The scores of each angle", [table])


def _make_row(title: str, scores: Sequence[float | None]) -> Row | None:
    """The scores of all methods; None where no method has one."""
    known = any(score is not None for score in scores)
    return Row(title, [number(score) for score in scores]) if known else None


def _build_left_out(shown: ClinicalDocument | None) -> Iterator[Block]:
    if shown is not None and shown.left_out:
        yield Bullets([f"Not given: {reason}." for reason in shown.left_out])
