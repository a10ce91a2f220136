"""Commands on what the service keeps, and on its settings."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from scaling_service.cli.serve import SettingsFile

data = typer.Typer(help="Delete what the service keeps, for good.", no_args_is_help=True)
settings = typer.Typer(help="Show the settings of the service.", no_args_is_help=True)


@data.command()
def delete(
    owner: Annotated[str, typer.Argument(help="Whose subject it is.")],
    subject: Annotated[str, typer.Argument(help="The subject's id.")],
    settings: SettingsFile = None,
) -> None:
    """Delete a subject, its files, and all jobs on them: rows, contents and traces."""
    from scaling_service.service.jobs.service import Service
    from scaling_service.service.jobs.settings import load_settings

    service = Service.open(load_settings(settings))
    try:
        service.delete_subject(owner, subject)
        service.store.tidy()
    finally:
        service.close()
    typer.echo(f"Subject {subject} of {owner} and all that rests on it is deleted.")


@data.command()
def expire(
    days: Annotated[float, typer.Option(min=0.0, help="Older than this.", show_default=False)],
    settings: SettingsFile = None,
) -> None:
    """Delete jobs and subjects that are older than so many days, now and once."""
    from scaling_service.service.jobs.service import open_store
    from scaling_service.service.jobs.settings import load_settings
    from scaling_service.service.store import deletion

    store = open_store(load_settings(settings))
    try:
        jobs, subjects = deletion.expire(store.database, store.blobs, days)
        store.tidy()
    finally:
        store.close()
    typer.echo(f"Deleted for good: {jobs} jobs and {subjects} subjects older than {days:g} days.")


@settings.command()
def show(settings: SettingsFile = None) -> None:
    """Print all settings as they are resolved, without passwords; refuses what is unsafe."""
    from scaling_service.service.jobs.settings import load_settings, shown

    typer.echo(json.dumps(shown(load_settings(settings)), indent=1))
