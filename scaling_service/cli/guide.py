"""The command that shows the guide."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scaling_service.capabilities.shared.flags import make_folder_parser


def guide(
    page: Annotated[
        str | None, typer.Argument(help="Page to read; a list of all unless given.", show_default=False)
    ] = None,
    search: Annotated[
        str | None, typer.Option(metavar="WORDS", help="Find the sections that have these words.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="DIR",
            help="Write it as web pages: open index.html.",
            parser=make_folder_parser("--out"),
        ),
    ] = None,
) -> None:
    """Read the guide: here, in a browser, or at /guide of the service.

    [bold]Examples[/bold]: scaling-service guide first-steps

    scaling-service guide --search "soft tissue"

    scaling-service guide --out guide
    """
    from rich.console import Console
    from rich.markdown import Markdown

    from scaling_service.guide import pages
    from scaling_service.guide.site import write_site

    console = Console()
    if out is not None:
        write_site(out)
        console.print(f"Open {out / 'index.html'}", highlight=False, soft_wrap=True)
    elif search is not None:
        for section in pages.search(search):
            console.print(f"[bold]{section.page}[/bold]  {section.title}", highlight=False, soft_wrap=True)
    elif page is not None:
        console.print(Markdown(pages.read_page(page)))
    else:
        for part, inside in pages.PARTS.items():
            console.print(f"[bold]{part}[/bold]", highlight=False)
            for name in inside:
                console.print(f"  {name:<16}{pages.read_title(name)}", highlight=False, soft_wrap=True)


COMMANDS = (guide,)
