"""The files of subjects: kept once each, however many subjects or jobs refer to them."""

from __future__ import annotations

from collections.abc import Iterable

from sqlalchemy import ColumnElement, Connection, and_, delete, func, insert, select, update

from scaling_service.core.errors import InputError
from scaling_service.service.store import references
from scaling_service.service.store.blobs import Blobs, Content
from scaling_service.service.store.clock import NowUs
from scaling_service.service.store.database import Database
from scaling_service.service.store.errors import NotFound
from scaling_service.service.store.rows import FileRow
from scaling_service.service.store.subjects import get, no_subject
from scaling_service.service.store.tables import subject_files, subjects


def attach(
    database: Database, blobs: Blobs, owner: str, identity: str, name: str, content: Content, *, most: int
) -> FileRow:
    """Keep an upload as a subject's file; one of the same name is replaced.

    Parameters
    ----------
    most : int
        Files that a subject may have.

    Raises
    ------
    NotFound
        This owner has no such subject.
    InputError
        It has too many files.
    """
    row = FileRow(name, content.sha256, content.size)
    mine = _of(owner, identity)
    with database.write() as connection:
        _touch(connection, owner, identity)
        replaced = connection.scalars(
            delete(subject_files).where(mine, subject_files.c.name == name).returning(subject_files.c.sha256)
        ).all()
        if (connection.scalar(select(func.count()).select_from(subject_files).where(mine)) or 0) >= most:
            raise InputError(
                f"subject '{identity}' has {most} files already, which is the most",
                field="name",
                remedy="Remove files that are not needed",
            )
        references.keep(connection, blobs, [content])
        connection.execute(
            insert(subject_files).values(
                owner=owner, subject=identity, name=name, sha256=row.sha256, size=row.size, updated_us=NowUs()
            )
        )
    references.release(database, blobs, set(replaced) - {row.sha256})
    return row


def files(database: Database, owner: str, identity: str) -> list[FileRow]:
    """A subject's files, by name.

    Raises
    ------
    NotFound
        This owner has no such subject.
    """
    get(database, owner, identity)
    with database.read() as connection:
        return files_in(connection, owner, identity)


def files_in(connection: Connection, owner: str, identity: str) -> list[FileRow]:
    """:func:`files` within a transaction."""
    rows = connection.execute(
        select(subject_files.c.name, subject_files.c.sha256, subject_files.c.size)
        .where(_of(owner, identity))
        .order_by(subject_files.c.name)
    )
    return [FileRow(*row) for row in rows]


def detach(database: Database, blobs: Blobs, owner: str, identity: str, names: Iterable[str]) -> None:
    """Remove files of a subject; jobs that were asked for before keep their own reference.

    Raises
    ------
    NotFound
        A file is not there; nothing was removed.
    """
    gone: list[str] = []
    with database.write() as connection:
        for name in names:
            found = connection.scalar(
                delete(subject_files)
                .where(_of(owner, identity), subject_files.c.name == name)
                .returning(subject_files.c.sha256)
            )
            if found is None:
                raise NotFound(f"subject '{identity}' has no file '{name}'", field="name")
            gone.append(found)
        _touch(connection, owner, identity)
    references.release(database, blobs, gone)


def _of(owner: str, identity: str) -> ColumnElement[bool]:
    return and_(subject_files.c.owner == owner, subject_files.c.subject == identity)


def _touch(connection: Connection, owner: str, identity: str) -> None:
    """Lock the subject's row and note the change."""
    done = connection.execute(
        update(subjects)
        .where(subjects.c.owner == owner, subjects.c.id == identity)
        .values(updated_us=NowUs(), revision=subjects.c.revision + 1)
    )
    if done.rowcount == 0:
        raise no_subject(identity)
