"""The command that shows the program on a built-in person: comparison of methods, or search."""

from __future__ import annotations

from typing import Annotated

import typer

from scaling_service.capabilities.discovery.command import find_hidden
from scaling_service.capabilities.scaling.command import show
from scaling_service.capabilities.shared.flags import Only, Out, Report, with_flags
from scaling_service.capabilities.shared.screen import running
from scaling_service.capabilities.shared.settings import Settings


@with_flags
def demo(
    out: Out,
    settings: Annotated[Settings, Only("strategy", "n_frames", "seed")],
    report: Report = True,
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
        from scaling_service.capabilities.scaling.demo import run_demo
        from scaling_service.capabilities.scaling.saving import save

        results, truth = run_demo(settings, progress=progress)
        document = save(results, out, truth=truth, report=report, progress=progress)
    show(document, out)


COMMANDS = (demo,)
