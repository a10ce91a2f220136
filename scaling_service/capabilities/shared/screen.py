"""What people see: a progress bar on a terminal, then a table and the files written."""

from __future__ import annotations

from collections import abc
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table as RichTable

from scaling_service.core.names import say_sizes
from scaling_service.core.progress import Progress as Report

if TYPE_CHECKING:
    from rich.console import JustifyMethod

    from scaling_service.documents.results import Provenance
    from scaling_service.report.tables import Cell, Table

_WIDTH = 150  # columns where the output is no terminal (chosen: six methods and the truth fit)

_BLOCKS = 20  # of a bar (chosen: a twentieth is seen)


@contextmanager
def progress_bar() -> abc.Iterator[Report]:
    """A bar on a terminal's stderr that is gone when done; nothing elsewhere."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("starting", total=1.0)

        def report(what: str, share: float) -> None:
            progress.update(task, description=escape(what), completed=share)

        yield report


@contextmanager
def running(out: Path) -> abc.Iterator[Report]:
    """What a command does that writes a folder: the folder can be made, then a bar until all is written."""
    from scaling_service.documents.writing import check_folder

    check_folder(out)
    with progress_bar() as progress:
        yield progress


def make_console() -> Console:
    """The terminal as it is; elsewhere wide enough for the tables."""
    console = Console()
    return console if console.is_terminal else Console(width=_WIDTH)


def print_table(console: Console, table: Table) -> None:
    """A table of a report, its caption above and its note below."""
    if table.caption:
        console.print(f"[bold]{escape(table.caption)}[/bold]", highlight=False, soft_wrap=True)
    shown = RichTable(box=None, pad_edge=False, header_style="bold")
    for k, column in enumerate(table.columns):
        justify: JustifyMethod = "right" if k > 0 and not table.words else "left"
        shown.add_column(escape(_format_cell(column)), justify=justify, overflow="fold")
    for row in table.rows:
        title = escape(_format_cell(row.header))
        cells = [escape(_format_cell(cell)) for cell in row.cells]
        shown.add_row(title if cells else f"[bold]{title}[/bold]", *cells)
    console.print(shown)
    if table.note:
        console.print(escape(table.note), highlight=False, style="dim", soft_wrap=True)


def print_tables(console: Console, tables: abc.Iterable[Table]) -> None:
    """Tables of a report that have the same columns as one, each under its caption; notes are left out."""
    from scaling_service.report.tables import Row, Table

    found = list(tables)
    rows = [
        Row(f"  {_format_cell(row.header)}", row.cells) if row.cells else row
        for table in found
        for row in (Row(table.caption), *table.rows)
    ]
    print_table(console, Table(caption="", columns=max((t.columns for t in found), key=len), rows=rows))


def _format_cell(cell: str | Cell) -> str:
    return cell if isinstance(cell, str) else cell.text


def list_files(console: Console, out: Path, lines: abc.Iterable[str]) -> None:
    """What was written, and where."""
    console.print(f"Written under [bold]{escape(str(out))}[/bold]:", highlight=False)
    for line in lines:
        console.print(f"  {escape(line)}", highlight=False, soft_wrap=True)


def print_subject(console: Console, document: Provenance, how: str = "") -> None:
    """Whose result it is and how it came about, then how the files were read."""
    after = f": {escape(how)}" if how else ""
    console.print(f"Subject [bold]{escape(document.subject)}[/bold]{after}", highlight=False)
    for line in describe_understood(document):
        console.print(escape(line), highlight=False, style="dim", soft_wrap=True)


def say(console: Console, word: str, style: str, lines: abc.Iterable[str]) -> None:
    """Lines that begin with a word that says what they are."""
    for line in lines:
        console.print(f"[{style}]{word}[/{style}]  {escape(line)}", highlight=False, soft_wrap=True)


def draw_bar(share: float) -> str:
    """A share of one as a bar of twenty blocks.

    Examples
    --------
    >>> draw_bar(0.24)
    '█████░░░░░░░░░░░░░░░'
    """
    full = round(_BLOCKS * min(max(share, 0.0), 1.0))
    return "█" * full + "░" * (_BLOCKS - full)


def describe_understood(document: Provenance) -> abc.Iterator[str]:
    """How labels and axes were read: where it was wrong, everything after is."""
    taken = [
        f"{marker} = {' or '.join(labels)}"
        for marker, labels in document.markers_used.items()
        if labels != [marker]
    ]
    if taken:
        yield f"Markers taken: {', '.join(taken)}"
    if document.sizes:
        yield f"Sizes: {say_sizes(document.sizes)}"
    decided = dict.fromkeys(
        f"{trial}: {repair.detail}" if repair.what == "unit" else repair.detail
        for trial, repairs in document.repairs.items()
        for repair in repairs
        if repair.what in ("up_axis", "forward_axis", "unit", "smoothing")
        or (repair.what == "not_smoothed" and repair.where == trial)
    )
    yield from decided
