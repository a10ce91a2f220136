"""Rows of jobs: made, read, changed under a lock."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, Table, insert, select, update

from scaling_service.service.store.clock import NowUs
from scaling_service.service.store.database import Database
from scaling_service.service.store.errors import NotFound
from scaling_service.service.store.keys import ensure_owner
from scaling_service.service.store.rows import JOB_COLUMNS, FileRow, JobRow, job_row
from scaling_service.service.store.tables import job_files, job_inputs, job_subjects, jobs

SHOWN = tuple(jobs.c[name] for name in JOB_COLUMNS)


@dataclass(frozen=True, slots=True)
class NewJob:
    """What a job is from its beginning.

    Parameters
    ----------
    id : str
        The SHA-256 of what follows, made by the caller.
    specification : str
        Canonical JSON.
    subjects : tuple of str
        Whose data it rests on.
    inputs : tuple of FileRow
        Path in the folder of inputs, and content.
    parts : tuple of NewJob
        What it is made of.
    """

    id: str
    owner: str
    kind: str
    code_version: str
    specification: str
    subjects: tuple[str, ...]
    inputs: tuple[FileRow, ...]
    parts: tuple[NewJob, ...] = ()


def add(connection: Connection, job: NewJob, state: str, *, part: bool = False) -> None:
    """Make a job's rows but for those of its parts; its inputs' contents must be referred to already."""
    ensure_owner(connection, job.owner)
    now = connection.scalar(select(NowUs()))
    connection.execute(
        insert(jobs).values(
            id=job.id,
            owner=job.owner,
            kind=job.kind,
            state=state,
            part=int(part),
            code_version=job.code_version,
            specification=job.specification,
            created_us=now,
            updated_us=now,
        )
    )
    if job.subjects:
        named = [{"job": job.id, "subject": s, "owner": job.owner, "created_us": now} for s in job.subjects]
        connection.execute(insert(job_subjects), named)
    _add_files(connection, job_inputs, job.id, job.inputs)


def add_files(connection: Connection, job: str, files: Iterable[FileRow]) -> None:
    """Say what a job made."""
    _add_files(connection, job_files, job, files)


def seen(connection: Connection, job: str) -> JobRow | None:
    """A job as this transaction sees it; None if there is none."""
    found = connection.execute(select(*SHOWN).where(jobs.c.id == job)).mappings().one_or_none()
    return None if found is None else job_row(found)


def locked(connection: Connection, job: str, owner: str | None = None) -> JobRow | None:
    """A job that nobody else can change before this write transaction ends; None if there is none."""
    statement = select(*SHOWN).where(jobs.c.id == job).with_for_update()
    if owner is not None:
        statement = statement.where(jobs.c.owner == owner)
    found = connection.execute(statement).mappings().one_or_none()
    return None if found is None else job_row(found)


def change(connection: Connection, job: str, values: Mapping[str, Any]) -> None:
    """Write columns of a job that is locked; its revision grows."""
    connection.execute(
        update(jobs)
        .where(jobs.c.id == job)
        .values(**{"updated_us": NowUs()} | dict(values), revision=jobs.c.revision + 1)
    )


def get(database: Database, owner: str, job: str) -> JobRow:
    """One job.

    Raises
    ------
    NotFound
        This owner has no such job.
    """
    with database.read() as connection:
        statement = select(*SHOWN).where(jobs.c.id == job, jobs.c.owner == owner)
        found = connection.execute(statement).mappings().one_or_none()
    if found is None:
        raise no_job(job)
    return job_row(found)


def documents(database: Database, owner: str, job: str) -> tuple[str, str | None, str | None]:
    """A job's specification, result and provenance as JSON texts.

    Raises
    ------
    NotFound
        This owner has no such job.
    """
    with database.read() as connection:
        found = connection.execute(
            select(jobs.c.specification, jobs.c.result, jobs.c.provenance).where(
                jobs.c.id == job, jobs.c.owner == owner
            )
        ).one_or_none()
    if found is None:
        raise no_job(job)
    return found.specification, found.result, found.provenance


def files(database: Database, owner: str, job: str) -> list[FileRow]:
    """What a job made, by path.

    Raises
    ------
    NotFound
        This owner has no such job.
    """
    get(database, owner, job)
    return _files(database, job_files, job)


def inputs(database: Database, job: str) -> list[FileRow]:
    """What a job was asked to work on, by path."""
    return _files(database, job_inputs, job)


def no_job(job: str) -> NotFound:
    """The error for a job that this owner has not."""
    return NotFound(f"there is no job '{job[:64]}'", field="job", remedy="List the jobs")


def _files(database: Database, table: Table, job: str) -> list[FileRow]:
    with database.read() as connection:
        rows = connection.execute(
            select(table.c.path, table.c.sha256, table.c.size)
            .where(table.c.job == job)
            .order_by(table.c.path)
        )
        return [FileRow(*row) for row in rows]


def _add_files(connection: Connection, table: Table, job: str, files: Iterable[FileRow]) -> None:
    rows = [{"job": job, "path": f.name, "sha256": f.sha256, "size": f.size} for f in files]
    if rows:
        connection.execute(insert(table), rows)
