"""Room on the disk: what is kept back so that deleting always works, and how much an owner has taken."""

from __future__ import annotations

import contextlib
import os
import shutil
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import sqlalchemy as sa

from scaling_service.core.errors import InputError
from scaling_service.service.store import tables
from scaling_service.service.store.database import Database

SPARE_BYTES = 8 << 20
"""Kept back. Chosen: SQLite's log takes a copy of what is deleted, and a job's rows are a megabyte or so."""

_SHARE = 8  # chosen: of what is free, no more than this part is kept back
_FRESH_S = 10.0  # chosen: an owner's files are counted again after this, which takes some ms


class QuotaReached(InputError):
    """An owner's files take as much room as is allowed."""


class Spare:
    """A file that takes room and holds nothing: removed while something is deleted on a full disk."""

    def __init__(self, folder: Path) -> None:
        self._file = folder / "spare"

    def keep(self, most: int = SPARE_BYTES, share: int = _SHARE) -> None:
        """Take the room, where there is some: at most so many bytes, and this part of what is free."""
        with contextlib.suppress(OSError):  # then there is none to keep
            size = min(most, shutil.disk_usage(self._file.parent).free // share)
            if self._file.exists() or not size:
                return
            handle = os.open(self._file, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
            try:
                os.posix_fallocate(handle, 0, size)
            finally:
                os.close(handle)

    @contextlib.contextmanager
    def given_up(self) -> Iterator[None]:
        """Leave the room to what happens meanwhile, where the disk is so full; then take it again."""
        size = 0
        with contextlib.suppress(OSError):  # the disk is away, which the change itself will say
            if shutil.disk_usage(self._file.parent).free < SPARE_BYTES:
                size = self._file.stat().st_size
                self._file.unlink()
        try:
            yield
        finally:
            if size:
                self.keep(size, share=1)


class Quotas:
    """How much room each owner has taken, counted now and then."""

    def __init__(self, database: Database, most_bytes: int) -> None:
        self._database, self._most, self._lock = database, most_bytes, threading.Lock()
        self._taken: dict[str, tuple[float, int]] = {}

    def require(self, owner: str, more: int = 0) -> None:
        """Raise QuotaReached where so many bytes more are not allowed."""
        now = time.monotonic()
        with self._lock:
            self._taken = {name: one for name, one in self._taken.items() if now - one[0] < _FRESH_S}
            _, taken = self._taken.get(owner, (now, -1))
        if taken < 0:
            taken = measure_taken(self._database, owner)
            with self._lock:
                self._taken[owner] = now, taken
        if taken + more > self._most:
            raise QuotaReached(
                f"your files take {taken / 1e6:,.0f} MB, and {self._most / 1e6:,.0f} MB is the most",
                field="limit_owner_mb",
                remedy="Delete subjects and jobs that are not needed",
            )

    def add(self, owner: str, size: int) -> None:
        """Count what was just kept."""
        with self._lock:
            if owner in self._taken:
                counted_at, taken = self._taken[owner]
                self._taken[owner] = counted_at, taken + size

    def forget(self, owner: str) -> None:
        """Count again the next time: something was deleted."""
        with self._lock:
            self._taken.pop(owner, None)


def measure_taken(database: Database, owner: str) -> int:
    """Bytes of all that an owner uploaded and that was made of it, each content once."""
    uploaded = sa.select(tables.subject_files.c.sha256, tables.subject_files.c.size).where(
        tables.subject_files.c.owner == owner
    )
    of_jobs = (
        sa.select(table.c.sha256, table.c.size)
        .join(tables.jobs, tables.jobs.c.id == table.c.job)
        .where(tables.jobs.c.owner == owner)
        for table in (tables.job_inputs, tables.job_files)
    )
    every = sa.union(uploaded, *of_jobs).subquery()
    with database.read() as connection:
        return int(connection.scalar(sa.select(sa.func.sum(every.c.size))) or 0)
