"""The commands of the service: serve, its API keys, what it keeps, its settings."""

from __future__ import annotations

import json
from contextlib import closing
from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

COMMANDS = ("serve",)

if TYPE_CHECKING:
    from scaling_service.service.jobs.service import Service

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

keys = typer.Typer(help="Make, list and revoke API keys of the service.", no_args_is_help=True)

data = typer.Typer(help="Delete what the service keeps, for good.", no_args_is_help=True)
settings = typer.Typer(help="Show the settings of the service.", no_args_is_help=True)

GROUPS = {"keys": keys, "data": data, "settings": settings}


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
    from scaling_service.service.jobs.settings import load_settings

    chosen: dict[str, Any] = {"host": host, "port": port, "data_directory": data}
    loaded = load_settings(settings, **{name: value for name, value in chosen.items() if value is not None})
    # By its name: commands and routes know nothing of each other, but one command runs the other side.
    import_module("scaling_service.service.http.serving").serve(loaded)


@keys.command("create")
def create_key(
    owner: Annotated[str, typer.Argument(help="Whose key it is; an owner sees their own things only.")],
    label: Annotated[str, typer.Option(help="What it is for.")] = "",
    settings: SettingsFile = None,
) -> None:
    """Make a key. It is shown once; the service keeps only its digest."""
    from scaling_service.service.store import keys as store

    with _open_service(settings) as service:
        row, secret = store.create(service.store.database, owner, label)
    typer.echo(f"Key {row.id} of {row.owner}; it is not shown again:", err=True)
    typer.echo(secret)


@keys.command("list")
def list_keys(settings: SettingsFile = None) -> None:
    """List all keys, without their secrets."""
    from scaling_service.service.store import keys as store

    with _open_service(settings) as service:
        rows = store.list_all(service.store.database)
    for row in rows:
        state = "valid" if row.revoked_us is None else f"revoked {_format_day(row.revoked_us)}"
        typer.echo(
            f"{row.id}  {row.owner}  made {_format_day(row.created_us)}  {state}  {row.label}".rstrip()
        )
    if not rows:
        typer.echo("There is no key.", err=True)


@keys.command("revoke")
def revoke_key(
    key: Annotated[str, typer.Argument(help="The key's id, as `keys list` shows it.")],
    settings: SettingsFile = None,
) -> None:
    """Let a key open nothing any more; what its owner has stays."""
    from scaling_service.service.store import keys as store

    with _open_service(settings) as service:
        store.revoke(service.store.database, key)
    typer.echo(f"Key {key} opens nothing any more.")


def _open_service(settings: SettingsFile) -> closing[Service]:
    from scaling_service.service.jobs.service import Service
    from scaling_service.service.jobs.settings import load_settings

    return closing(Service.open(load_settings(settings)))


def _format_day(microseconds: int) -> str:
    return datetime.fromtimestamp(microseconds / 1e6, UTC).date().isoformat()


@data.command()
def delete(
    owner: Annotated[str, typer.Argument(help="Whose subject it is.")],
    subject: Annotated[str, typer.Argument(help="The subject's id.")],
    settings: SettingsFile = None,
) -> None:
    """Delete a subject, its files, and all jobs on them: rows, contents and traces."""
    with _open_service(settings) as service:
        service.delete_subject(owner, subject)
        service.store.tidy()
    typer.echo(f"Subject {subject} of {owner} and all that rests on it is deleted.")


@data.command()
def expire(
    days: Annotated[float, typer.Option(min=0.0, help="Older than this.", show_default=False)],
    settings: SettingsFile = None,
) -> None:
    """Delete jobs and subjects that are older than so many days, now and once."""
    from scaling_service.service.store import deletion

    with _open_service(settings) as service:
        jobs, subjects = deletion.expire(service.store.database, service.store.blobs, days)
        service.store.tidy()
    typer.echo(f"Deleted for good: {jobs} jobs and {subjects} subjects older than {days:g} days.")


@settings.command()
def show(settings: SettingsFile = None) -> None:
    """Print all settings as they are resolved, without passwords; refuses what is unsafe."""
    from scaling_service.service.jobs.settings import load_settings, without_passwords

    typer.echo(json.dumps(without_passwords(load_settings(settings)), indent=1))
