"""All of it together: one database with its tables up to date, one data directory."""

from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile

import sqlalchemy as sa
from alembic import command
from alembic.config import Config
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from alembic.util import CommandError

from scaling_service.service.store import blobs as store_blobs
from scaling_service.service.store import database as db
from scaling_service.service.store import deletion, errors, jobs
from scaling_service.service.store.room import Spare
from scaling_service.service.store.tables import metadata

LOCK_NUMBER = 0x5CA1_1A6
"""Chosen: any number that other programs on the same PostgreSQL do not use for an advisory lock."""

SQLITE_NAME = "store.sqlite"


def upgrade(database: db.Database, folder: Path) -> None:
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
            try:
                ScriptDirectory.from_config(config).get_revision(there)
            except CommandError:
                raise errors.StoreTooNew(
                    f"the tables are of a later version of the program ({there})",
                    field="database_url",
                    remedy="Install that version, or give another data directory or database",
                ) from None
            command.upgrade(config, "head")


def configure(connection: sa.Connection) -> Config:
    """What Alembic's commands take, to work over a connection."""
    config = Config()
    config.set_main_option("script_location", str(Path(__file__).with_name("migrations")))
    config.attributes["connection"] = connection
    return config


@contextlib.contextmanager
def _alone(database: db.Database, folder: Path) -> Iterator[None]:
    if not database.is_sqlite:
        with database.session_lock(LOCK_NUMBER):
            yield
        return
    with errors.disk_errors(folder), (folder / "migrate.lock").open("a") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


@dataclass(frozen=True, slots=True)
class Store:
    """Rows and files of a service."""

    database: db.Database
    blobs: store_blobs.Blobs

    @classmethod
    def open(cls, folder: Path, database_url: str | None = None) -> Store:
        """Open a data directory, made with its tables where needed; SQLite in it unless a URL is given."""
        blobs = store_blobs.Blobs(folder.absolute())
        here = blobs.folder / SQLITE_NAME
        if database_url is None:
            with errors.disk_errors(blobs.folder):
                db.SqliteFile(here).make()
        database = db.Database(database_url or sa.URL.create("sqlite", database=str(here)))
        try:
            upgrade(database, blobs.folder)
        except BaseException:
            database.close()
            raise
        store = cls(database, blobs)
        store.spare.keep()
        return store

    @property
    def spare(self) -> Spare:
        """What is kept back so that deleting works on a full disk."""
        return Spare(self.blobs.folder)

    def read(self) -> contextlib.AbstractContextManager[sa.Connection]:
        """A transaction that sees one moment."""
        return self.database.read()

    def write(self) -> contextlib.AbstractContextManager[sa.Connection]:
        """A transaction that is kept whole, or not at all."""
        return self.database.write()

    def incoming(self, limit: int) -> contextlib.AbstractContextManager[store_blobs.Incoming]:
        """An upload of at most ``limit`` bytes."""
        return self.blobs.incoming(limit)

    def tidy(self) -> None:
        """Remove what nobody refers to: contents, dead uploads, folders of attempts that are over."""
        with errors.disk_errors(self.blobs.folder):
            self.blobs.remove_dead_uploads()
            found = list(self.blobs.work.iterdir())
        alive = {f"{job}.{attempt}" for job, attempt in jobs.list_running_attempts(self.database)}
        for folder in found:  # listed before the jobs were asked for: a new one is among the living
            if folder.name not in alive:
                shutil.rmtree(folder, ignore_errors=True)
        store_blobs.collect_garbage(self.database, self.blobs)
        self.spare.keep()
        deletion.remove_traces(self.database)

    def check(self) -> None:
        """Raise StoreUnavailable where rows cannot be read now, or files not be written."""
        with self.read() as connection:
            connection.execute(sa.text("SELECT 1"))
        with errors.disk_errors(self.blobs.folder), TemporaryFile(dir=self.blobs.uploads) as probe:
            probe.write(b"probe")
            probe.flush()
            os.fsync(probe.fileno())

    def require_room(self, least: int) -> None:
        """Raise StoreFull where fewer bytes are free on the disk."""
        with errors.disk_errors(self.blobs.folder):
            if shutil.disk_usage(self.blobs.folder).free < least:
                raise errors.report_full(self.blobs.folder)

    def close(self) -> None:
        """Give all connections back."""
        self.database.close()
