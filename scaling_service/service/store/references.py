"""Content that rows refer to, and the removal of the rest; safe beside concurrent writers.

Writer and collector both lock the content's row first and touch its file while they hold it. Whoever
comes second sees what the first one did: the writer puts its file in place again, the collector finds a
reference and leaves the file alone.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from sqlalchemy import ColumnElement, Connection, Select, delete, exists, or_, select
from sqlalchemy.dialects import postgresql, sqlite

from scaling_service.service.store.blobs import Blobs, Content
from scaling_service.service.store.clock import NowUs
from scaling_service.service.store.database import Database
from scaling_service.service.store.tables import REFERENCES, blobs


def keep(connection: Connection, files: Blobs, contents: Iterable[Content]) -> None:
    """Lock the rows of contents and put the files in place; references follow in the same transaction.

    Parameters
    ----------
    connection : Connection
        Of a write transaction.
    contents : iterable of Content
        Locked in the order of their digests, so that two writers never wait for each other in a circle.
    """
    for content in sorted(contents, key=lambda c: c.sha256):
        _lock(connection, content.sha256, content.size)
        files.place(content)


def collect(database: Database, files: Blobs) -> int:
    """Remove all content that nothing refers to; the number of files removed.

    Also finds files that were put in place by a transaction that then failed.
    """
    with database.read() as connection:
        unused = list(connection.scalars(select(blobs.c.sha256).where(~_referred())))
    removed = sum(release(database, files, unused[k : k + 100]) for k in range(0, len(unused), 100))
    return removed + _collect_unlisted(database, files)


def release(database: Database, files: Blobs, digests: Iterable[str]) -> int:
    """Remove those contents that nothing refers to any more; the number removed."""
    removed = 0
    with database.write() as connection:
        for sha256 in sorted(set(digests)):
            locked = select(blobs.c.sha256).where(blobs.c.sha256 == sha256).with_for_update()
            if connection.scalar(locked) is None:
                continue
            # A statement of its own: it sees what those who held the lock before have committed.
            if connection.scalar(_unreferred(sha256)) is not None:
                connection.execute(delete(blobs).where(blobs.c.sha256 == sha256))
                files.remove(sha256)
                removed += 1
    return removed


def _collect_unlisted(database: Database, files: Blobs) -> int:
    """Files without a row. Making the row first waits for a writer that is about to commit it."""
    with database.read() as connection:
        listed = set(connection.scalars(select(blobs.c.sha256)))
    unlisted = [sha256 for sha256 in files.stored() if sha256 not in listed]
    for sha256 in unlisted:
        with database.write() as connection:
            _lock(connection, sha256, 0, keep_size=True)
    return release(database, files, unlisted)


def _lock(connection: Connection, sha256: str, size: int, *, keep_size: bool = False) -> None:
    """Make the content's row or lock the one that is there."""
    insert = postgresql.insert if connection.dialect.name == "postgresql" else sqlite.insert
    statement = insert(blobs).values(sha256=sha256, size=size, touched_us=NowUs())
    changed = {"touched_us": NowUs()} | ({} if keep_size else {"size": size})
    connection.execute(statement.on_conflict_do_update(index_elements=[blobs.c.sha256], set_=changed))


def _referred() -> ColumnElement[bool]:
    return or_(*(exists().where(table.c.sha256 == blobs.c.sha256) for table in REFERENCES))


def _unreferred(sha256: str) -> Select[Any]:
    return select(blobs.c.sha256).where(blobs.c.sha256 == sha256, ~_referred())
