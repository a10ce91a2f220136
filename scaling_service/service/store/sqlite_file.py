"""The file of a SQLite database: opened as it is, never made by chance, and opened anew where it was changed.

A disk that failed is mounted again, or a backup is put in place, while the service runs. Connections that
are open still see the file that was there before.
"""

from __future__ import annotations

import os
import sqlite3
from pathlib import Path
from typing import Any
from urllib.parse import quote

from sqlalchemy.exc import DisconnectionError

BUSY_S = 10.0
"""How long a writer waits for another. Chosen: the longest write, a cascading delete, takes well under it."""

_PRAGMAS = (
    "PRAGMA journal_mode=WAL",  # readers never wait for writers
    "PRAGMA synchronous=FULL",  # what a client was told is kept survives a power failure
    "PRAGMA foreign_keys=ON",
    "PRAGMA secure_delete=ON",  # deleted content is overwritten
)

_PRIVATE = 0o600


class SqliteFile:
    """How connections to the file are made and looked at; its methods listen to a pool of SQLAlchemy's.

    Parameters
    ----------
    path : Path
    """

    def __init__(self, path: Path) -> None:
        self._path = path

    def make(self) -> None:
        """Make an empty file, unless there is one.

        Raises
        ------
        OSError
            The disk does not take it.
        """
        os.close(os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, _PRIVATE))

    def connect(self) -> sqlite3.Connection:
        """Open the file; where it is gone, perhaps with its disk, none is made in its place."""
        place = f"file:{quote(str(self._path))}?mode=rw"
        return sqlite3.connect(
            place,
            timeout=BUSY_S,
            uri=True,
            check_same_thread=False,  # a pool's connection has one user at a time
            isolation_level=None,  # transactions are begun by the caller
        )

    def connected(self, raw: Any, record: Any) -> None:
        """Remember which file it is, and how it is used."""
        record.info["file"] = self._identity()
        for pragma in _PRAGMAS:
            raw.execute(pragma)

    def check(self, _raw: Any, record: Any, _proxy: Any) -> None:
        """Have the file opened anew where another stands under its name now."""
        if record.info["file"] != self._identity():
            raise DisconnectionError

    def _identity(self) -> tuple[int, int] | None:
        try:
            found = self._path.stat()
        except OSError:
            return None
        return found.st_dev, found.st_ino
