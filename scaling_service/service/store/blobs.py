"""Content on disk, each once, named by its SHA-256."""

from __future__ import annotations

import fcntl
import hashlib
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from scaling_service.service.store.errors import ContentMissing, TooLarge, disk_errors

_CHUNK = 1 << 20
"""Bytes held at once. Chosen: large enough that disks run at full speed, small beside a process."""

_PRIVATE = 0o700
"""Only the service's own user may look: the files are of patients."""


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
        """Add bytes.

        Raises
        ------
        TooLarge
            More than the limit came.
        StoreFull, StoreUnavailable
            The disk does not take them.
        """
        self._size += len(chunk)
        if self._size > self._limit:
            raise TooLarge(
                f"the upload is larger than {self._limit / 1e6:g} MB",
                remedy="Cut or compress the recording, or raise the limit in the service's settings",
            )
        self._digest.update(chunk)
        with disk_errors(self._scratch.parent):
            self._file.write(chunk)

    def finish(self) -> Content:
        """All has come: put it safely on disk.

        Raises
        ------
        StoreFull, StoreUnavailable
            The disk does not take it.
        """
        with disk_errors(self._scratch.parent):
            self._file.flush()
            os.fsync(self._file.fileno())
        return Content(self._digest.hexdigest(), self._size, self._scratch)

    def close(self) -> None:
        """Leave nothing in scratch; what was put in place stays."""
        self._scratch.unlink(missing_ok=True)
        with suppress(OSError):  # bytes that a full disk did not take
            self._file.close()


class Blobs:
    """The folders of contents and of scratch.

    Parameters
    ----------
    folder : Path
        The data directory; made if it is not there.

    Raises
    ------
    StoreUnavailable
        It cannot be made or written to.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.uploads = folder / "scratch" / "uploads"
        self.work = folder / "scratch" / "jobs"
        self._blobs = folder / "blobs"
        with disk_errors(folder):
            for place in (folder, folder / "scratch", self.uploads, self.work, self._blobs):
                place.mkdir(mode=_PRIVATE, parents=True, exist_ok=True)

    @contextmanager
    def incoming(self, limit: int) -> Iterator[Incoming]:
        """Take an upload of at most ``limit`` bytes; what is not kept in time leaves no trace.

        Examples
        --------
        ``with blobs.incoming(limit) as upload: upload.write(chunk); content = upload.finish(); …``
        """
        with disk_errors(self.folder):
            upload = Incoming(self.uploads / secrets.token_hex(16), limit)
        try:
            yield upload
        finally:
            upload.close()

    def path(self, sha256: str) -> Path:
        """Where content lies, or would."""
        return self._blobs / sha256[:2] / sha256[2:]

    def place(self, content: Content) -> None:
        """Put content in place. Call it within the transaction that holds the lock of its row.

        Repeating it after a transaction that failed is harmless.

        Raises
        ------
        ContentMissing
            It is neither in scratch nor in place.
        StoreUnavailable
            The disk does not take it.
        """
        target = self.path(content.sha256)
        with disk_errors(self.folder):
            if not target.parent.exists():
                target.parent.mkdir(mode=_PRIVATE, exist_ok=True)
                sync_folder(target.parent.parent)
            if content.scratch.exists():
                content.scratch.replace(target)
                sync_folder(target.parent)
            elif not target.exists():
                raise _gone(content.sha256)

    def remove(self, sha256: str) -> None:
        """Remove content. Call it within the transaction that holds the lock of its row."""
        with disk_errors(self.folder):
            self.path(sha256).unlink(missing_ok=True)

    def open(self, sha256: str) -> BinaryIO:
        """Content, to be read.

        Raises
        ------
        ContentMissing
            It is not there.
        """
        with disk_errors(self.folder):
            try:
                return self.path(sha256).open("rb")
            except FileNotFoundError:
                raise _gone(sha256) from None

    def copy(self, sha256: str, target: Path) -> None:
        """Copy content to a file and check on the way that it is what its name says.

        Raises
        ------
        ContentMissing
            It is not there, or was damaged on disk.
        """
        digest = hashlib.sha256()
        with self.open(sha256) as source, disk_errors(target.parent), target.open("xb") as copy:
            while chunk := source.read(_CHUNK):
                digest.update(chunk)
                copy.write(chunk)
        if digest.hexdigest() != sha256:
            raise ContentMissing(
                "a stored file is damaged",
                file=self.path(sha256),
                remedy="Check the disk, and upload the file again",
            )

    def stored(self) -> Iterator[str]:
        """The digests of all files in place."""
        for shard in sorted(self._blobs.iterdir()):
            for file in sorted(shard.iterdir()):
                yield shard.name + file.name

    def remove_dead_uploads(self) -> int:
        """Remove uploads whose writer is gone, wherever it was killed; how many there were."""
        return sum(_removed_if_dead(file) for file in self.uploads.iterdir())


def prepare(path: Path) -> Content:
    """A finished file in scratch, synced and named by its content.

    Raises
    ------
    StoreFull, StoreUnavailable
        The disk does not take it.
    """
    with disk_errors(path.parent), path.open("rb") as file:
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


def _removed_if_dead(file: Path) -> bool:
    try:
        with file.open("rb") as handle:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            file.unlink(missing_ok=True)
            return True
    except (BlockingIOError, FileNotFoundError):
        return False


def _gone(sha256: str) -> ContentMissing:
    return ContentMissing(
        f"the stored content {sha256[:12]}… is not there",
        remedy="Upload the file again, or restore the data directory from a backup",
    )
