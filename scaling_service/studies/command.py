"""The command that does a paper's study again."""

from __future__ import annotations

from collections import abc
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from rich.console import Console
from rich.markup import escape

from scaling_service.capabilities.shared import flags, screen
from scaling_service.capabilities.shared import settings as shared_settings
from scaling_service.studies.benchmark.command import benchmark as benchmark

COMMANDS = ("reproduce", "benchmark")

if TYPE_CHECKING:
    from scaling_service.report.tables import Table
    from scaling_service.studies.claims import StudyDocument

IN_TURN = shared_settings.Settings(calibration=shared_settings.CalibrationSettings(strategy="alternating"))
"""As the paper has it."""


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
    Literal["mean", "custom"],
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

_STYLES = {True: "green", False: "red", None: "yellow"}


@flags.with_flags
def reproduce(
    study: Annotated[
        Literal["puchaud2019", "muller2017", "futamure"],
        typer.Argument(help="Which study.", show_default=False),
    ],
    out: flags.Out,
    subjects: _Subjects = None,
    samples: _Samples = 1000,
    recording: _Recordings = None,
    generic: _Generic = "mean",
    workers: _Workers = None,
    settings: Annotated[shared_settings.Settings, flags.Only("strategy", "n_frames", "seed")] = IN_TURN,
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
    from scaling_service.documents.writing import check_folder
    from scaling_service.studies.claims import save_study

    check_folder(out)
    document: StudyDocument
    tables: abc.Iterable[Table]
    if study == "puchaud2019":
        from scaling_service.capabilities.cohort.screen import show_progress
        from scaling_service.studies.puchaud2019 import result as puchaud2019
        from scaling_service.studies.puchaud2019.run import reproduce_puchaud2019

        with show_progress() as watcher:
            document = reproduce_puchaud2019(
                settings, subjects=subjects, generic=generic, worker_count=workers, watcher=watcher
            )
        summary, tables = puchaud2019.summarise(document), puchaud2019.make_tables(document)
    elif study == "muller2017":
        from scaling_service.studies.muller2017 import words as muller2017
        from scaling_service.studies.muller2017.monte_carlo import UncertaintySettings
        from scaling_service.studies.muller2017.study import reproduce_muller2017

        document = reproduce_muller2017(
            UncertaintySettings(samples=samples, seed=settings.seed),
            subjects=subjects,
            recordings=recording or (),
            worker_count=workers,
            finished=_show_person,
        )
        summary, tables = muller2017.summarise(document), muller2017.make_tables(document)
    else:
        from scaling_service.studies.futamure import words as futamure
        from scaling_service.studies.futamure.study import reproduce_futamure

        document = reproduce_futamure(
            seed=settings.seed,
            subjects=subjects,
            recordings=recording or (),
            worker_count=workers,
            finished=_show_person,
        )
        summary, tables = futamure.summarise(document), futamure.make_tables(document)
    files = save_study(document, summary, out)
    _show_study(document, tables, out, files)


def _show_person(name: str, done: int, count: int) -> None:
    """Says who is done, and how many of all are."""
    Console(stderr=True).print(f"{done} of {count}  {name}", markup=False, highlight=False)


def _show_study(
    document: StudyDocument, tables: abc.Iterable[Table], out: Path, files: abc.Sequence[str]
) -> None:
    """The tables, every claim, and what was written."""
    from scaling_service.studies.claims import HOLDS, count_held

    console = screen.make_console()
    console.print(f"[bold]{escape(document.source)}[/bold]", highlight=False)
    for table in tables:
        screen.print_table(console, table)
    for claim in document.claims:
        said = f"{claim.where}: {claim.claim}. In the paper: {claim.paper}. Here: {claim.ours}"
        screen.say(console, HOLDS[claim.holds][0], _STYLES[claim.holds], [said])
    taken = f"{document.wall_s:.0f} s for {document.size} persons"
    console.print(f"{count_held(document)} claims hold; {taken}", highlight=False)
    screen.list_files(console, out, [", ".join(files)])
