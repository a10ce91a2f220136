"""What people see: a progress bar on a terminal, then a table and the files written."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from scaling_service.core.progress import Progress as Report
from scaling_service.documents.results import ComparisonDocument, LengthEstimate, MethodResult, Provenance

_WIDTH = 120  # columns where the output is no terminal (chosen: five methods and the truth fit)
Cells = Sequence[str]


@contextmanager
def progress_bar() -> Iterator[Report]:
    """A bar on a terminal's stderr that is gone when done; nothing elsewhere."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("starting", total=1.0)

        def report(what: str, share: float) -> None:
            progress.update(task, description=escape(what), completed=share)

        yield report


def show(document: ComparisonDocument, out: Path) -> None:
    """The table of methods, the warnings, and what was written."""
    console = console_of_results()
    introduce(console, document)
    console.print(_table(document))
    say(console, "Note", "yellow", _warnings(document))
    if document.verdict is not None and (out / "comparison.json").is_file():
        say(console, "Verdict", "bold", [document.verdict.headline])
    console.print(f"Written under [bold]{escape(str(out))}[/bold]:", highlight=False)
    for line in written(document, out):
        console.print(f"  {escape(line)}", highlight=False, soft_wrap=True)


def console_of_results() -> Console:
    """The terminal as it is; elsewhere wide enough for the tables."""
    console = Console()
    return console if console.is_terminal else Console(width=_WIDTH)


def written(document: ComparisonDocument, out: Path) -> list[str]:
    """The files of this run, one line for each folder."""
    lines = [f"{m.method}/  {', '.join([*m.files, 'scaling.json'])}" for m in document.methods.values()]
    return [*lines, *(name for name in ("comparison.json", "report.html") if (out / name).is_file())]


def introduce(console: Console, document: Provenance, how: str = "") -> None:
    """Whose result it is and how it came about, then how the files were read."""
    after = f": {escape(how)}" if how else ""
    console.print(f"Subject [bold]{escape(document.subject)}[/bold]{after}", highlight=False)
    for line in understood(document):
        console.print(escape(line), highlight=False, style="dim", soft_wrap=True)


def say(console: Console, word: str, style: str, lines: Iterable[str]) -> None:
    """Lines that begin with a word that says what they are."""
    for line in lines:
        console.print(f"[{style}]{word}[/{style}]  {escape(line)}", highlight=False, soft_wrap=True)


def understood(document: Provenance) -> Iterator[str]:
    """How labels and axes were read: where it was wrong, everything after is."""
    taken = [
        f"{marker} = {' or '.join(labels)}"
        for marker, labels in document.markers_used.items()
        if labels != [marker]
    ]
    if taken:
        yield f"Markers taken: {', '.join(taken)}"
    if document.sizes:
        yield f"Sizes: {', '.join(f'{name} {value:.4g}' for name, value in document.sizes.items())}"
    decided = dict.fromkeys(
        f"{trial}: {repair.detail}" if repair.what == "unit" else repair.detail
        for trial, repairs in document.repairs.items()
        for repair in repairs
        if repair.what in ("up_axis", "forward_axis", "unit")
    )
    yield from decided


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
