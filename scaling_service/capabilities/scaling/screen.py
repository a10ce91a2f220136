"""What people see of a comparison: the table of methods, the warnings, the verdict, and the files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.markup import escape
from rich.table import Table

from scaling_service.capabilities.shared.screen import console_of_results, introduce, list_files, say

if TYPE_CHECKING:
    from scaling_service.documents.results import ComparisonDocument, LengthEstimate, MethodResult

Cells = Sequence[str]


def show(document: ComparisonDocument, out: Path) -> None:
    """The table of methods, the warnings, and what was written."""
    console = console_of_results()
    introduce(console, document)
    console.print(_table(document))
    say(console, "Note", "yellow", _warnings(document))
    if document.verdict is not None and (out / "comparison.json").is_file():
        say(console, "Verdict", "bold", [document.verdict.headline])
    list_files(console, out, written(document, out))


def written(document: ComparisonDocument, out: Path) -> list[str]:
    """The files of this run, one line for each folder."""
    lines = [f"{m.method}/  {', '.join([*m.files, 'scaling.json'])}" for m in document.methods.values()]
    return [*lines, *(name for name in ("comparison.json", "report.html") if (out / name).is_file())]


def _warnings(document: ComparisonDocument) -> list[str]:
    by_method = (warning for method in document.methods.values() for warning in method.warnings)
    return list(dict.fromkeys((*document.warnings, *by_method)))


def _table(document: ComparisonDocument) -> Table:
    methods = list(document.methods.values())
    truth = document.truth
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("")
    for method in methods:
        table.add_column(method.method, justify="right")
    if truth is not None:
        table.add_column("truth", justify="right")
    for title, rows in (
        ("Kinematic error, mm (mean ± sd over frames)", _errors(methods)),
        (
            "Segment lengths, mm (± standard deviation)",
            _lengths(methods, truth.segment_lengths_mm if truth else {}),
        ),
        ("Knee axis turned about x, y, deg", _axes(methods)),
        ("Mean marker shift, mm", [("", [_mean_shift(m) for m in methods])]),
        ("Fitted numbers", _fitted(methods)),
        ("Distance from the truth", _distances(methods, truth.errors if truth else {})),
    ):
        shown = [(name, cells) for name, cells in rows if any(cells)]
        if shown:
            table.add_row(
                f"[bold]{title}[/bold]" if shown[0][0] else title, *([] if shown[0][0] else shown[0][1])
            )
        for name, cells in shown:
            if name:
                table.add_row(f"  {escape(name)}", *cells)
    return table


def _errors(methods: Sequence[MethodResult]) -> Iterator[tuple[str, Cells]]:
    for name in _union(m.kinematic_error_mm for m in methods):
        errors = [m.kinematic_error_mm.get(name) for m in methods]
        used = any(e is not None and e.role == "calibration" for e in errors)
        yield (
            f"{name} (used to fit)" if used else f"{name} (held out)",
            [f"{e.mean:.1f} ± {e.sd:.1f}" if e is not None else "" for e in errors],
        )
    if any(e.tracking_mean is not None for m in methods for e in m.kinematic_error_mm.values()):
        yield "all, on bony landmarks", [_pooled(m, "anatomical_mean") for m in methods]
        yield "all, tracking markers", [_pooled(m, "tracking_mean") for m in methods]
    yield "mean, used to fit", [_number(m.fitted_mean_mm) or "none" for m in methods]
    yield "mean, held out", [_number(m.held_out_mean_mm) or "none" for m in methods]
    yield "held out over used to fit", [_ratio(m.held_out_ratio) for m in methods]


def _pooled(method: MethodResult, key: str) -> str:
    """Mean over trials of one kind of marker."""
    values = [getattr(error, key) for error in method.kinematic_error_mm.values()]
    known = [value for value in values if value is not None]
    return f"{sum(known) / len(known):.1f}" if known else ""


def _lengths(methods: Sequence[MethodResult], true: Mapping[str, float]) -> Iterator[tuple[str, Cells]]:
    for name in _union(m.segment_lengths_mm for m in methods):
        cells = [_with_sd(m.segment_lengths_mm.get(name), m.length_estimates.get(name)) for m in methods]
        yield name, [*cells, _number(true.get(name))] if true else cells


def _axes(methods: Sequence[MethodResult]) -> Iterator[tuple[str, Cells]]:
    for side in _union(m.knee_axis_deg for m in methods):
        axes = [m.knee_axis_deg.get(side) for m in methods]
        yield side, [f"{a.x:.1f}, {a.y:.1f}" if a is not None else "" for a in axes]


def _fitted(methods: Sequence[MethodResult]) -> Iterator[tuple[str, Cells]]:
    """How many, and how many of them mean little."""
    if any(m.parameters for m in methods):
        yield "in all", [str(len(m.parameters)) for m in methods]
        yield "not determined", [str(sum(not p.identifiable for p in m.parameters)) for m in methods]
        yield "at their bounds", [str(sum(p.at_bound for p in m.parameters)) for m in methods]


def _mean_shift(method: MethodResult) -> str:
    shifts = list(method.marker_shift_mm.values())
    return f"{sum(shifts) / len(shifts):.1f}" if shifts else ""


def _distances(
    methods: Sequence[MethodResult], errors: Mapping[str, Mapping[str, float]]
) -> Iterator[tuple[str, Cells]]:
    for name in _union(errors.values()):
        yield name, [_number(errors.get(m.method, {}).get(name)) for m in methods]


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.1f}"


def _with_sd(value: float | None, estimate: LengthEstimate | None) -> str:
    return _number(value) + (f" ± {estimate.sd_mm:.1f}" if estimate is not None else "")


def _ratio(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"


def _union(mappings: Iterable[Mapping[str, object]]) -> list[str]:
    return list(dict.fromkeys(name for mapping in mappings for name in mapping))
