"""The command that serves over HTTP."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer

SettingsFile = Annotated[
    Path | None,
    typer.Option(
        "--settings",
        metavar="FILE",
        help="YAML file of settings; SCALING_SERVICE_* variables win over it.",
        show_default=False,
        readable=False,
    ),
]


def serve(
    settings: SettingsFile = None,
    host: Annotated[
        str | None,
        typer.Option(
            help="Address to listen on, 127.0.0.1 unless set; others need API keys.", show_default=False
        ),
    ] = None,
    port: Annotated[
        int | None, typer.Option(min=0, max=65535, help="Port, 8000 unless set.", show_default=False)
    ] = None,
    data: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Where everything is kept, ./scaling-service-data unless set."),
    ] = None,
) -> None:
    """Serve over HTTP, with a runner for jobs beside; the routes are shown at /docs.

    Ends on SIGTERM or Ctrl-C: jobs that run are queued again and go on at the next start.

    [bold]Examples[/bold]: scaling-service serve

    scaling-service keys create lab && scaling-service serve --host 0.0.0.0
    """
    from scaling_service.service.jobs.settings import (
        load_settings,  # the other commands need no database
    )

    chosen: dict[str, Any] = {"host": host, "port": port, "data_directory": data}
    loaded = load_settings(settings, **{name: value for name, value in chosen.items() if value is not None})
    # By its name: commands and routes know nothing of each other, but one command runs the other side.
    import_module("scaling_service.service.http.serving").serve(loaded)
