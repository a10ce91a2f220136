"""What a cohort shows, in sentences and tables for page and terminal, and the page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import plotly.graph_objects as go

from scaling_service.capabilities.cohort.document import (
    AgreementEntry,
    CohortDocument,
    CurveEntry,
    Interval,
    QuantityEntry,
    StatisticsDocument,
    SubjectEntry,
)
from scaling_service.capabilities.cohort.summary import IMAGED
from scaling_service.core.text import format_p
from scaling_service.report.blocks import (
    Block,
    Bullets,
    Callout,
    Cell,
    Details,
    Grid,
    Page,
    Row,
    Section,
    Table,
    Text,
)
from scaling_service.report.figures import Figure, describe_ranges, draw_cycle, escape_plain, make_chart
from scaling_service.report.methods import (
    INK,
    describe_spans,
    list_method_columns,
    list_styles,
    make_method_legend,
    spell_name,
)

TITLES: Mapping[str, str] = {
    "kinematic_error_mm": "Kinematic error",
    "segment_lengths_mm": "Segment lengths",
    "knee_axis_deg": "Knee axes, turns from the thigh's z",
    "marker_shift_mm": "Marker shifts",
    "from_truth_mm": "Distance from the truth",
    "from_truth_deg": "Joint angles, RMS distance from the truth",
}
"""The document's lists of quantities, as people call them."""

_JITTER = 0.28  # chosen: of two methods' distance, so that dots of one value do not hide each other

_UNITS = {"mm": "mm", "deg": "degrees"}

_NAMES = {
    "calibration": "trials used to fit",
    "evaluation": "held-out trials",
    "mean_over_markers": "mean over markers",
    "r_x": "right, about x",
    "r_y": "right, about y",
    "l_x": "left, about x",
    "l_y": "left, about y",
}


def build_cohort_page(document: CohortDocument) -> Page:
    """The page of a cohort."""
    return Page(
        "Scaling methods compared over a cohort",
        [
            Section("What this cohort shows", list(_build_summary(document))),
            *build_statistics_sections(document.statistics),
            Section("Subjects", list(_build_subjects(document)), new_page=True),
        ],
        subtitle=document.cohort,
        footer=f"scaling-service {document.code_version}. The numbers are in cohort.json, too.",
    )


def build_statistics_sections(found: StatisticsDocument) -> list[Section]:
    """The chapters that every cohort has: errors, geometry, angles, agreement, and the truth where known."""
    sections = [
        Section("Kinematic errors", _build_quantity_blocks(found, "kinematic_error_mm")),
        Section(
            "Lengths, axes, marker shifts",
            _build_quantity_blocks(found, "segment_lengths_mm", "knee_axis_deg", "marker_shift_mm"),
            new_page=True,
        ),
        Section(
            "Joint angles over the gait cycle", list(build_angle_blocks(found.joint_angles)), new_page=True
        ),
        Section("Agreement", list(_build_agreement(found.agreement)), new_page=True),
    ]
    truth = _build_quantity_blocks(found, "from_truth_mm", "from_truth_deg")
    return [*sections, *([Section("Distance from the truth", truth, new_page=True)] if truth else [])]


def make_screen_tables(found: StatisticsDocument) -> Iterator[Table]:
    """For the terminal: all quantities in one table, OpenSim's limits, and where angles differ."""
    methods = [gate.method for gate in found.opensim_limits.methods]
    rows: list[Row] = []
    everything: list[QuantityEntry] = []
    for kind, title in TITLES.items():
        if entries := getattr(found, kind):
            rows.append(Row(f"{title}, {_UNITS[kind.rpartition('_')[2]]}"))
            rows += list_quantity_rows(entries, methods)
            everything += entries
    columns = ["mean ± SD over subjects", "subjects", *methods, "Friedman p"]
    yield Table(caption="", columns=columns, rows=rows, note=describe_comparisons(everything))
    yield _tabulate_gates(found)
    if any(curve.anova is not None for curve in found.joint_angles):
        yield tabulate_curves(found.joint_angles)


def describe_quantity(name: str) -> str:
    """A quantity's name for people."""
    return _NAMES.get(name, spell_name(name))


def list_quantity_rows(entries: Sequence[QuantityEntry], methods: Sequence[str]) -> list[Row]:
    """For each quantity: how many subjects, mean ± SD over them by each method, Friedman's p."""
    return [
        Row(
            describe_quantity(entry.quantity),
            [
                str(len(entry.compared.subjects)),
                *(_spread(entry, method) for method in methods),
                "–" if entry.friedman is None else format_p(entry.friedman.p),
            ],
        )
        for entry in entries
    ]


def _spread(entry: QuantityEntry, method: str) -> str:
    if method not in entry.mean:
        return "–"
    sd = f" ± {entry.sd[method]:.1f}" if method in entry.sd else ""
    return f"{entry.mean[method]:.1f}{sd}"


