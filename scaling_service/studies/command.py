"""The command that does a paper's study again."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from scaling_service.capabilities.cohort.progress import watched
from scaling_service.capabilities.shared import options
from scaling_service.capabilities.shared.screen import console_of_results
from scaling_service.documents.writing import check_folder
from scaling_service.studies.document import Beside, StudyDocument
from scaling_service.studies.futamure.screen import run_futamure
from scaling_service.studies.muller2017.screen import run_muller2017
from scaling_service.studies.puchaud2019.run import reproduce_puchaud2019, save_study
from scaling_service.studies.puchaud2019.study import SUBJECTS


class StudyName(StrEnum):
    """The studies that can be done again."""

    PUCHAUD2019 = "puchaud2019"
    MULLER2017 = "muller2017"
    FUTAMURE = "futamure"


class GenericLegs(StrEnum):
    """What scaling starts from."""

    MEAN = "mean"
    CUSTOM = "custom"


_Subjects = Annotated[
    int | None,
    typer.Option(
        min=1, metavar="N", help="Virtual persons; the paper's number unless given.", show_default=False
    ),
]
_Samples = Annotated[
    int, typer.Option(min=2, metavar="N", help="muller2017: samples per level; the paper took 1000.")
]
_Generic = Annotated[
    GenericLegs,
    typer.Option(
        help="Start from legs of the subjects' mean proportions, or from those of the toolbox CusToM."
    ),
]
_Workers = Annotated[
    int | None,
    typer.Option(min=1, metavar="N", help="Persons at a time; unless given, one per processor core."),
]


_Recordings = Annotated[
    list[Path] | None,
    typer.Option(
        "--recording",
        exists=True,
        dir_okay=False,
        metavar="FILE",
        help="muller2017, futamure: a subject file with forces, shown beside; may be repeated.",
        show_default=False,
    ),
]


def reproduce(
    study: Annotated[StudyName, typer.Argument(help="Which study.", show_default=False)],
    out: options.Out,
    subjects: _Subjects = None,
    samples: _Samples = 1000,
    recording: _Recordings = None,
    generic: _Generic = GenericLegs.MEAN,
    workers: _Workers = None,
    strategy: options.StrategyOption = options.Strategy.ALTERNATING,
    frames: options.Frames = options.DEFAULT_FRAMES,
    seed: options.Seed = 0,
) -> None:
    """Do a paper's study again on virtual persons, and ask of each of its claims whether it holds.

    puchaud2019: 26 persons, five ways to scale their models, with bones imaged. Tables 2, 3 and 5 and
    figures 4 to 6 with the paper's numbers beside ours, in study.json and report.html.

    muller2017: 10 persons on force plates; how uncertain motion and plates make the residual, and what an
    identification of inertia does against the verdict. Figures 7, 8 and 10, and what only truth can tell.

    futamure: 8 squatters on a force plate; motion, lengths and inertia that markers and forces agree on,
    against the classical two steps and the truth. Table 2, and what only truth can tell.

    [bold]Example[/bold]: scaling-service reproduce puchaud2019 --out study
    """
    check_folder(out)
    if study is StudyName.MULLER2017:
        run_muller2017(
            out,
            subjects=subjects,
            recordings=recording or (),
            samples=samples,
            seed=seed,
            worker_count=workers,
        )
        return
    if study is StudyName.FUTAMURE:
        run_futamure(out, subjects=subjects, recordings=recording or (), seed=seed, worker_count=workers)
        return
    settings = options.resolve(strategy, frames, seed, None, None, None)
    with watched() as watcher:
        result = reproduce_puchaud2019(
            settings,
            subjects=subjects or SUBJECTS,
            generic=generic.value,
            worker_count=workers,
            watcher=watcher,
        )
        files = save_study(result, out)
    console = console_of_results()
    _show(console, result.document)
    console.print(f"Written under [bold]{escape(str(out))}[/bold]: {', '.join(files)}", highlight=False)


def _show(console: Console, document: StudyDocument) -> None:
    """The paper's tables beside ours, then its claims."""
    console.print(f"[bold]{escape(document.source)}[/bold]", highlight=False)
    for title, cells in (
        ("Segment lengths, mm (table 2): paper | here", document.segment_lengths_mm),
        ("Knee axes, deg (table 3): paper | here", document.knee_axis_deg),
        ("Kinematic error, mm (figure 5): paper | here", document.kinematic_error_mm),
        ("Marker shifts, mm: paper | here", document.marker_shift_mm),
    ):
        console.print(_table(title, cells))
    claims = Table(
        box=None, pad_edge=False, header_style="bold", title="Does it hold here?", title_justify="left"
    )
    for heading in ("", "where", "claim"):
        claims.add_column(heading)
    for claim in document.claims:
        claims.add_row(_WORDS[claim.holds], claim.where, escape(claim.claim))
    console.print(claims)
    held = sum(claim.holds is True for claim in document.claims)
    console.print(
        f"{held} of {len(document.claims)} claims hold; {document.wall_s:.0f} s for {len(document.subjects)} "
        "persons",
        highlight=False,
    )


_WORDS = {True: "[green]holds[/green]", False: "[red]not[/red]", None: "[yellow]undecided[/yellow]"}


def _table(title: str, cells: list[Beside]) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold", title=title, title_justify="left")
    methods = list(dict.fromkeys(cell.method for cell in cells))
    for heading in ("", *methods):
        table.add_column(heading, justify="left" if not heading else "right")
    for quantity in dict.fromkeys(cell.quantity for cell in cells):
        by_method = {cell.method: cell for cell in cells if cell.quantity == quantity}
        table.add_row(quantity, *(_cell(by_method[m]) if m in by_method else "" for m in methods))
    return table


def _cell(cell: Beside) -> str:
    theirs = "–" if cell.paper_mean is None else f"{cell.paper_mean:.1f}{cell.paper_stars}"
    return f"{theirs} | {cell.mean:.1f}{'*' if cell.significant else ''}"
