"""A study done again, on the screen: who is done, then the paper's tables, then its claims."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from scaling_service.capabilities.shared.screen import console_of_results
from scaling_service.studies.claims import StudyDocument

_WORDS = {True: "[green]holds[/green]", False: "[red]not[/red]", None: "[yellow]undecided[/yellow]"}


def counting(count: int) -> Callable[[str, int], None]:
    """Says of each person that is done who it is, and how many of all are."""
    stderr = Console(stderr=True)

    def finished(name: str, done: int) -> None:
        stderr.print(f"{done} of {count}  {name}", markup=False, highlight=False)

    return finished


def titled_table(title: str, headings: Iterable[str], *, numbers: bool = True) -> Table:
    """A table of numbers, or of words, whose first column has no heading."""
    table = Table(box=None, pad_edge=False, header_style="bold", title=title, title_justify="left")
    table.add_column("")
    for heading in headings:
        table.add_column(heading, justify="right" if numbers else "left")
    return table


def show_study(
    document: StudyDocument,
    tables: Iterable[Table],
    out: Path,
    files: Sequence[str],
    *,
    figures: bool = False,
) -> None:
    """The tables, every claim (with its figures where asked for), and what was written."""
    console = console_of_results()
    console.print(f"[bold]{escape(document.source)}[/bold]", highlight=False)
    for table in tables:
        console.print(table)
    headings = ("where", "claim", "here") if figures else ("where", "claim")
    claims = titled_table("Does it hold here?", headings, numbers=False)
    for claim in document.claims:
        cells = (claim.where, escape(claim.claim), escape(claim.ours))
        claims.add_row(_WORDS[claim.holds], *cells[: len(headings)])
    console.print(claims)
    held = sum(claim.holds is True for claim in document.claims)
    console.print(
        f"{held} of {len(document.claims)} claims hold; {document.wall_s:.0f} s for {document.size} persons",
        highlight=False,
    )
    console.print(f"Written under [bold]{escape(str(out))}[/bold]: {', '.join(files)}", highlight=False)
