"""The chapter on how closely each model follows the markers, per marker and over time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from scaling_service.capabilities.scaling.report.data import Curves, SubjectData
from scaling_service.documents.results import MethodResult, TrialError
from scaling_service.report.blocks import Block, Cell, Grid, Heading, Row, Table, Text
from scaling_service.report.figures import Figure, chart
from scaling_service.report.methods import lines, method_columns, method_legend, number, union
from scaling_service.report.page import Section

_ROLES = (("evaluation", "Held out: never fitted"), ("calibration", "Used to fit"))
_DARKEST = 30.0  # mm; chosen: beyond it a marker is lost rather than badly followed


def errors_section(data: SubjectData) -> Section:
    """Mean errors of all trials, errors over time and per marker; held-out and fitted trials apart."""
    return Section("Distance to the measured markers", list(_blocks(data)), new_page=True)


def _blocks(data: SubjectData) -> Iterator[Block]:
    methods = data.document.methods
    if not any(m.kinematic_error_mm for m in methods.values()):
        yield Text("No movement was recorded, so there is nothing to follow.")
        return
    yield Text(
        "Fitted trials flatter a fit. Held-out ones do less, above all where they show another movement than "
        "the fitted ones: skin that slides the same way in both is not found out."
    )
    yield _summary(methods)
    yield method_legend(list(methods))
    for role, title in _ROLES:
        curves = [c for c in data.errors if c.held_out == (role == "evaluation")]
        per_marker = _per_marker(methods, role)
        if curves or per_marker:
            yield Heading(title)
        if curves:
            yield Grid([_over_time(curve) for curve in curves])
        if per_marker:
            yield _marker_table(methods, per_marker, title)


def _summary(methods: Mapping[str, MethodResult]) -> Table:
    rows: list[Row] = []
    for role, title in _ROLES:
        trials = _trials(methods, role)
        if trials:
            rows.append(Row(title))
        rows += [
            Row(trial, [_mean_sd(m.kinematic_error_mm.get(trial)) for m in methods.values()])
            for trial in trials
        ]
    return Table(
        "Kinematic error, mm: mean ± SD over frames (largest)", ["", *method_columns(list(methods))], rows
    )


def _trials(methods: Mapping[str, MethodResult], role: str) -> list[str]:
    errors = union(m.kinematic_error_mm for m in methods.values())
    return [
        trial
        for trial in errors
        if any(
            trial in m.kinematic_error_mm and m.kinematic_error_mm[trial].role == role
            for m in methods.values()
        )
    ]


def _mean_sd(error: TrialError | None) -> str:
    return "–" if error is None else f"{error.mean:.1f} ± {error.sd:.1f} ({error.max:.0f})"


def _over_time(curve: Curves) -> Figure:
    said = ", ".join(f"{name} {np.nanmean(values):.1f}" for name, values in curve.values.items())
    return Figure(
        chart(
            lines(curve.x, curve.values),
            x_title="time, s",
            y_title="mean distance, mm",
            yaxis_rangemode="tozero",
        ),
        curve.trial,
        f"Mean distance between measured and model markers over time in {curve.trial}, mm. Means: {said}.",
        220,
    )


def _per_marker(methods: Mapping[str, MethodResult], role: str) -> dict[str, dict[str, float]]:
    """Marker to method to the mean over trials, mm."""
    trials = _trials(methods, role)
    found: dict[str, dict[str, float]] = {}
    for name, method in methods.items():
        errors = [method.kinematic_error_mm[t].per_marker for t in trials if t in method.kinematic_error_mm]
        for marker in union(errors):
            seen = [error[marker] for error in errors if marker in error]
            found.setdefault(marker, {})[name] = sum(seen) / len(seen)
    return found


def _marker_table(
    methods: Mapping[str, MethodResult], per_marker: Mapping[str, Mapping[str, float]], title: str
) -> Table:
    return Table(
        f"{title}: mean distance per marker, mm",
        ["marker", *method_columns(list(methods))],
        [Row(marker, _cells(methods, by_method)) for marker, by_method in per_marker.items()],
        "Mean over the trials that show the marker. The darker, the further.",
    )


def _cells(methods: Mapping[str, MethodResult], by_method: Mapping[str, float]) -> Sequence[Cell]:
    return [
        Cell(
            number(by_method.get(name)),
            shade=by_method[name] / _DARKEST if name in by_method else None,
        )
        for name in methods
    ]
