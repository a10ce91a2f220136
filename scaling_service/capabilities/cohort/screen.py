"""What people see of a cohort: methods compared over its subjects, who did not end well, and the files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from scaling_service.capabilities.shared.screen import console_of_results, say
from scaling_service.core.text import few

if TYPE_CHECKING:
    from scaling_service.capabilities.cohort.document import (
        CohortDocument,
        QuantityEntry,
        StatisticsDocument,
        SubjectEntry,
    )


def show_cohort(document: CohortDocument, out: Path, files: Sequence[str]) -> None:
    """The table of methods over subjects, then the subjects that are not done, notes and files."""
    console = console_of_results()
    ended = [s.status for s in document.subjects]
    counts = ", ".join(f"{ended.count(status)} {status}" for status in ("done", "skipped", "failed"))
    console.print(f"Cohort [bold]{escape(document.cohort)}[/bold]: {counts}", highlight=False, soft_wrap=True)
    if "done" in ended:
        console.print(_table(document.statistics))
        for line in _tested(document.statistics):
            console.print(line, highlight=False, soft_wrap=True)
    say(console, "Note", "yellow", _notes(document) if "done" in ended else document.notes)
    _show_others(console, document.subjects)
    console.print(f"Written under [bold]{escape(str(out))}[/bold]:", highlight=False)
    folders = [s.folder for s in document.subjects if s.folder is not None]
    for line in ([f"{', '.join(folders)}  as `compare` writes them"] if folders else []) + list(files):
        console.print(f"  {escape(line)}", highlight=False, soft_wrap=True)


def _table(found: StatisticsDocument) -> Table:
    methods = [gate.method for gate in found.opensim_limits.methods]
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("mean ± sd over subjects")
    for method in methods:
        table.add_column(method, justify="right")
    table.add_column("n", justify="right")
    table.add_column("Friedman p", justify="right")
    for title, entries, digits in (
        ("Kinematic error, mm", found.kinematic_error_mm, 1),
        ("Segment lengths, mm", found.segment_lengths_mm, 1),
        ("Knee axis turned, deg", found.knee_axis_deg, 1),
        ("Marker shift, mm", found.marker_shift_mm, 1),
        ("Distance from the truth, mm", found.from_truth_mm, 1),
        ("Distance from the truth, deg", found.from_truth_deg, 1),
    ):
        if entries:
            table.add_row(f"[bold]{title}[/bold]")
        for entry in entries:
            table.add_row(f"  {_name(entry)}", *_cells(entry, methods, digits))
    limits = found.opensim_limits
    kept = {gate.method: f"{gate.subjects_passed} of {gate.subjects}" for gate in limits.methods}
    table.add_row("[bold]Within OpenSim's limits[/bold]", *kept.values())
    return table


def _name(entry: QuantityEntry) -> str:
    names = {"calibration": "used to fit", "evaluation": "held out", "mean_over_markers": "mean over markers"}
    return names.get(entry.quantity, entry.quantity)


def _cells(entry: QuantityEntry, methods: Sequence[str], digits: int) -> Iterator[str]:
    for method in methods:
        if method not in entry.mean:
            yield ""
        elif method in entry.sd:
            yield f"{entry.mean[method]:.{digits}f} ± {entry.sd[method]:.{digits}f}"
        else:
            yield f"{entry.mean[method]:.{digits}f}"
    yield str(len(entry.compared.subjects))
    yield "" if entry.friedman is None else _p(entry.friedman.p)


def _p(value: float) -> str:
    return "< 0.001" if value < 0.001 else f"{value:.3f}"


def _tested(found: StatisticsDocument) -> Iterator[str]:
    """Pairs that differ, and stretches of the gait cycle; each said once."""
    for title, entries in (("error", found.kinematic_error_mm), ("length", found.segment_lengths_mm)):
        for entry in entries:
            differ = [p.methods for p in entry.friedman.pairs if p.significant] if entry.friedman else []
            if differ:
                pairs = "; ".join(f"{a} and {b}" for a, b in differ)
                yield f"Differ in {title}, {_name(entry)} (Tukey's HSD): {pairs}"
    for curve in found.joint_angles:
        for pair in curve.pairs:
            if pair.test.clusters:
                where = ", ".join(f"{c.start_percent:.0f}-{c.end_percent:.0f} %" for c in pair.test.clusters)
                both = " and ".join(pair.methods)
                yield f"Differ in {curve.coordinate}: {both} at {where} of the gait cycle"


def _notes(document: CohortDocument) -> list[str]:
    """What limits the statistics, each said once: who is left out of what, and what was not tested."""
    found = document.statistics
    scalars = [*found.segment_lengths_mm, *found.kinematic_error_mm, *found.knee_axis_deg]
    compared = [*((e.compared, e.note) for e in scalars), *((e.compared, e.note) for e in found.joint_angles)]
    reasons: dict[str, dict[str, None]] = {}
    for who, _ in compared:
        for subject, reason in who.excluded.items():
            reasons.setdefault(subject, {})[reason] = None
    alike: dict[str, list[str]] = {}
    for subject, why in reasons.items():
        alike.setdefault("; ".join(why), []).append(subject)
    excluded = [f"not in all comparisons: {few(who)} ({why})" for why, who in alike.items()]
    untested = dict.fromkeys(note for _, note in compared if note)
    limits = found.opensim_limits
    below = f"{limits.rms_below_mm:.0f} mm RMS and {limits.max_below_mm:.0f} mm at most in every trial"
    gate = f"OpenSim's limits ({below}) are {limits.meaning}"
    return [*document.notes, *found.notes, *excluded, *untested, gate]


def _show_others(console: Console, subjects: Sequence[SubjectEntry]) -> None:
    others = [s for s in subjects if s.status != "done"]
    if not others:
        return
    table = Table(title="Not done", title_justify="left", box=None, pad_edge=False, header_style="bold")
    for heading in ("subject", "", "because"):
        table.add_column(heading, overflow="fold")
    for subject in others:
        table.add_row(escape(subject.id), subject.status, escape(subject.reason))
    console.print(table)
