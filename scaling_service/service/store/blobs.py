"""Content, each once, named by its SHA-256: the files on disk, and the rows that refer to them.

Writer and collector both lock the content's row first and touch its file while they hold it. Whoever comes
second sees what the first one did: the writer puts its file in place again, the collector finds a reference
and leaves the file alone.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
import secrets
from collections import abc
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import sqlalchemy as sa

from scaling_service.service.store import database as db
from scaling_service.service.store import errors, tables

_CHUNK = 1 << 20
"""Bytes held at once. Chosen: large enough that disks run at full speed, small beside a process."""

_PRIVATE = 0o700  # only the service's own user may look: the files are of patients
_AT_ONCE = 100  # contents removed in one transaction. Chosen: others wait for some ms only.

_UNREFERRED = ~sa.or_(
    *(sa.exists().where(table.c.sha256 == tables.blobs.c.sha256) for table in tables.REFERENCES)
)


@dataclass(frozen=True, slots=True)
class Content:
    """A whole file in scratch, safely on disk, not yet in place."""

    sha256: str
    size: int
    scratch: Path


class Incoming:
    """An upload that is being written; the lock on its file shows that its writer lives."""

    def __init__(self, scratch: Path, limit: int) -> None:
        self._scratch, self._limit = scratch, limit
        self._digest, self._size = hashlib.sha256(), 0
        self._file = scratch.open("xb")
        fcntl.flock(self._file, fcntl.LOCK_EX)

    def write(self, chunk: bytes) -> None:
        """Add bytes; TooLarge where more than the limit came."""
        self._size += len(chunk)
        if self._size > self._limit:
            raise errors.TooLarge(
                f"the upload is larger than {self._limit / 1e6:g} MB",
                remedy="Cut or compress the recording, or raise the limit in the service's settings",
            )
        self._digest.update(chunk)
        with errors.disk_errors(self._scratch.parent):
            self._file.write(chunk)

    def finish(self) -> Content:
        """All has come: put it safely on disk."""
        with errors.disk_errors(self._scratch.parent):
            self._file.flush()
            os.fsync(self._file.fileno())
        return Content(self._digest.hexdigest(), self._size, self._scratch)

    def close(self) -> None:
        """Leave nothing in scratch; what was put in place stays."""
        self._scratch.unlink(missing_ok=True)
        with contextlib.suppress(OSError):  # bytes that a full disk did not take
            self._file.close()


class Blobs:
    """The folders of contents and of scratch in a data directory, which is made if it is not there."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.uploads = folder / "scratch" / "uploads"
        self.work = folder / "scratch" / "jobs"
        self._blobs = folder / "blobs"
        with errors.disk_errors(folder):
            for place in (folder, folder / "scratch", self.uploads, self.work, self._blobs):
                place.mkdir(mode=_PRIVATE, parents=True, exist_ok=True)

    @contextlib.contextmanager
    def incoming(self, limit: int) -> abc.Iterator[Incoming]:
        """Take an upload of at most ``limit`` bytes; what is not kept in time leaves no trace."""
        with errors.disk_errors(self.folder):
            upload = Incoming(self.uploads / secrets.token_hex(16), limit)
        try:
            yield upload
        finally:
            upload.close()

    def path(self, sha256: str) -> Path:
        """Where content lies, or would."""
        return self._blobs / sha256[:2] / sha256[2:]

    def place(self, content: Content) -> None:
        """Put content in place, within the transaction that holds the lock of its row.

        Repeating it after a transaction that failed is harmless.
        """
        target = self.path(content.sha256)
        with errors.disk_errors(self.folder):
            if not target.parent.exists():
                target.parent.mkdir(mode=_PRIVATE, exist_ok=True)
                sync_folder(target.parent.parent)
            if content.scratch.exists():
                content.scratch.replace(target)
                sync_folder(target.parent)
            elif not target.exists():
                raise _report_content_missing(content.sha256)

    def remove(self, sha256: str) -> None:
        """Remove content, within the transaction that holds the lock of its row."""
        with errors.disk_errors(self.folder):
            self.path(sha256).unlink(missing_ok=True)

    def open(self, sha256: str) -> BinaryIO:
        """Content, to be read; ContentMissing where it is not there."""
        with errors.disk_errors(self.folder):
            try:
                return self.path(sha256).open("rb")
            except FileNotFoundError:
                raise _report_content_missing(sha256) from None

    def copy(self, sha256: str, target: Path) -> None:
        """Copy content to a file and check on the way that it is what its name says."""
        digest = hashlib.sha256()
        with self.open(sha256) as source, errors.disk_errors(target.parent), target.open("xb") as copy:
            while chunk := source.read(_CHUNK):
                digest.update(chunk)
                copy.write(chunk)
        if digest.hexdigest() != sha256:
            raise errors.ContentMissing(
                "a stored file is damaged",
                file=self.path(sha256),
                remedy="Check the disk, and upload the file again",
            )

    def list_stored(self) -> abc.Iterator[str]:
        """The digests of all files in place."""
        for shard in sorted(self._blobs.iterdir()):
            for file in sorted(shard.iterdir()):
                yield shard.name + file.name

    def remove_dead_uploads(self) -> int:
        """Remove uploads whose writer is gone, wherever it was killed; how many there were."""
        removed = 0
        for path in self.uploads.iterdir():
            with contextlib.suppress(BlockingIOError, FileNotFoundError), path.open("rb") as file:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                path.unlink(missing_ok=True)
                removed += 1
        return removed


