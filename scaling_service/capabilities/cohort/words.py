"""What a cohort shows, once for terminal and report: a summary and its tables."""

from __future__ import annotations

from collections import abc

from scaling_service.capabilities.cohort import result as documents
from scaling_service.core.names import spell_name
from scaling_service.core.text import format_p
from scaling_service.report import tables, words
from scaling_service.report.summary import Summary

TITLES: abc.Mapping[str, str] = {
    "kinematic_error_mm": "Kinematic error",
    "segment_lengths_mm": "Segment lengths",
    "knee_axis_deg": "Knee axes, turns from the thigh's z",
    "marker_shift_mm": "Marker shifts",
    "from_truth_mm": "Distance from the truth",
    "from_truth_deg": "Joint angles, RMS distance from the truth",
}
"""The document's lists of quantities, as people call them."""

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


def summarise(document: documents.CohortDocument) -> Summary:
    """What the cohort shows, what to beware of, the methods over subjects, and how every subject ended."""
    done = any(subject.status == "done" for subject in document.subjects)
    statistics = make_screen_tables(document.statistics) if done else ()
    ends = []
    for subject in document.subjects:
        left_out = "; ".join(f"no {method}: {why}" for method, why in subject.left_out.items())
        kept = "kept from an earlier run" if subject.kept else ""
        why = "; ".join(text for text in (subject.reason, left_out, kept) if text)
        ends.append(tables.Row(subject.id, [subject.status, why, ", ".join(subject.methods)]))
    return Summary(
        title="Scaling methods compared over a cohort",
        subtitle=document.cohort,
        headline=document.headline,
        why=document.why,
        cautions=[*document.notes, *document.statistics.notes],
        tables=[
            *statistics,
            tables.Table(
                caption="How every subject ended",
                columns=["", "status", "why", "methods"],
                rows=ends,
                words=True,
            ),
        ],
    )


def make_screen_tables(found: documents.StatisticsDocument) -> abc.Iterator[tables.Table]:
    """For the terminal: all quantities in one table, OpenSim's limits, and where angles differ."""
    methods = [gate.method for gate in found.opensim_limits.methods]
    rows: list[tables.Row] = []
    everything: list[documents.QuantityEntry] = []
    for kind, title in TITLES.items():
        if entries := getattr(found, kind):
            rows.append(tables.Row(f"{title}, {_UNITS[kind.rpartition('_')[2]]}"))
            rows += [
                tables.Row(
                    describe_quantity(entry.quantity),
                    [
                        str(len(entry.compared.subjects)),
                        *(_spread(entry, method) for method in methods),
                        "–" if entry.friedman is None else format_p(entry.friedman.p),
                    ],
                )
                for entry in entries
            ]
            everything += entries
    columns = ["mean ± SD over subjects", "subjects", *methods, "Friedman p"]
    yield tables.Table(
        caption="The methods over subjects", columns=columns, rows=rows, note=describe_comparisons(everything)
    )
    kept = [
        tables.Row(g.method, [f"{g.subjects_passed} of {g.subjects}", f"{g.trials_passed} of {g.trials}"])
        for g in found.opensim_limits.methods
    ]
    yield tables.Table(
        caption="OpenSim's limits for marker errors: RMS below 20 mm, largest below 40 mm",
        columns=["", "subjects that keep them", "trials that keep them"],
        rows=kept,
        note="Necessary, not sufficient: fitted numbers absorb errors.",
    )
    if any(curve.anova is not None for curve in found.joint_angles):
        yield tabulate_curves(found.joint_angles)


def describe_quantity(name: str) -> str:
    """A quantity's name for people."""
    return _NAMES.get(name, spell_name(name))


def _spread(entry: documents.QuantityEntry, method: str) -> str:
    if method not in entry.mean:
        return "–"
    sd = f" ± {entry.sd[method]:.1f}" if method in entry.sd else ""
    return f"{entry.mean[method]:.1f}{sd}"


def describe_comparisons(entries: abc.Sequence[documents.QuantityEntry]) -> str:
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


def tabulate_curves(curves: abc.Sequence[documents.CurveEntry]) -> tables.Table:
    """Where along the gait cycle methods differ, for every angle."""
    reference = next((c.reference for c in curves if c.reference is not None), None)
    pairs = f"pairs with {reference}" if reference else "pairs"
    return tables.Table(
        caption="Do the methods differ along the curve?",
        columns=["angle", "subjects", "p", "where, % of the cycle", pairs],
        rows=[tables.Row(spell_name(curve.coordinate), _format_curve_cells(curve)) for curve in curves],
        note="Pairs are paired t tests by permutation and share 5 % (Bonferroni).",
        words=True,
    )


def _format_curve_cells(curve: documents.CurveEntry) -> list[str]:
    count = str(len(curve.compared.subjects))
    if curve.anova is None:
        return [count, "–", "–", curve.note]
    pairs = "; ".join(
        f"{' / '.join(pair.methods)}: "
        + (words.describe_spans(pair.test.spans) if pair.test.can_decide else "too few subjects")
        for pair in curve.pairs
    )
    p = format_p(curve.anova.p) if curve.anova.can_decide else "too few subjects to decide"
    said = pairs or "not asked, for the analysis of variance finds nothing"
    return [count, p, words.describe_spans(curve.anova.spans), said]
