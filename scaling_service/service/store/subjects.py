"""Subjects, their files, and the labels that a laboratory gives to markers."""

from __future__ import annotations

import dataclasses

import sqlalchemy as sa

from scaling_service.core.errors import InputError
from scaling_service.service.store import blobs as store_blobs
from scaling_service.service.store import database as db
from scaling_service.service.store import tables
from scaling_service.service.store.errors import NotFound
from scaling_service.service.store.keys import ensure_owner

_SHOWN = tuple(tables.subjects.c[name] for name in tables.SubjectRow.__dataclass_fields__)


def is_subject(owner: str, identity: str) -> sa.ColumnElement[bool]:
    """Whether a subject's row is the one of this owner and name."""
    return sa.and_(tables.subjects.c.owner == owner, tables.subjects.c.id == identity)


def put(
    database: db.Database, owner: str, identity: str, document: str, *, most: int | None = None
) -> tuple[tables.SubjectRow, bool]:
    """Keep a subject's document, and whether its name is new; files that were uploaded before stay.

    InputError is raised where it is new, and the owner has ``most`` already.
    """
    with database.write() as connection:
        ensure_owner(connection, owner)
        new = not _change(connection, owner, identity, document=document)
        if new:
            own = sa.select(sa.func.count()).where(tables.subjects.c.owner == owner)
            if most is not None and (connection.scalar(own) or 0) >= most:
                raise InputError(
                    f"there are {most:,} subjects, which is the most",
                    field="limit_subjects",
                    remedy="Delete subjects that are not needed",
                )
            connection.execute(
                sa.insert(tables.subjects).values(
                    owner=owner, id=identity, document=document, created_us=db.NowUs(), updated_us=db.NowUs()
                )
            )
        made = connection.execute(sa.select(*_SHOWN).where(is_subject(owner, identity))).mappings().one()
        return tables.SubjectRow(**made), new


def get(database: db.Database, owner: str, identity: str) -> tables.SubjectRow:
    """One subject; NotFound where this owner has none of that name."""
    with database.read() as connection:
        wanted = sa.select(*_SHOWN).where(is_subject(owner, identity))
        found = connection.execute(wanted).mappings().one_or_none()
    if found is None:
        raise report_no_subject(identity)
    return tables.SubjectRow(**found)


def read_document(connection: sa.Connection, owner: str, identity: str) -> str:
    """A subject's document as it was put; NotFound where this owner has none of that name."""
    found = connection.scalar(sa.select(tables.subjects.c.document).where(is_subject(owner, identity)))
    if found is None:
        raise report_no_subject(identity)
    return str(found)


def list_page(
    database: db.Database, owner: str, cursor: str | None = None, limit: int = 50
) -> tables.Page[tables.SubjectRow]:
    """An owner's subjects, newest first."""
    mine = sa.select(*_SHOWN).where(tables.subjects.c.owner == owner)
    order = (tables.subjects.c.created_us, tables.subjects.c.id)
    with database.read() as connection:
        return tables.read_page(connection, mine, order, cursor, limit, lambda row: tables.SubjectRow(**row))


def report_no_subject(identity: str) -> NotFound:
    """The error for a subject that this owner has not."""
    return NotFound(f"there is no subject '{identity}'", field="subject", remedy="Upload its document first")


def attach(
    database: db.Database,
    blobs: store_blobs.Blobs,
    owner: str,
    identity: str,
    name: str,
    content: store_blobs.Content,
    *,
    most: int,
) -> tables.FileRow:
    """Keep an upload as a subject's file, of which it may have ``most``; one of the same name is replaced."""
    row = tables.FileRow(name, content.sha256, content.size)
    mine = _select_files(owner, identity)
    with database.write() as connection:
        _touch(connection, owner, identity)
        replaced = _remove(connection, owner, identity, name)
        if (connection.scalar(sa.select(sa.func.count()).where(mine)) or 0) >= most:
            raise InputError(
                f"subject '{identity}' has {most} files already, which is the most",
                field="name",
                remedy="Remove files that are not needed",
            )
        store_blobs.keep(connection, blobs, [content])
        connection.execute(
            sa.insert(tables.subject_files).values(
                **dataclasses.asdict(row), owner=owner, subject=identity, updated_us=db.NowUs()
            )
        )
    store_blobs.remove_unreferenced(database, blobs, replaced - {row.sha256})
    return row


