"""A study done again, on the screen: who is done, then the paper's tables, then its claims."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from scaling_service.capabilities.shared.screen import console_of_results, list_files, print_table
from scaling_service.report.blocks import Table
from scaling_service.studies.claims import StudyDocument, claims_table, count_held


def show_person(name: str, done: int, count: int) -> None:
    """Says who is done, and how many of all are."""
    Console(stderr=True).print(f"{done} of {count}  {name}", markup=False, highlight=False)


def show_study(document: StudyDocument, tables: Iterable[Table], out: Path, files: Sequence[str]) -> None:
    """The tables, every claim, and what was written."""
    console = console_of_results()
    console.print(f"[bold]{escape(document.source)}[/bold]", highlight=False)
    for table in (*tables, claims_table(document)):
        print_table(console, table)
    taken = f"{document.wall_s:.0f} s for {document.size} persons"
    console.print(f"{count_held(document)} claims hold; {taken}", highlight=False)
    list_files(console, out, [", ".join(files)])
