"""All of it together: one database, one data directory."""

from __future__ import annotations

import os
import shutil
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile

from sqlalchemy import URL, Connection, text

from scaling_service.service.store import deletion, queueing
from scaling_service.service.store.blobs import Blobs, Incoming, collect_garbage
from scaling_service.service.store.database import Database, SqliteFile
from scaling_service.service.store.errors import disk_errors, report_full
from scaling_service.service.store.migrate import upgrade

SQLITE_NAME = "store.sqlite"


@dataclass(frozen=True, slots=True)
class Store:
    """Rows and files of a service."""

    database: Database
    blobs: Blobs

    @classmethod
    def open(cls, folder: Path, database_url: str | None = None) -> Store:
        """Open a data directory, made with its tables where needed; SQLite in it unless a URL is given."""
        blobs = Blobs(folder.absolute())
        here = blobs.folder / SQLITE_NAME
        if database_url is None:
            with disk_errors(blobs.folder):
                SqliteFile(here).make()
        database = Database(database_url or URL.create("sqlite", database=str(here)))
        try:
            upgrade(database, blobs.folder)
        except BaseException:
            database.close()
            raise
        return cls(database, blobs)

    def read(self) -> AbstractContextManager[Connection]:
        """A transaction that sees one moment."""
        return self.database.read()

    def write(self) -> AbstractContextManager[Connection]:
        """A transaction that is kept whole, or not at all."""
        return self.database.write()

    def incoming(self, limit: int) -> AbstractContextManager[Incoming]:
        """An upload of at most ``limit`` bytes."""
        return self.blobs.incoming(limit)

    def tidy(self) -> None:
        """Remove what nobody refers to: contents, dead uploads, folders of attempts that are over."""
        with disk_errors(self.blobs.folder):
            self.blobs.remove_dead_uploads()
            found = list(self.blobs.work.iterdir())
        alive = {f"{job}.{attempt}" for job, attempt in queueing.list_running_attempts(self.database)}
        for folder in found:  # listed before the jobs were asked for: a new one is among the living
            if folder.name not in alive:
                shutil.rmtree(folder, ignore_errors=True)
        collect_garbage(self.database, self.blobs)
        deletion.remove_traces(self.database)

    def check(self) -> None:
        """Raise StoreUnavailable where rows cannot be read now, or files not be written."""
        with self.read() as connection:
            connection.execute(text("SELECT 1"))
        with disk_errors(self.blobs.folder), TemporaryFile(dir=self.blobs.uploads) as probe:
            probe.write(b"probe")
            probe.flush()
            os.fsync(probe.fileno())

    def require_room(self, least: int) -> None:
        """Raise StoreFull where fewer bytes are free on the disk."""
        with disk_errors(self.blobs.folder):
            if shutil.disk_usage(self.blobs.folder).free < least:
                raise report_full(self.blobs.folder)

    def close(self) -> None:
        """Give all connections back."""
        self.database.close()