def detach(database: db.Database, blobs: store_blobs.Blobs, owner: str, identity: str, name: str) -> None:
    """Remove a file of a subject; jobs keep their own reference."""
    with database.write() as connection:
        gone = _remove(connection, owner, identity, name)
        if not gone:
            raise NotFound(f"subject '{identity}' has no file '{name}'", field="name")
        _touch(connection, owner, identity)
    store_blobs.remove_unreferenced(database, blobs, gone)


def _remove(connection: sa.Connection, owner: str, identity: str, name: str) -> set[str]:
    """Remove the file of this name, if there is one: its digest."""
    mine = _select_files(owner, identity)
    found = sa.delete(tables.subject_files).where(mine, tables.subject_files.c.name == name)
    return set(connection.scalars(found.returning(tables.subject_files.c.sha256)))


def list_files(database: db.Database, owner: str, identity: str) -> list[tables.FileRow]:
    """A subject's files, by name; NotFound where this owner has no such subject."""
    get(database, owner, identity)
    with database.read() as connection:
        return list_files_in(connection, owner, identity)


def list_files_in(connection: sa.Connection, owner: str, identity: str) -> list[tables.FileRow]:
    """:func:`list_files` within a transaction."""
    rows = connection.execute(
        sa.select(tables.subject_files.c.name, tables.subject_files.c.sha256, tables.subject_files.c.size)
        .where(_select_files(owner, identity))
        .order_by(tables.subject_files.c.name)
    )
    return [tables.FileRow(*row) for row in rows]


def _select_files(owner: str, identity: str) -> sa.ColumnElement[bool]:
    return sa.and_(tables.subject_files.c.owner == owner, tables.subject_files.c.subject == identity)


def _touch(connection: sa.Connection, owner: str, identity: str) -> None:
    """Lock the subject's row and note the change."""
    if not _change(connection, owner, identity):
        raise report_no_subject(identity)


def _change(connection: sa.Connection, owner: str, identity: str, **values: str) -> bool:
    """Write columns of a subject and note the change; whether there is such a subject."""
    noted = {"updated_us": db.NowUs(), "revision": tables.subjects.c.revision + 1}
    changed = sa.update(tables.subjects).where(is_subject(owner, identity)).values(values | noted)
    return connection.execute(changed).rowcount > 0


def read_marker_map(database: db.Database, owner: str) -> tables.WrittenRow | None:
    """Which label is which marker in an owner's laboratory; None where that was never said."""
    return _read_written(database, tables.marker_maps, owner=owner)


def put_marker_map(database: db.Database, owner: str, document: str) -> None:
    """Keep an owner's map, as JSON, in place of the one before."""
    with database.write() as connection:
        ensure_owner(connection, owner)
        _put_written(connection, tables.marker_maps, document, owner=owner)


def read_note(database: db.Database, owner: str, identity: str) -> tables.WrittenRow | None:
    """What was written about a subject; None where nothing was."""
    return _read_written(database, tables.notes, owner=owner, subject=identity)


def put_note(database: db.Database, owner: str, identity: str, document: str) -> None:
    """Keep what is written about a subject, as JSON, in place of what was; NotFound without the subject."""
    with database.write() as connection:
        read_document(connection, owner, identity)
        _put_written(connection, tables.notes, document, owner=owner, subject=identity)


def _read_written(database: db.Database, table: sa.Table, **keys: str) -> tables.WrittenRow | None:
    wanted = sa.select(table.c.document, table.c.updated_us).filter_by(**keys)
    with database.read() as connection:
        found = connection.execute(wanted).one_or_none()
    return None if found is None else tables.WrittenRow(*found)


def _put_written(connection: sa.Connection, table: sa.Table, document: str, **keys: str) -> None:
    kept = {"document": document, "updated_us": db.NowUs()}
    made = db.insert_for(connection)(table).values(keys | kept)
    connection.execute(made.on_conflict_do_update(index_elements=list(table.primary_key), set_=kept))
