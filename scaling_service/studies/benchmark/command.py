"""The command that holds our program and others against what is known to be true."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from scaling_service.capabilities.cohort.command import Interrupted
from scaling_service.capabilities.shared import flags, screen

_Data = Annotated[
    Path,
    typer.Option(
        "--data",
        metavar="DIR",
        envvar="SCALING_SERVICE_DATA",
        help="Folder of public recordings, each in a folder called as `datasets list` has it.",
        parser=flags.make_folder_parser("--data"),
        show_default=False,
    ),
]
_Tasks = Annotated[
    str,
    typer.Option(
        metavar="TASK,…",
        help="Only these; all whose data are there unless given.",
        show_default=False,
    ),
]
_Entries = Annotated[
    list[Path] | None,
    typer.Option(
        "--entry",
        metavar="DIR",
        help="Another program's answers (TASK/CASE/files); may be repeated.",
        show_default=False,
    ),
]
_Seed = Annotated[int, typer.Option(min=0, metavar="N", help="Of the virtual persons.")]
_Keep = Annotated[
    bool,
    typer.Option(help="Judge what was answered before under --out, and compute only what is absent there."),
]
_Workers = Annotated[
    int | None,
    typer.Option(min=1, metavar="N", help="Cases at a time; unless given, one per processor core."),
]


def benchmark(
    out: flags.Out,
    data: _Data = Path("data"),
    tasks: _Tasks = "",
    entry: _Entries = None,
    seed: _Seed = 0,
    keep_answers: _Keep = False,
    tables: flags.Tables = "",
    workers: _Workers = None,
) -> None:
    """Ask what is known to be true, of this program, of OpenSim's tools, and of any other program.

    Writes cases/TASK/CASE (what is asked: recordings, models, bones), entries/PROGRAM/TASK/CASE (what was
    answered) and benchmark.json. To have another program judged, answer the cases into a folder of its own
    and name it by --entry; the guide's page on the benchmark says which files.

    [bold]Example[/bold]: scaling-service benchmark --data data --tasks persons,living_bone --out judged
    """
    from scaling_service.capabilities.shared.tables import make_table_writer
    from scaling_service.core.threads import count_cores
    from scaling_service.studies.benchmark.result import DOCUMENT, make_tables, tabulate_figures
    from scaling_service.studies.benchmark.run import run_benchmark

    write_tables = make_table_writer(tables, out)
    with screen.running(out) as report:
        try:
            document = run_benchmark(
                data,
                out,
                tasks=[name for name in tasks.split(",") if name],
                entries=entry or (),
                seed=seed,
                keep_answers=keep_answers,
                workers=workers or count_cores(),
                report=report,
            )
        except KeyboardInterrupt:
            raise Interrupted(
                f"interrupted; what is answered is kept under {out}: go on with --keep-answers"
            ) from None
    write_tables(tabulate_figures(document), document)
    console = screen.make_console()
    for table in make_tables(document):
        screen.print_table(console, table)
    for name, lack in document.left_out.items():
        console.print(f"[yellow]left out[/yellow]  {name}: {escape(lack)}", highlight=False, soft_wrap=True)
    console.print(f"{document.wall_s:.0f} s", highlight=False)
    screen.list_files(console, out, [DOCUMENT, "cases/", "entries/"])