def describe_comparisons(entries: Sequence[QuantityEntry]) -> str:
    """Which pairs differ, what was not tested and why, and who is not counted."""
    said, untested, excluded = [], dict[str, list[str]](), dict[str, str]()
    for entry in entries:
        excluded |= entry.compared.excluded
        name, test = describe_quantity(entry.quantity), entry.friedman
        if test is None:
            untested.setdefault(entry.note, []).append(name)
        elif differ := [" / ".join(pair.methods) for pair in test.pairs if pair.significant]:
            said.append(f"{name}: {', '.join(differ)} differ (Tukey's HSD).")
    said += [f"{'; '.join(names)}: {note}." for note, names in untested.items()]
    if excluded:
        said.append("Not counted: " + ", ".join(f"{s} ({why})" for s, why in excluded.items()) + ".")
    return " ".join(said)


def _build_quantity_blocks(found: StatisticsDocument, *kinds: str) -> list[Block]:
    return [block for kind in kinds for block in _build_blocks_of_kind(kind, getattr(found, kind))]


def _build_blocks_of_kind(kind: str, entries: Sequence[QuantityEntry]) -> Iterator[Block]:
    """A table, and each quantity's values as dots."""
    if not entries:
        return
    title, unit = TITLES[kind], _UNITS[kind.rpartition("_")[2]]
    methods = list(dict.fromkeys(m for entry in entries for m in entry.compared.methods))
    columns: list[str | Cell] = ["", "subjects", *list_method_columns(methods), "Friedman p"]
    caption = f"{title} (mean ± SD over subjects), {unit}"
    yield Table(
        caption=caption,
        columns=columns,
        rows=list_quantity_rows(entries, methods),
        note=describe_comparisons(entries),
    )
    first = {entry.quantity: entry for entry in reversed(entries)}  # that of most methods comes first
    several = [entry for entry in reversed(first.values()) if len(entry.values) > 1]
    if several:
        yield Grid([_draw_dots(e, unit, f"{title}, {describe_quantity(e.quantity)}") for e in several])


def build_angle_blocks(curves: Sequence[CurveEntry]) -> Iterator[Block]:
    """Every angle's curves and tests; a sentence where nobody walked."""
    if not curves:
        yield Text("No subject has a whole stride, so joint angles over the gait cycle are not compared.")
        return
    yield Text(
        "Mean and SD (shaded) over subjects; each subject's strides are averaged first, so that a subject "
        "counts once. Grey bars: where the methods differ (repeated-measures analysis of variance along the "
        "curve, thresholds by permutation, 5 % for each angle)."
    )
    yield make_method_legend(list(dict.fromkeys(m for c in curves for m in c.compared.methods)))
    yield Grid([_draw_curves(curve) for curve in curves])
    yield tabulate_curves(curves)


def tabulate_curves(curves: Sequence[CurveEntry]) -> Table:
    """Where along the gait cycle methods differ, for every angle."""
    reference = next((c.reference for c in curves if c.reference is not None), None)
    pairs = f"pairs with {reference}" if reference else "pairs"
    return Table(
        caption="Do the methods differ along the curve?",
        columns=["angle", "subjects", "p", "where, % of the cycle", pairs],
        rows=[Row(spell_name(curve.coordinate), _format_curve_cells(curve)) for curve in curves],
        note="Pairs are paired t tests by permutation and share 5 % (Bonferroni).",
        words=True,
    )


def _format_curve_cells(curve: CurveEntry) -> list[str]:
    count = str(len(curve.compared.subjects))
    if curve.anova is None:
        return [count, "–", "–", curve.note]
    pairs = "; ".join(
        f"{' / '.join(pair.methods)}: "
        + (describe_spans(pair.test.spans) if pair.test.can_decide else "too few subjects")
        for pair in curve.pairs
    )
    p = format_p(curve.anova.p) if curve.anova.can_decide else "too few subjects to decide"
    said = pairs or "not asked, for the analysis of variance finds nothing"
    return [count, p, describe_spans(curve.anova.spans), said]


def _build_subjects(document: CohortDocument) -> Iterator[Block]:
    rows = [
        Row(s.id, [s.status, _describe_end(s), ", ".join(s.methods), f"{s.wall_s:.1f}"])
        for s in document.subjects
    ]
    yield Table(
        caption="How every subject ended",
        columns=["", "status", "why", "methods", "s"],
        rows=rows,
        words=True,
    )
    if document.notes:
        yield Bullets(document.notes)
    settings = [Row(name, [str(value)]) for name, value in document.settings.items()]
    yield Details(
        "Settings",
        [
            Table(
                caption="Settings", columns=["", ""], rows=settings, note=f"Seed {document.seed}.", words=True
            )
        ],
    )


