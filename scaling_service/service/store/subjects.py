"""Subjects, always of one owner."""

from __future__ import annotations

from typing import Any

from sqlalchemy import Connection, Row, insert, select, update

from scaling_service.service.store.clock import NowUs
from scaling_service.service.store.database import Database
from scaling_service.service.store.errors import NotFound
from scaling_service.service.store.keys import ensure_owner
from scaling_service.service.store.paging import Page, cursor_of, newest_first
from scaling_service.service.store.rows import SubjectRow
from scaling_service.service.store.tables import subjects

_SHOWN = tuple(subjects.c[name] for name in SubjectRow.__dataclass_fields__)


def put(database: Database, owner: str, identity: str, document: str) -> tuple[SubjectRow, bool]:
    """Keep a subject's document; files that were uploaded before stay.

    Returns
    -------
    row : SubjectRow
    new : bool
        Whether there was none of that name.
    """
    mine = (subjects.c.owner == owner) & (subjects.c.id == identity)
    with database.write() as connection:
        ensure_owner(connection, owner)
        changed = connection.execute(
            update(subjects)
            .where(mine)
            .values(document=document, updated_us=NowUs(), revision=subjects.c.revision + 1)
        )
        new = changed.rowcount == 0
        if new:
            connection.execute(
                insert(subjects).values(
                    owner=owner, id=identity, document=document, created_us=NowUs(), updated_us=NowUs()
                )
            )
        return _row(connection.execute(select(*_SHOWN).where(mine)).one()), new


def get(database: Database, owner: str, identity: str) -> SubjectRow:
    """One subject.

    Raises
    ------
    NotFound
        This owner has none of that name.
    """
    with database.read() as connection:
        found = connection.execute(
            select(*_SHOWN).where(subjects.c.owner == owner, subjects.c.id == identity)
        ).one_or_none()
    if found is None:
        raise no_subject(identity)
    return _row(found)


def document(database: Database, owner: str, identity: str) -> str:
    """A subject's document as it was put.

    Raises
    ------
    NotFound
        This owner has none of that name.
    """
    with database.read() as connection:
        return document_in(connection, owner, identity)


def document_in(connection: Connection, owner: str, identity: str) -> str:
    """:func:`document` within a transaction."""
    found = connection.scalar(
        select(subjects.c.document).where(subjects.c.owner == owner, subjects.c.id == identity)
    )
    if found is None:
        raise no_subject(identity)
    return str(found)


def page(database: Database, owner: str, cursor: str | None = None, limit: int = 50) -> Page[SubjectRow]:
    """An owner's subjects, newest first."""
    wanted = newest_first(
        select(*_SHOWN).where(subjects.c.owner == owner), subjects.c.created_us, subjects.c.id, cursor, limit
    )
    with database.read() as connection:
        rows = [_row(row) for row in connection.execute(wanted)]
    more = len(rows) > limit
    shown = tuple(rows[:limit])
    return Page(shown, cursor_of(shown[-1].created_us, shown[-1].id) if more else None)


def _row(row: Row[Any]) -> SubjectRow:
    return SubjectRow(**row._mapping)


def no_subject(identity: str) -> NotFound:
    """The error for a subject that this owner has not."""
    return NotFound(f"there is no subject '{identity}'", field="subject", remedy="Upload its document first")
