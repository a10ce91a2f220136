"""The program: its commands, and what becomes of errors."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import Annotated

import typer

from scaling_service.capabilities.cohort.command import batch
from scaling_service.capabilities.cohort.progress import Interrupted
from scaling_service.capabilities.consistent.command import consistent
from scaling_service.capabilities.datasets.command import app as datasets
from scaling_service.capabilities.discovery.command import discover
from scaling_service.capabilities.dynamics.command import dynamics
from scaling_service.capabilities.intake.command import proof
from scaling_service.capabilities.landmarks.command import landmarks
from scaling_service.capabilities.motion.command import ik
from scaling_service.capabilities.scaling.command import compare, demo, scale
from scaling_service.cli.keys import app as keys
from scaling_service.cli.serve import serve
from scaling_service.cli.service_data import data, settings
from scaling_service.core.errors import InputError
from scaling_service.documents.writing import code_version
from scaling_service.studies.command import reproduce

EXIT_INPUT = 2
"""What was given cannot be used: arguments, a subject file or anything that it names."""

EXIT_INTERRUPTED = 130
"""Stopped from the keyboard, as shells count it."""

app = typer.Typer(
    name="scaling-service",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)
for _command in (
    demo, proof, scale, compare, ik, dynamics, consistent, discover, batch, landmarks, reproduce, serve,
):  # fmt: skip
    app.command()(_command)
for _name, _group in (("datasets", datasets), ("keys", keys), ("data", data), ("settings", settings)):
    app.add_typer(_group, name=_name)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"scaling-service {code_version()}")
        raise typer.Exit


@app.callback()
def _program(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version."),
    ] = False,
) -> None:
    """Scale a generic body model to a person from motion-capture recordings, and see how far to trust it.

    A [bold]subject file[/bold] (YAML or JSON) names the model and the recordings. Start with
    [cyan]scaling-service demo --out demo[/cyan], which needs none.
    """


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command.

    Parameters
    ----------
    arguments : sequence of str, optional
        Those of the process unless given.

    Returns
    -------
    int
        0, or 1 if some subjects of a batch failed, or 2 if something that was given cannot be used, or 130
        if interrupted. Anything else that goes wrong is a defect of the program and leaves as an exception.
    """
    try:
        with _terminable():
            result = app(list(sys.argv[1:] if arguments is None else arguments), standalone_mode=False)
    except InputError as error:
        return _complain(str(error))
    except Interrupted as stop:
        _complain(str(stop))
        return EXIT_INTERRUPTED
    except typer.TyperException as error:
        said = error.format_message().rstrip(".")
        return _complain(f"{said}. See --help.") if said else EXIT_INPUT
    except (KeyboardInterrupt, typer.Abort):
        result = EXIT_INTERRUPTED
    if result == EXIT_INTERRUPTED:
        _complain("interrupted; nothing was written")
    return result if isinstance(result, int) else 0


@contextmanager
def _terminable() -> Iterator[None]:
    """Let a request to terminate (a queue's, a container's) end as an interruption does: tidily."""
    if threading.current_thread() is not threading.main_thread():
        yield  # only there can signals be handled
        return

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _complain(message: str) -> int:
    sys.stderr.write(f"scaling-service: {message}\n")
    return EXIT_INPUT
