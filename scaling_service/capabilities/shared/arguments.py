"""Arguments that several commands share."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from scaling_service.core.errors import InputError

# Whether a path can be read is asked where it is read, with file and remedy in the answer.
SubjectFile = Annotated[
    Path,
    typer.Argument(metavar="SUBJECT", help="Subject file, YAML or JSON.", show_default=False, readable=False),
]


def folder(option: str) -> Callable[[str], Path]:
    """The parser of an option that names a folder; an empty text, as of an unset shell variable, is none."""

    def parse(text: str) -> Path:
        if not text.strip():
            raise InputError("no folder is given", field=option, remedy="Name a folder")
        return Path(text)

    return parse


Out = Annotated[
    Path,
    typer.Option(
        "--out",
        "-o",
        metavar="DIR",
        help="Folder for the results.",
        show_default=False,
        parser=folder("--out"),
    ),
]
Report = Annotated[bool, typer.Option("--report/--no-report", help="Whether to write report.html.")]
Workers = Annotated[
    int | None,
    typer.Option(min=1, metavar="N", help="Subjects at a time; unless given, one per processor core."),
]