def prepare(path: Path) -> Content:
    """A finished file in scratch, synced and named by its content."""
    with errors.disk_errors(path.parent), path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
        os.fsync(file.fileno())
        return Content(digest, os.fstat(file.fileno()).st_size, path)


def sync_folder(folder: Path) -> None:
    """Put the names in a folder safely on disk."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _report_content_missing(sha256: str) -> errors.ContentMissing:
    return errors.ContentMissing(
        f"the stored content {sha256[:12]}… is not there",
        remedy="Upload the file again, or restore the data directory from a backup",
    )


def keep(connection: sa.Connection, files: Blobs, contents: abc.Iterable[Content]) -> None:
    """Lock the rows of contents and put the files in place; references follow in the same transaction.

    They are locked in the order of their digests, so that two writers never wait for each other in a circle.
    """
    for content in sorted(contents, key=lambda c: c.sha256):
        _lock(connection, content.sha256, {"size": content.size})
        files.place(content)


def remove_unreferenced(database: db.Database, files: Blobs, digests: abc.Iterable[str]) -> int:
    """Remove those contents that nothing refers to any more; the number removed."""
    removed = 0
    with database.write() as connection:
        for sha256 in sorted(set(digests)):
            this = sa.select(tables.blobs.c.sha256).where(tables.blobs.c.sha256 == sha256)
            if connection.scalar(this.with_for_update()) is None:
                continue
            # A statement of its own: it sees what those who held the lock before have committed.
            if connection.scalar(this.where(_UNREFERRED)) is not None:
                connection.execute(sa.delete(tables.blobs).where(tables.blobs.c.sha256 == sha256))
                files.remove(sha256)
                removed += 1
    return removed


def collect_garbage(database: db.Database, files: Blobs) -> int:
    """Remove all content that nothing refers to; the number of files removed.

    Files without a row were put in place by a transaction that then failed, or by one that is about to
    commit it: making the row first waits for that.
    """
    with database.read() as connection:
        unused = list(connection.scalars(sa.select(tables.blobs.c.sha256).where(_UNREFERRED)))
        listed = set(connection.scalars(sa.select(tables.blobs.c.sha256)))
    unlisted = [sha256 for sha256 in files.list_stored() if sha256 not in listed]
    for sha256 in unlisted:
        with database.write() as connection:
            _lock(connection, sha256, {})
    unused += unlisted
    return sum(
        remove_unreferenced(database, files, unused[k : k + _AT_ONCE])
        for k in range(0, len(unused), _AT_ONCE)
    )


def _lock(connection: sa.Connection, sha256: str, size: dict[str, int]) -> None:
    """Make the content's row or lock the one that is there."""
    changed = {"touched_us": db.NowUs()} | size
    made = db.insert_for(connection)(tables.blobs).values({"sha256": sha256, "size": 0} | changed)
    connection.execute(made.on_conflict_do_update(index_elements=[tables.blobs.c.sha256], set_=changed))
