"""What can go wrong with the store itself, apart from what a user gives."""

from __future__ import annotations

import errno
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from scaling_service.core.errors import InputError

NO_ROOM = (errno.ENOSPC, errno.EDQUOT)  # the disk or the user's share of it is full

NO_ACCESS = (
    *(errno.EROFS, errno.ENOENT, errno.ENOTDIR, errno.EACCES, errno.EPERM),
    *(errno.EIO, errno.ESTALE, errno.ENXIO, errno.EMFILE),
)
"""The disk cannot be written to, or does not answer."""

_SQLITE_NO_FILE = ("SQLITE_BUSY", "SQLITE_LOCKED", "SQLITE_IOERR", "SQLITE_READONLY", "SQLITE_CANTOPEN")


class StoreUnavailable(InputError):
    """The database or the data directory does not answer now; nothing was changed. Try again later."""


class StoreFull(StoreUnavailable):
    """There is no room on the disk; nothing was changed."""


class ContentMissing(StoreUnavailable):
    """A file that should be in the data directory is not there, or was damaged."""


class NotFound(InputError):
    """There is no such subject, file, job or key for this owner."""


class InUse(InputError):
    """A part of a job that is not over can be neither cancelled nor deleted."""


class TooLarge(InputError):
    """An upload is larger than the service accepts."""


class StoreTooNew(InputError):
    """The tables were made by a later version of the program."""


@contextmanager
def disk_errors(place: Path) -> Iterator[None]:
    """Let errors of the disk leave as the store's: StoreFull or StoreUnavailable."""
    try:
        yield
    except OSError as error:
        if error.errno in NO_ROOM:
            raise report_full(place) from error
        if error.errno in NO_ACCESS:
            raise StoreUnavailable(
                f"the data directory cannot be used: {error.strerror}",
                file=place,
                remedy="Make the disk writable again; the service goes on by itself",
            ) from error
        raise


def report_full(place: Path | None = None) -> StoreFull:
    """There is no room left."""
    return StoreFull(
        "there is no room left on the disk",
        file=place,
        remedy="Delete old results or enlarge the disk; the service goes on by itself",
    )


def of_sqlite(error: BaseException | None) -> StoreUnavailable | None:
    """The store's word for an error of SQLite that concerns its file and not the statement."""
    name = getattr(error, "sqlite_errorname", "")
    if name == "SQLITE_FULL":
        return report_full()
    if isinstance(error, sqlite3.DatabaseError) and name.startswith(_SQLITE_NO_FILE):
        return StoreUnavailable(
            f"the database cannot be used now ({name})",
            remedy="Look at the disk that holds the data directory; the service goes on by itself",
        )
    return None


def report_needed(job: str) -> InUse:
    """The error for a part that is needed."""
    return InUse(
        f"the job '{job[:12]}…' is a part of another one that is not over",
        field="job",
        remedy="Cancel that one, or wait for its end",
    )
