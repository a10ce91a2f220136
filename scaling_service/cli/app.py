"""The program: the commands that capabilities offer, and what becomes of errors."""

from __future__ import annotations

import signal
import sys
import threading
from collections import abc
from contextlib import contextmanager
from types import FrameType
from typing import Annotated

import typer

from scaling_service.capabilities import import_modules_named
from scaling_service.capabilities.cohort.command import Interrupted
from scaling_service.cli import newcomers, service
from scaling_service.core.errors import InputError
from scaling_service.core.text import name_version
from scaling_service.studies import command as studies

EXIT_INPUT = 2
"""What was given cannot be used: arguments, a subject file or anything that it names."""

EXIT_INTERRUPTED = 130
"""Stopped from the keyboard, as shells count it."""

_FIRST = [
    "demo",
    "example",
    "guide",
    "proof",
    "scale",
    "compare",
    "ik",
    "dynamics",
    "consistent",
    "discover",
    "batch",
    "landmarks",
]
"""In the order in which a newcomer needs them; others follow."""


def _build_program() -> typer.Typer:
    program = typer.Typer(
        name="scaling-service",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode="rich",
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    modules = [*import_modules_named("command"), newcomers, studies, service]
    commands = [
        getattr(module, command) if isinstance(command, str) else command
        for module in modules
        for command in getattr(module, "COMMANDS", ())
    ]
    names = (*_FIRST, *(command.__name__ for command in commands))
    for command in sorted(commands, key=lambda command: names.index(command.__name__)):
        program.command()(command)
    for module in modules:
        for name, group in getattr(module, "GROUPS", {}).items():
            program.add_typer(group, name=name)
    return program


app = _build_program()


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(name_version())
        raise typer.Exit


@app.callback()
def _program(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Scale a generic body model to a person from motion-capture recordings, and see how far to trust it.

    A [bold]subject file[/bold] (YAML or JSON) names the model and the recordings. Start with
    [cyan]scaling-service demo --out demo[/cyan], which needs none.
    """


def run(arguments: abc.Sequence[str]) -> int:
    """Run one command; see ``main``."""
    try:
        with _terminable():
            result = app(list(arguments), standalone_mode=False)
    except InputError as error:
        return _complain(str(error))
    except Interrupted as stop:
        _complain(str(stop))
        return EXIT_INTERRUPTED
    except typer.TyperException as error:
        said = error.format_message().replace("Value error, ", "").rstrip(".")
        return _complain(f"{said}. See --help.") if said else EXIT_INPUT
    except (KeyboardInterrupt, typer.Abort):
        result = EXIT_INTERRUPTED
    if result == EXIT_INTERRUPTED:
        _complain("interrupted; nothing was written")
    return result if isinstance(result, int) else 0


@contextmanager
def _terminable() -> abc.Iterator[None]:
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
