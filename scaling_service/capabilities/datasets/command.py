"""The commands that list and download public recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from scaling_service.capabilities.datasets import catalogue
from scaling_service.capabilities.shared import screen
from scaling_service.capabilities.shared.flags import make_folder_parser
from scaling_service.report import tables

app = typer.Typer(no_args_is_help=True, rich_markup_mode="rich")

_MB = 1e6

_DatasetName = Annotated[str, typer.Argument(metavar="NAME", help="As in the list.", show_default=False)]
_Folder = Annotated[
    Path | None,
    typer.Option(
        "--out",
        "-o",
        metavar="DIR",
        help="Where to write; ./NAME unless given.",
        show_default=False,
        parser=make_folder_parser("--out"),
    ),
]
_Cache = Annotated[
    Path | None,
    typer.Option(
        "--cache",
        metavar="DIR",
        envvar="SCALING_SERVICE_CACHE",
        help="Keeps downloads between runs; a folder of the system unless given.",
        show_default=False,
        parser=make_folder_parser("--cache"),
    ),
]
_BaseUrl = Annotated[
    str,
    typer.Option(
        metavar="URL",
        envvar="SCALING_SERVICE_DATASETS_URL",
        help="Server of the raw files, or a mirror of it with the same paths. HTTPS_PROXY names a proxy.",
    ),
]

GROUPS = {"datasets": app}


@app.callback()
def datasets() -> None:
    """Public recordings to try everything on: list them, download one, and run the command that is printed.

    Nothing of them comes with the program. Each file is taken from its public repository at one fixed
    commit and checked against its SHA-256; the licence stands in SOURCE.md beside it.
    """


@app.command("list")
def list_datasets() -> None:
    """Show what can be downloaded, how large it is, on what terms, and what it can be used for.

    Size is that of the download. A licence marked NON-COMMERCIAL excludes commercial use.

    [bold]Next[/bold]: scaling-service datasets get jia_mri
    """
    from scaling_service.capabilities.datasets.catalogue import read_catalogue
    from scaling_service.capabilities.datasets.run import describe_terms

    console = screen.make_console()
    rows = [
        tables.Row(
            name, [dataset.title, f"{dataset.total_bytes / _MB:.1f}", describe_terms(dataset), dataset.use]
        )
        for name, dataset in read_catalogue().items()
    ]
    screen.print_table(
        console,
        tables.Table(
            caption="", columns=["name", "what", "MB", "licence", "used for"], rows=rows, words=True
        ),
    )
    console.print("Download one: [cyan]scaling-service datasets get NAME[/cyan]", highlight=False)


@app.command("get")
def get(
    name: _DatasetName, out: _Folder = None, cache: _Cache = None, base_url: _BaseUrl = catalogue.BASE_URL
) -> None:
    """Download a dataset, check it, and write it with a subject file and a note of source and licence.

    What is there already with the right content is not fetched again, so a download that broke off goes on
    where it stopped. A file in the folder that differs is never replaced. All is written, or nothing.

    [bold]Example[/bold]: scaling-service datasets get jia_mri --out data/jia_mri
    """
    from scaling_service.capabilities.datasets.catalogue import find_dataset, read_catalogue
    from scaling_service.capabilities.datasets.downloads import find_default_cache
    from scaling_service.capabilities.datasets.run import get_dataset

    dataset = find_dataset(name, read_catalogue())
    folder = Path(name) if out is None else out
    with screen.progress_bar() as progress:
        obtained = get_dataset(
            name,
            dataset,
            folder,
            cache=find_default_cache() if cache is None else cache,
            base_url=base_url,
            progress=progress,
        )
    # What was written and what was there, the terms, and what to run now.
    from scaling_service.capabilities.datasets.run import describe_terms, list_next_commands

    console = screen.make_console()
    for what, files in (("Written under", obtained.written), ("Already there, unchanged, in", obtained.kept)):
        if files:
            console.print(f"{what} [bold]{escape(str(obtained.folder))}[/bold]:", highlight=False)
            console.print(f"  {escape(', '.join(files))}", highlight=False, soft_wrap=True)
    console.print(
        f"Licence: {escape(describe_terms(dataset))}; read {catalogue.SOURCE_FILE}",
        highlight=False,
        soft_wrap=True,
    )
    console.print("Now run:", highlight=False)
    for command in list_next_commands(dataset, obtained.folder):
        console.print(f"  {escape(command)}", highlight=False, soft_wrap=True, style="cyan")
