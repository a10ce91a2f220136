"""Rows of jobs: made, read, listed, changed under a lock."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, Select, Table, bindparam, func, insert, select, update

from scaling_service.documents.jobs import State
from scaling_service.service.store.database import Database, NowUs
from scaling_service.service.store.errors import NotFound
from scaling_service.service.store.keys import ensure_owner
from scaling_service.service.store.tables import (
    FileRow,
    JobRow,
    Page,
    job_files,
    job_inputs,
    job_subjects,
    jobs,
    make_job_row,
    read_page,
)

SHOWN = tuple(jobs.c[name] for name in JobRow.__dataclass_fields__)  # columns of a job that are small

_ONE = select(*SHOWN).where(jobs.c.id == bindparam("job"), jobs.c.owner == bindparam("owner"))
"""Made once: whoever follows a job asks again and again."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NewJob:
    """What a job is from its beginning."""

    id: str  # the SHA-256 of the specification, made by the caller
    owner: str
    kind: str
    code_version: str
    specification: str  # canonical JSON
    subjects: tuple[str, ...]  # whose data it rests on
    inputs: tuple[FileRow, ...]  # path in the folder of inputs, and content
    parts: tuple[NewJob, ...] = ()  # what it is made of


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


def find(connection: Connection, job: str) -> JobRow | None:
    """A job as this transaction sees it; None if there is none."""
    return find_first(connection, select(*SHOWN).where(jobs.c.id == job))


def lock(connection: Connection, job: str, owner: str | None = None) -> JobRow | None:
    """A job that nobody else can change before this write transaction ends; None if there is none."""
    statement = select(*SHOWN).where(jobs.c.id == job).with_for_update()
    return find_first(connection, statement if owner is None else statement.where(jobs.c.owner == owner))


def find_first(connection: Connection, statement: Select[Any], **values: str) -> JobRow | None:
    """The one job that a statement finds, if any; ``values``: of its parameters."""
    found = connection.execute(statement, values).mappings().one_or_none()
    return None if found is None else make_job_row(found)


def change(connection: Connection, job: str, values: Mapping[str, Any]) -> None:
    """Write columns of a job that is locked; its revision grows."""
    written = {"updated_us": NowUs()} | dict(values) | {"revision": jobs.c.revision + 1}
    connection.execute(update(jobs).where(jobs.c.id == job).values(written))


def get(database: Database, owner: str, job: str) -> JobRow:
    """One job; NotFound where this owner has none of that name."""
    with database.read() as connection:
        found = find_first(connection, _ONE, job=job, owner=owner)
    if found is None:
        raise report_no_job(job)
    return found


def read_documents(database: Database, owner: str, job: str) -> tuple[str, str | None, str | None]:
    """A job's specification, result and provenance as JSON texts; NotFound as in :func:`get`."""
    wanted = select(jobs.c.specification, jobs.c.result, jobs.c.provenance)
    with database.read() as connection:
        found = connection.execute(wanted.where(jobs.c.id == job, jobs.c.owner == owner)).one_or_none()
    if found is None:
        raise report_no_job(job)
    return found.specification, found.result, found.provenance


def list_files(database: Database, owner: str, job: str) -> list[FileRow]:
    """What a job made, by path; NotFound as in :func:`get`."""
    get(database, owner, job)
    return _list_files_of(database, job_files, job)


def list_inputs(database: Database, job: str) -> list[FileRow]:
    """What a job was asked to work on, by path."""
    return _list_files_of(database, job_inputs, job)


def report_no_job(job: str) -> NotFound:
    """The error for a job that this owner has not."""
    return NotFound(f"there is no job '{job[:64]}'", field="job", remedy="List the jobs")


def list_page(
    database: Database,
    owner: str,
    *,
    state: State | None = None,
    kind: str | None = None,
    subject: str | None = None,
    cursor: str | None = None,
    limit: int = 50,
) -> Page[JobRow]:
    """An owner's jobs, newest first, of one state, kind or subject where given."""
    if subject is None:
        order = (jobs.c.created_us, jobs.c.id)
        statement = select(*SHOWN).where(jobs.c.owner == owner)
    else:
        order = (job_subjects.c.created_us, job_subjects.c.job)
        statement = select(*SHOWN).join(job_subjects, job_subjects.c.job == jobs.c.id)
        statement = statement.where(job_subjects.c.owner == owner, job_subjects.c.subject == subject)
    if state is not None:
        statement = statement.where(jobs.c.state == state.value)
    if kind is not None:
        statement = statement.where(jobs.c.kind == kind)
    with database.read() as connection:
        return read_page(connection, statement, order, cursor, limit, make_job_row)


def count_by_state(database: Database) -> dict[State, int]:
    """Jobs of all owners by state, for monitoring."""
    with database.read() as connection:
        rows = connection.execute(select(jobs.c.state, func.count()).group_by(jobs.c.state)).all()
    return dict.fromkeys(State, 0) | {State(state): number for state, number in rows}


def _list_files_of(database: Database, table: Table, job: str) -> list[FileRow]:
    wanted = select(table.c.path, table.c.sha256, table.c.size).where(table.c.job == job)
    with database.read() as connection:
        return [FileRow(*row) for row in connection.execute(wanted.order_by(table.c.path))]


def _add_files(connection: Connection, table: Table, job: str, files: Iterable[FileRow]) -> None:
    rows = [{"job": job, "path": f.name, "sha256": f.sha256, "size": f.size} for f in files]
    if rows:
        connection.execute(insert(table), rows)
