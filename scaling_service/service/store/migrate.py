"""Bringing the tables up to date: at start, by one program at a time, or as SQL for an administrator."""

from __future__ import annotations

import fcntl
import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from alembic import command
from alembic.config import Config
from alembic.script import ScriptDirectory
from alembic.util import CommandError
from sqlalchemy import Connection, inspect, text

from scaling_service.service.store.database import Database
from scaling_service.service.store.errors import StoreTooNew, disk_errors

LOCK_NUMBER = 0x5CA1_1A6
"""Chosen: any number that other programs on the same PostgreSQL do not use for an advisory lock."""

_VERSION_TABLE = "alembic_version"


def upgrade(database: Database, folder: Path) -> None:
    """Make or change the tables as this version of the program needs them; a failure changes nothing.

    Programs that start at the same moment wait for the first; on SQLite by a lock file in the folder.
    StoreTooNew is raised where a later version of the program has been here.
    """
    with _alone(database, folder), database.write() as connection:
        _refuse_later(connection)
        config = _config()
        config.attributes["connection"] = connection
        command.upgrade(config, "head")


def script(database_url: str) -> str:
    """The SQL that makes all tables from nothing, for an administrator who runs it himself."""
    out = io.StringIO()
    config = _config(out)
    config.set_main_option("sqlalchemy.url", database_url.replace("%", "%%"))
    command.upgrade(config, "head", sql=True)
    return out.getvalue()


def _config(out: io.StringIO | None = None) -> Config:
    config = Config() if out is None else Config(output_buffer=out)
    config.set_main_option("script_location", str(Path(__file__).with_name("migrations")))
    return config


def _refuse_later(connection: Connection) -> None:
    if not inspect(connection).has_table(_VERSION_TABLE):
        return
    there = str(connection.scalar(text(f"SELECT version_num FROM {_VERSION_TABLE}")))
    try:
        ScriptDirectory.from_config(_config()).get_revision(there)
    except CommandError:
        raise StoreTooNew(
            f"the tables are of a later version of the program ({there})",
            field="database_url",
            remedy="Install that version, or give another data directory or database",
        ) from None


@contextmanager
def _alone(database: Database, folder: Path) -> Iterator[None]:
    if not database.is_sqlite:
        with database.session_lock(LOCK_NUMBER):
            yield
        return
    with disk_errors(folder), (folder / "migrate.lock").open("a") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield
