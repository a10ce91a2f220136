"""The command that scales a whole cohort."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scaling_service.capabilities.shared import flags
from scaling_service.capabilities.shared.names import list_method_names
from scaling_service.capabilities.shared.settings import Settings

COMMANDS = ("batch",)

EXIT_SOME_FAILED = 1
"""Every subject has ended, and at least one of them in failure."""


class Interrupted(Exception):
    """A command was stopped from the keyboard; the text says what is kept."""


_Cohort = Annotated[
    Path,
    typer.Argument(
        metavar="COHORT",
        help="CSV file with a column `subject`, or folder of subject files.",
        show_default=False,
        readable=False,
    ),
]


@flags.with_flags
def batch(
    cohort: _Cohort,
    out: flags.Out,
    settings: Annotated[Settings, flags.Only("strategy", "n_frames", "seed", "up", "forward", "processing")],
    methods: Annotated[
        str | None,
        typer.Option(
            metavar="M,M,…",
            help=f"Of {', '.join(list_method_names())}; all that each subject allows unless given.",
        ),
    ] = None,
    tables: flags.Tables = "",
    workers: flags.Workers = None,
    force: Annotated[bool, typer.Option("--force", help="Do again what is done and unchanged.")] = False,
) -> None:
    """Scale many subjects, and compare the methods over all of them.

    Writes under --out a folder for each subject, with what `compare` writes, and beside them cohort.json,
    lengths.csv, errors.csv and angles.csv. Run it again to go on: what is done and unchanged is kept.
    Exit code 1 says that some subjects failed.

    [bold]Examples[/bold]: scaling-service batch cohort.csv --out cohort

    scaling-service batch subjects/ --methods MB,MB_am --workers 2 --out cohort
    """
    from scaling_service.capabilities.cohort.run import batch as run_batch
    from scaling_service.capabilities.cohort.screen import show_cohort, show_progress
    from scaling_service.capabilities.shared.tables import make_table_writer

    write_tables = make_table_writer(tables, out)
    chosen = None if methods is None else tuple(flags.read_names(methods))
    with show_progress() as watcher:
        try:
            result = run_batch(
                cohort, out, chosen, settings, worker_count=workers, force=force, watcher=watcher
            )
        except KeyboardInterrupt:
            raise Interrupted(
                f"interrupted; {watcher.ended} of {watcher.count} subjects had ended. What is done is kept "
                f"under {out}: run the same command to go on"
                if watcher.ended
                else "interrupted; no subject was done"
            ) from None
    write_tables(result.tables, result.document)
    show_cohort(result.document, out, result.files)
    if any(subject.status == "failed" for subject in result.document.subjects):
        raise typer.Exit(EXIT_SOME_FAILED)
