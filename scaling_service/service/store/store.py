"""All of it together: one database, one data directory."""

from __future__ import annotations

import shutil
import time
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

from sqlalchemy import URL, Connection, text

from scaling_service.service.store import deletion, queueing, references
from scaling_service.service.store.blobs import Blobs, Incoming, sync_folder
from scaling_service.service.store.database import Database
from scaling_service.service.store.errors import disk_errors, full
from scaling_service.service.store.migrate import upgrade
from scaling_service.service.store.sqlite_file import SqliteFile

SQLITE_NAME = "store.sqlite"


@dataclass(frozen=True, slots=True)
class Store:
    """Rows and files of a service.

    Parameters
    ----------
    database : Database
    blobs : Blobs
    """

    database: Database
    blobs: Blobs

    @classmethod
    def open(cls, folder: Path, database_url: str | None = None) -> Store:
        """Open a data directory, making it and the tables where needed.

        Parameters
        ----------
        folder : Path
        database_url : str, optional
            SQLite in the folder unless given.

        Raises
        ------
        InputError
            The URL cannot be used.
        StoreUnavailable
            The folder cannot be written to, or the database does not answer.
        """
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
        """Remove what nobody refers to: contents, dead uploads, folders of attempts that are over.

        Raises
        ------
        StoreUnavailable
            Nothing is lost; call it again later.
        """
        with disk_errors(self.blobs.folder):
            self.blobs.remove_dead_uploads()
            found = list(self.blobs.work.iterdir())
        alive = {f"{job}.{attempt}" for job, attempt in queueing.running_attempts(self.database)}
        for folder in found:  # listed before the jobs were asked for: a new one is among the living
            if folder.name not in alive:
                shutil.rmtree(folder, ignore_errors=True)
        references.collect(self.database, self.blobs)
        deletion.remove_traces(self.database)

    def check(self) -> dict[str, float]:
        """Whether rows can be read and files written now.

        Returns
        -------
        dict
            ``database_s`` and ``disk_s``, the time that each took, and ``free_bytes``.

        Raises
        ------
        StoreUnavailable
            Which of the two does not answer, and why.
        """
        begun = time.perf_counter()
        with self.read() as connection:
            connection.execute(text("SELECT 1"))
        between = time.perf_counter()
        probe = self.blobs.uploads / f"probe-{time.monotonic_ns()}"
        with disk_errors(self.blobs.folder):
            try:
                probe.write_bytes(b"probe")
                sync_folder(self.blobs.uploads)
                free = shutil.disk_usage(self.blobs.folder).free
            finally:
                probe.unlink(missing_ok=True)
        return {
            "database_s": between - begun,
            "disk_s": time.perf_counter() - between,
            "free_bytes": float(free),
        }

    def require_room(self, least: int) -> None:
        """Check that so many bytes are free on the disk.

        Raises
        ------
        StoreFull
            There are fewer.
        """
        folder = self.blobs.folder
        with disk_errors(folder):
            if shutil.disk_usage(folder).free < least:
                raise full(folder)

    def close(self) -> None:
        """Give all connections back."""
        self.database.close()
