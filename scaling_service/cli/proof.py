"""The command that looks at a folder's files before anything is computed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from scaling_service.cli import options
from scaling_service.cli.screen import progress_bar
from scaling_service.jobs.proof_saving import SUBJECT, prove_folder
from scaling_service.jobs.saving import check_folder
from scaling_service.jobs.settings import Settings
from scaling_service.schemas.proof import ProofDocument

_COLOURS = {"error": "red", "warning": "yellow"}


def proof(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="With recordings.", show_default=False)],
    out: options.Out,
    up: Annotated[str | None, typer.Option(help="Laboratory axis that points up, such as +z.")] = None,
    forward: Annotated[str | None, typer.Option(help="Laboratory axis that points forward.")] = None,
) -> None:
    """Look at the files of a folder: what they are for, axes, labels, gaps, and what scaling would refuse.

    Nothing is scaled. Writes proof.json, its tables, and subject.yaml, a proposal to correct and to scale by.

    [bold]Example[/bold]: scaling-service proof recordings --out looked
    """
    check_folder(out)
    with progress_bar() as progress:
        found = prove_folder(folder, out, Settings(up=up, forward=forward), progress=progress)
    _show(found)
    if found.proposal is not None:
        Console().print(f"Proposed: {escape(str(out / SUBJECT))}", soft_wrap=True)


def _show(found: ProofDocument) -> None:
    """Files and markers as tables, then axes and problems."""
    console = Console()
    files = Table("file", "is", "used as", "why", title="Files")
    for file in found.files:
        why = file.problem.problem if file.problem is not None else file.why
        files.add_row(*(escape(text) for text in (file.name, file.kind, file.role or "–", why)))
    markers = Table("marker", "label", "confidence", "why", title=f"Markers of {escape(found.model)}")
    for marker in found.markers:
        shown = (marker.marker, marker.label or "–", f"{marker.confidence:.2f}", marker.why)
        markers.add_row(*(escape(text) for text in shown))
    console.print(files, markers)
    for text in () if found.axes is None else found.axes.why:
        console.print(escape(text))
    of_files = [file.problem for file in found.files if file.problem is not None]
    of_recordings = [p for recording in found.recordings for p in recording.problems]
    for problem in (*of_files, *of_recordings, *found.problems):
        where = ", ".join(part for part in (problem.file, problem.field) if part)
        said = f"{where}: {problem.problem}" if where else problem.problem
        colour = _COLOURS[problem.severity]
        console.print(
            f"[{colour}]{problem.severity}[/{colour}] {escape(said)}. {escape(problem.remedy or '')}"
        )
