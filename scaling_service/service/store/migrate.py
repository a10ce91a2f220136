"""Bringing the tables up to date: at start, by one program at a time."""

from __future__ import annotations

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from alembic import command
from alembic.config import Config
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from alembic.util import CommandError
from sqlalchemy import Connection

from scaling_service.service.store.database import Database
from scaling_service.service.store.errors import StoreTooNew, disk_errors
from scaling_service.service.store.tables import metadata

LOCK_NUMBER = 0x5CA1_1A6
"""Chosen: any number that other programs on the same PostgreSQL do not use for an advisory lock."""


def upgrade(database: Database, folder: Path) -> None:
    """Make or change the tables as this version of the program needs them; a failure changes nothing.

    Programs that start at the same moment wait for the first; on SQLite by a lock file in the folder.
    StoreTooNew is raised where a later version of the program has been here.
    """
    with _alone(database, folder), database.write() as connection:
        config = configure(connection)
        there = MigrationContext.configure(connection).get_current_revision()
        if there is None:
            metadata.create_all(connection)
            command.stamp(config, "head")
        else:
            _refuse_later(config, there)
            command.upgrade(config, "head")


def configure(connection: Connection) -> Config:
    """What Alembic's commands take, to work over a connection."""
    config = Config()
    config.set_main_option("script_location", str(Path(__file__).with_name("migrations")))
    config.attributes["connection"] = connection
    return config


def _refuse_later(config: Config, there: str) -> None:
    try:
        ScriptDirectory.from_config(config).get_revision(there)
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
