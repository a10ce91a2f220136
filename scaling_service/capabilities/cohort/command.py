"""The command that scales a whole cohort."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scaling_service.capabilities.cohort.run import batch as run_batch
from scaling_service.capabilities.cohort.screen import Interrupted, show_cohort, watched
from scaling_service.capabilities.scaling.methods.table import METHODS
from scaling_service.capabilities.shared import options

EXIT_SOME_FAILED = 1
"""Every subject has ended, and at least one of them in failure."""

_Cohort = Annotated[
    Path,
    typer.Argument(
        metavar="COHORT",
        help="CSV file with a column `subject`, or folder of subject files.",
        show_default=False,
        readable=False,
    ),
]
_Workers = Annotated[
    int | None,
    typer.Option(min=1, metavar="N", help="Subjects at a time; unless given, one per processor core."),
]


def batch(
    cohort: _Cohort,
    out: options.Out,
    methods: Annotated[
        str | None,
        typer.Option(
            metavar="M,M,…", help=f"Of {', '.join(METHODS)}; all that each subject allows unless given."
        ),
    ] = None,
    workers: _Workers = None,
    force: Annotated[bool, typer.Option("--force", help="Do again what is done and unchanged.")] = False,
    strategy: options.StrategyOption = options.Strategy.JOINT,
    frames: options.Frames = options.DEFAULT_FRAMES,
    seed: options.Seed = 0,
    up: options.Up = None,
    forward: options.Forward = None,
    smooth_hz: options.SmoothHz = None,
) -> None:
    """Scale many subjects, and compare the methods over all of them.

    Writes under --out a folder for each subject, with what `compare` writes, and beside them cohort.json,
    lengths.csv, errors.csv and angles.csv. Run it again to go on: what is done and unchanged is kept.
    Exit code 1 says that some subjects failed.

    [bold]Examples[/bold]: scaling-service batch cohort.csv --out cohort

    scaling-service batch subjects/ --methods MB,MB_am --workers 2 --out cohort
    """
    chosen = None if methods is None else tuple(name.strip() for name in methods.split(","))
    settings = options.resolve(strategy, frames, seed, up, forward, smooth_hz)
    with watched() as watcher:
        try:
            result = run_batch(
                cohort, out, chosen, settings, worker_count=workers, force=force, watcher=watcher
            )
        except KeyboardInterrupt:
            raise Interrupted(watcher.ended, watcher.count, out) from None
    show_cohort(result.document, out, result.files)
    if any(subject.status == "failed" for subject in result.document.subjects):
        raise typer.Exit(EXIT_SOME_FAILED)