def _describe_end(subject: SubjectEntry) -> str:
    left_out = "; ".join(f"no {method}: {why}" for method, why in subject.left_out.items())
    kept = "kept from an earlier run" if subject.kept else ""
    return "; ".join(text for text in (subject.reason, left_out, kept) if text)


def _build_summary(document: CohortDocument) -> Iterator[Block]:
    """The headline, what it rests on, and OpenSim's limits."""
    found = document.statistics
    yield Callout(document.headline, [Bullets(document.why)])
    yield _tabulate_gates(found)
    if found.notes:
        yield Bullets(found.notes)


def _tabulate_gates(found: StatisticsDocument) -> Table:
    rows = [
        Row(g.method, [f"{g.subjects_passed} of {g.subjects}", f"{g.trials_passed} of {g.trials}"])
        for g in found.opensim_limits.methods
    ]
    return Table(
        caption="OpenSim's limits for marker errors: RMS below 20 mm, largest below 40 mm",
        columns=["", "subjects that keep them", "trials that keep them"],
        rows=rows,
        note="Necessary, not sufficient: fitted numbers absorb errors.",
    )


def _build_agreement(agreements: Sequence[AgreementEntry]) -> Iterator[Block]:
    """A table for each reference: lengths first, joint centres when asked for."""
    if not agreements:
        yield Text("Too few subjects were imaged, and no truth is known, so agreement cannot be stated.")
        return
    yield Text(
        "Bias is the method minus the reference, with its 95 % interval; 95 % of the differences lie within "
        "the limits (Bland and Altman). ICC is that of absolute agreement."
    )
    for reference in dict.fromkeys(item.reference for item in agreements):
        own = [item for item in agreements if item.reference == reference]
        name = "the image (EB)" if reference == IMAGED else reference
        lengths = [item for item in own if "." not in item.quantity]
        centres = [item for item in own if "." in item.quantity]
        if lengths:
            yield _tabulate_agreement(f"Segment lengths against {name}, mm", lengths)
        if centres:
            title = f"Joint centres against {name}"
            yield Details(title, [_tabulate_agreement(f"{title}, mm", centres)])


def _tabulate_agreement(caption: str, items: Sequence[AgreementEntry]) -> Table:
    rows = []
    for item in items:
        joint, _, axis = item.quantity.partition(".")
        bias, lower, upper = item.bias_mm, item.lower_mm.value, item.upper_mm.value
        cells = [
            str(len(item.subjects)),
            f"{bias.value:+.1f} ({bias.low:+.1f} to {bias.high:+.1f})",
            f"{lower:+.1f} to {upper:+.1f}",
            f"{item.rmse_mm:.1f}",
            _format_icc(item.icc_agreement),
        ]
        rows.append(Row(f"{f'{spell_name(joint)} {axis}'.strip()}, {item.method}", cells))
    return Table(
        caption=caption,
        columns=["", "subjects", "bias (95 %)", "limits of agreement", "RMS", "ICC"],
        rows=rows,
    )


def _format_icc(found: Interval | None) -> str:
    if found is None:
        return "–"
    return f"{found.value:.2f}" + ("" if found.low is None else f" ({found.low:.2f} to {found.high:.2f})")


def _draw_dots(entry: QuantityEntry, unit: str, caption: str) -> Figure:
    """Every subject's value under each method, with mean and SD."""
    methods = entry.compared.methods
    known = list_styles(methods)
    count = max(len(entry.values) - 1, 1)
    traces = [
        go.Scatter(
            x=[k + _JITTER * (2.0 * n / count - 1.0) for n in range(len(entry.values))],
            y=[of[method] for of in entry.values.values()],
            mode="markers",
            marker={"color": known[method].colour, "size": 5, "opacity": 0.6},
            text=[escape_plain(subject) for subject in entry.values],
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
    figure = make_chart(traces, y_title=unit, hovermode="closest")
    figure.update_xaxes(tickvals=list(range(len(methods))), ticktext=[escape_plain(m) for m in methods])
    described = ", ".join(f"{m} {a:.1f} ± {b:.1f}" for m, a, b in zip(methods, mean, sd, strict=True))
    return Figure(figure, caption, f"{caption}: {described} {unit}.", 240)


def _draw_curves(curve: CurveEntry) -> Figure:
    """A joint angle by each method, grey bars where they differ."""
    mean, sd = ({m: np.array(v) for m, v in of.items()} for of in (curve.mean_deg, curve.sd_deg))
    count = len(curve.compared.subjects)
    title = f"{spell_name(curve.coordinate)} ({count} subject{'s' if count != 1 else ''})"
    differ = [] if curve.anova is None else curve.anova.spans
    return draw_cycle(
        title, f"{title} over the gait cycle by method. {describe_ranges(mean)}", mean, sd, differ
    )
