"""Commands on API keys: who may use the service."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Annotated

import typer

from scaling_service.cli.serve import SettingsFile

if TYPE_CHECKING:
    from scaling_service.service.store.database import Database

app = typer.Typer(help="Make, list and revoke API keys of the service.", no_args_is_help=True)


@app.command()
def create(
    owner: Annotated[str, typer.Argument(help="Whose key it is; an owner sees their own things only.")],
    label: Annotated[str, typer.Option(help="What it is for.")] = "",
    settings: SettingsFile = None,
) -> None:
    """Make a key. It is shown once; the service keeps only its digest."""
    from scaling_service.service.store import keys

    with _database(settings) as database:
        row, secret = keys.create(database, owner, label)
    typer.echo(f"Key {row.id} of {row.owner}; it is not shown again:", err=True)
    typer.echo(secret)


@app.command("list")
def list_keys(settings: SettingsFile = None) -> None:
    """List all keys, without their secrets."""
    from scaling_service.service.store import keys

    with _database(settings) as database:
        rows = keys.every(database)
    for row in rows:
        state = "valid" if row.revoked_us is None else f"revoked {_day(row.revoked_us)}"
        typer.echo(f"{row.id}  {row.owner}  made {_day(row.created_us)}  {state}  {row.label}".rstrip())
    if not rows:
        typer.echo("There is no key.", err=True)


@app.command()
def revoke(
    key: Annotated[str, typer.Argument(help="The key's id, as `keys list` shows it.")],
    settings: SettingsFile = None,
) -> None:
    """Let a key open nothing any more; what its owner has stays."""
    from scaling_service.service.store import keys

    with _database(settings) as database:
        keys.revoke(database, key)
    typer.echo(f"Key {key} opens nothing any more.")


@contextmanager
def _database(settings: SettingsFile) -> Iterator[Database]:
    from scaling_service.service.jobs.service import open_store
    from scaling_service.service.jobs.settings import load_settings

    store = open_store(load_settings(settings))
    try:
        yield store.database
    finally:
        store.close()


def _day(microseconds: int) -> str:
    return datetime.fromtimestamp(microseconds / 1e6, UTC).date().isoformat()
