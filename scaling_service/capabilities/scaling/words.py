"""What is said of a comparison of methods, once for terminal and report: a summary and its tables."""

from __future__ import annotations

from collections import abc

from scaling_service.core.names import spell_name
from scaling_service.documents import results
from scaling_service.report import tables, words
from scaling_service.report.summary import Summary

Methods = abc.Mapping[str, results.MethodResult]


def summarise(document: results.ComparisonDocument) -> Summary:
    """Which method to use for this person, why, how far to trust it, and all that the terminal shows."""
    verdict = document.verdict
    muscles = [] if document.muscles is None else document.muscles.summary
    trust = [] if verdict is None else [tabulate_trust(verdict)]
    return Summary(
        title=f"Scaled models of {document.subject}",
        subtitle=f"Methods: {', '.join(document.methods)}",
        headline="" if verdict is None else verdict.headline,
        tone="plain" if verdict is None else verdict.tone,
        why=[*([] if verdict is None else verdict.why), *muscles],
        cautions=document.all_warnings,
        tables=[*trust, *make_comparison_tables(document)],
    )


def tabulate_trust(verdict: results.VerdictDocument) -> tables.Table:
    """How far to trust the method that the verdict names."""
    return tables.Table(
        caption=f"How far to trust {verdict.method}",
        columns=["", "trust", "because"],
        rows=[
            tables.Row(
                t.topic, [tables.Cell("not known" if t.level == "unknown" else t.level, tone=t.level), t.text]
            )
            for t in verdict.trust
        ],
        words=True,
    )


def make_comparison_tables(document: results.ComparisonDocument) -> abc.Iterator[tables.Table]:
    """All that the terminal shows."""
    methods, truth = document.methods, document.truth
    yield tabulate_errors(methods)
    yield tabulate_lengths(methods, truth.segment_lengths_mm if truth else {})
    if any(m.knee_axis_deg for m in methods.values()):
        yield tabulate_axes(methods)
    if any(m.parameters for m in methods.values()):
        yield tabulate_fitted(methods)
    if truth is not None:
        yield tabulate_truth(truth)


def tabulate_errors(methods: Methods) -> tables.Table:
    """Kinematic errors of all trials, and their means."""
    of = methods.values()
    served = {"evaluation": "held out", "calibration": "used to fit"}
    roles = {trial: served[e.role] for m in of for trial, e in m.kinematic_error_mm.items()}
    rows = [
        tables.Row(f"{trial} ({role})", [_format_error(m.kinematic_error_mm.get(trial)) for m in of])
        for trial, role in sorted(roles.items(), key=lambda item: item[1])  # held-out ones first
    ]
    errors = [list(m.kinematic_error_mm.values()) for m in of]
    if any(e.tracking_mean is not None for own in errors for e in own):
        bony = [_format_mean([e.anatomical_mean for e in own]) for own in errors]
        tracking = [_format_mean([e.tracking_mean for e in own]) for own in errors]
        rows.append(tables.Row("all, on bony landmarks", bony))
        rows.append(tables.Row("all, tracking markers", tracking))
    rows += [
        tables.Row("mean, used to fit", [_format_or_none(m.fitted_mean_mm) for m in of]),
        tables.Row("mean, held out", [_format_or_none(m.held_out_mean_mm) for m in of]),
        tables.Row("held out over fitted", [words.number(m.held_out_ratio, 2) for m in of]),
    ]
    return _make_table(
        "Kinematic error, mm", methods, rows, "Mean ± SD over frames, in brackets the largest."
    )


def tabulate_lengths(methods: Methods, truth: abc.Mapping[str, float]) -> tables.Table:
    """Segment lengths with their deviations, and how far they are from the truth where that is known."""
    rows = []
    for name in words.unite_keys(m.segment_lengths_mm for m in methods.values()):
        cells = [_format_length(m, name, truth.get(name)) for m in methods.values()]
        known = [words.number(truth.get(name))] if truth else []
        rows.append(tables.Row(spell_name(name), [*cells, *known]))
    note = "Between joint centres. ± is one standard deviation, from the errors of markers and sizes."
    note += " In brackets: the difference from the truth." if truth else ""
    return _make_table("Segment lengths, mm", methods, rows, note, ["truth"] if truth else [])


def tabulate_axes(methods: Methods) -> tables.Table:
    """Turns of the knees' axes."""
    rows = []
    for side in words.unite_keys(m.knee_axis_deg for m in methods.values()):
        axes = [m.knee_axis_deg.get(side) for m in methods.values()]
        name = {"r": "right", "l": "left"}.get(side, side)
        for axis in "xy":
            turns = [words.format_signed(None if a is None else getattr(a, axis)) for a in axes]
            rows.append(tables.Row(f"{name}, about {axis}", turns))
    return _make_table(
        "Knee axes, degrees",
        methods,
        rows,
        "Turned from the thigh's z axis; over 26 persons by less than 2° on average, 2 to 4° SD (Puchaud "
        "2019, table 3).",
    )


def tabulate_fitted(methods: Methods) -> tables.Table:
    """How many numbers were fitted, how many of them mean little, and how far markers moved."""
    fitted = [m.parameters for m in methods.values()]
    rows = [
        tables.Row("in all", [str(len(own)) for own in fitted]),
        tables.Row("not determined", [str(sum(not p.identifiable for p in own)) for own in fitted]),
        tables.Row("at a bound", [str(sum(p.at_bound for p in own)) for own in fitted]),
        tables.Row(
            "mean marker shift, mm", [_format_mean([*m.marker_shift_mm.values()]) for m in methods.values()]
        ),
    ]
    return _make_table(
        "Fitted numbers",
        methods,
        rows,
        "Not determined: the recordings say less about it than the first guess, or it belongs to a "
        "combination that changes nothing in the markers. Such numbers mean little alone.",
    )


def tabulate_truth(truth: results.TruthDocument) -> tables.Table:
    """Of a virtual person: each method's distance from what is known."""
    rows = [
        tables.Row(
            "{0}, {2}".format(*name.rpartition("_")).replace("_", " "),
            [words.number(errors.get(name)) for errors in truth.errors.values()],
        )
        for name in words.unite_keys(truth.errors.values())
    ]
    note = "This person is virtual. On held-out trials."
    return _make_table("Distance from the truth", truth.errors, rows, note)


def _make_table(
    caption: str,
    methods: abc.Mapping[str, object],
    rows: abc.Sequence[tables.Row],
    note: str = "",
    more: abc.Sequence[str] = (),
) -> tables.Table:
    return tables.Table(caption=caption, columns=["", *methods, *more], rows=rows, note=note)


def _format_error(error: results.TrialError | None) -> str:
    return "–" if error is None else f"{error.mean:.1f} ± {error.sd:.1f} ({error.max:.0f})"


def _format_length(method: results.MethodResult, name: str, against: float | None) -> str:
    value, estimate = method.segment_lengths_mm.get(name), method.length_estimates.get(name)
    text = words.number(value) + (f" ± {words.number(estimate.sd_mm)}" if estimate is not None else "")
    if value is None or against is None:
        return text
    return f"{text} ({words.format_signed(value - against)})"


def _format_mean(values: abc.Sequence[float | None]) -> str:
    known = [value for value in values if value is not None]
    return words.number(sum(known) / len(known) if known else None)


def _format_or_none(value: float | None) -> str:
    return "none" if value is None else words.number(value)
