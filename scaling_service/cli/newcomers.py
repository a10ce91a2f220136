"""The commands for newcomers: a demonstration, recordings to try every command on, the guide."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scaling_service.capabilities.discovery.command import find_hidden
from scaling_service.capabilities.scaling.command import show
from scaling_service.capabilities.shared import flags
from scaling_service.capabilities.shared.screen import running
from scaling_service.capabilities.shared.settings import Settings

COMMANDS = ("demo", "example", "guide")


@flags.with_flags
def demo(
    out: flags.Out,
    settings: Annotated[Settings, flags.Only("strategy", "n_frames", "seed")],
    report: flags.Report = True,
    discover: Annotated[
        bool,
        typer.Option(
            "--discover",
            help="Instead, hide something in the person's recordings, and search for it as `discover` does.",
        ),
    ] = False,
) -> None:
    """Compare all methods on a built-in virtual person, whose true body is known.

    [bold]Examples[/bold]: scaling-service demo --out demo

    scaling-service demo --discover --out hidden
    """
    if discover:
        find_hidden(out, settings.seed, report=report)
        return
    with running(out) as progress:
        from scaling_service.capabilities.scaling.run import run_demo
        from scaling_service.capabilities.scaling.saving import save

        results, truth = run_demo(settings, progress=progress)
        document = save(results, out, truth=truth, report=report, progress=progress)
    show(document, out)


def example(
    out: flags.Out,
    persons: Annotated[
        int, typer.Option(min=1, metavar="N", help="More than one get a folder each, and no bones.")
    ] = 1,
    strides: Annotated[
        float, typer.Option(min=2.5, max=10_000.0, metavar="N", help="Of each of a person's two walks.")
    ] = 2.5,
    plates: Annotated[
        bool, typer.Option("--plates", help="Instead, one person who stands on two force plates.")
    ] = False,
) -> None:
    """Write a virtual person's recordings and subject file, to try every command on.

    Standing, hip and knee movements and walking (TRC), bones (STL). In the recordings two things are hidden
    that `discover` can find.

    [bold]Examples[/bold]: scaling-service example --out lab

    scaling-service example --persons 3 --out cohort

    scaling-service example --persons 27 --strides 390 --out large

    scaling-service example --plates --out plates
    """
    with running(out) as progress:
        from scaling_service.capabilities.shared.screen import make_console
        from scaling_service.virtual.example import write_example
        from scaling_service.virtual.plates import write_plates_example

        folders = [out / f"person_{k + 1}" for k in range(persons)] if persons > 1 and not plates else [out]
        for k, folder in enumerate(folders):
            progress("recording a virtual person", k / len(folders))
            folder.mkdir(parents=True, exist_ok=True)
            if plates:
                write_plates_example(folder)
            else:
                alone = persons == 1
                name = "example" if alone else folder.name
                write_example(folder, name, seed=k, imaged=alone, strides=strides)
    for folder in folders:
        make_console().print(f"Written: {folder / 'subject.json'}", highlight=False, soft_wrap=True)


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
            parser=flags.make_folder_parser("--out"),
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
