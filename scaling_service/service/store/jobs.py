"""Rows of jobs: made, read, listed, changed under a lock; which is next, whose lease ran out."""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa

from scaling_service.documents.jobs import State
from scaling_service.service.store import database as db
from scaling_service.service.store import tables
from scaling_service.service.store.errors import NotFound
from scaling_service.service.store.keys import ensure_owner

SHOWN = tuple(tables.jobs.c[name] for name in tables.JobRow.__dataclass_fields__)
"""Columns of a job that are small."""

_ONE = sa.select(*SHOWN).where(
    tables.jobs.c.id == sa.bindparam("job"), tables.jobs.c.owner == sa.bindparam("owner")
)
"""Made once: whoever follows a job asks again and again."""

_NOTED = {"updated_us": db.NowUs(), "revision": tables.jobs.c.revision + 1}  # of a row that changes
_LEASED = tables.jobs.c.state.in_([state.value for state in State if state.is_leased])
_QUEUED = tables.jobs.c.state == State.QUEUED.value


@dataclass(frozen=True, slots=True, kw_only=True)
class NewJob:
    """What a job is from its beginning."""

    id: str  # the SHA-256 of the specification, made by the caller
    owner: str
    kind: str
    code_version: str
    specification: str  # canonical JSON
    subjects: tuple[str, ...]  # whose data it rests on
    inputs: tuple[tables.FileRow, ...]  # path in the folder of inputs, and content
    parts: tuple[NewJob, ...] = ()  # what it is made of


def add(connection: sa.Connection, job: NewJob, state: str, *, part: bool = False) -> None:
    """Make a job's rows but for those of its parts; its inputs' contents must be referred to already."""
    ensure_owner(connection, job.owner)
    now = connection.scalar(sa.select(db.NowUs()))
    connection.execute(
        sa.insert(tables.jobs).values(
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
        connection.execute(sa.insert(tables.job_subjects), named)
    add_files(connection, job.id, job.inputs, tables.job_inputs)


def add_files(
    connection: sa.Connection,
    job: str,
    files: abc.Iterable[tables.FileRow],
    table: sa.Table = tables.job_files,
) -> None:
    """Say what a job made, or what it works on."""
    rows = [{"job": job, "path": f.name, "sha256": f.sha256, "size": f.size} for f in files]
    if rows:
        connection.execute(sa.insert(table), rows)


def find(connection: sa.Connection, job: str) -> tables.JobRow | None:
    """A job as this transaction sees it; None if there is none."""
    return find_first(connection, sa.select(*SHOWN).where(tables.jobs.c.id == job))


def lock(connection: sa.Connection, job: str, owner: str | None = None) -> tables.JobRow | None:
    """A job that nobody else can change before this write transaction ends; None if there is none."""
    statement = sa.select(*SHOWN).filter_by(id=job, **({} if owner is None else {"owner": owner}))
    return find_first(connection, statement.with_for_update())


def find_first(connection: sa.Connection, statement: sa.Select[Any], **values: str) -> tables.JobRow | None:
    """The one job that a statement finds, if any; ``values``: of its parameters."""
    found = connection.execute(statement, values).mappings().one_or_none()
    return None if found is None else tables.make_job_row(found)


def change(connection: sa.Connection, job: str, values: abc.Mapping[str, Any]) -> None:
    """Write columns of a job that is locked; its revision grows."""
    connection.execute(sa.update(tables.jobs).where(tables.jobs.c.id == job).values(_NOTED | dict(values)))


def get(database: db.Database, owner: str, job: str) -> tables.JobRow:
    """One job; NotFound where this owner has none of that name."""
    with database.read() as connection:
        found = find_first(connection, _ONE, job=job, owner=owner)
    if found is None:
        raise report_no_job(job)
    return found


def read_documents(database: db.Database, owner: str, job: str) -> tuple[str, str | None, str | None]:
    """A job's specification, result and provenance as JSON texts; NotFound as in :func:`get`."""
    wanted = sa.select(tables.jobs.c.specification, tables.jobs.c.result, tables.jobs.c.provenance)
    with database.read() as connection:
        found = connection.execute(
            wanted.where(tables.jobs.c.id == job, tables.jobs.c.owner == owner)
        ).one_or_none()
    if found is None:
        raise report_no_job(job)
    return found.specification, found.result, found.provenance


def list_files(database: db.Database, owner: str, job: str) -> list[tables.FileRow]:
    """What a job made, by path; NotFound as in :func:`get`."""
    get(database, owner, job)
    return _list_files_of(database, tables.job_files, job)


def list_inputs(database: db.Database, job: str) -> list[tables.FileRow]:
    """What a job was asked to work on, by path."""
    return _list_files_of(database, tables.job_inputs, job)


def report_no_job(job: str) -> NotFound:
    """The error for a job that this owner has not."""
    return NotFound(f"there is no job '{job[:64]}'", field="job", remedy="List the jobs")


def list_page(
    database: db.Database,
    owner: str,
    *,
    state: State | None = None,
    kind: str | None = None,
    subject: str | None = None,
    cursor: str | None = None,
    limit: int = 50,
) -> tables.Page[tables.JobRow]:
    """An owner's jobs, newest first, of one state, kind or subject where given."""
    if subject is None:
        order = (tables.jobs.c.created_us, tables.jobs.c.id)
        statement = sa.select(*SHOWN).where(tables.jobs.c.owner == owner)
    else:
        order = (tables.job_subjects.c.created_us, tables.job_subjects.c.job)
        statement = sa.select(*SHOWN).join(tables.job_subjects, tables.job_subjects.c.job == tables.jobs.c.id)
        statement = statement.where(
            tables.job_subjects.c.owner == owner, tables.job_subjects.c.subject == subject
        )
    if state is not None:
        statement = statement.where(tables.jobs.c.state == state.value)
    if kind is not None:
        statement = statement.where(tables.jobs.c.kind == kind)
    with database.read() as connection:
        return tables.read_page(connection, statement, order, cursor, limit, tables.make_job_row)


def count_by_state(database: db.Database) -> dict[State, int]:
    """Jobs of all owners by state, for monitoring."""
    with database.read() as connection:
        rows = connection.execute(
            sa.select(tables.jobs.c.state, sa.func.count()).group_by(tables.jobs.c.state)
        ).all()
    return dict.fromkeys(State, 0) | {State(state): number for state, number in rows}


def _list_files_of(database: db.Database, table: sa.Table, job: str) -> list[tables.FileRow]:
    wanted = sa.select(table.c.path, table.c.sha256, table.c.size).where(table.c.job == job)
    with database.read() as connection:
        return [tables.FileRow(*row) for row in connection.execute(wanted.order_by(table.c.path))]


def _is_queued(kinds: abc.Collection[str] | None) -> sa.ColumnElement[bool]:
    return _QUEUED if kinds is None else _QUEUED & tables.jobs.c.kind.in_(kinds)


def lock_next(
    connection: sa.Connection, kinds: abc.Collection[str] | None = None, without: abc.Collection[str] = ()
) -> tables.JobRow | None:
    """The next job, locked, of any kind or of some; None where nothing waits. ``without``: these owners.

    Owners take turns: first who has the fewest jobs running, then who was served longest ago. Among an
    owner's jobs, those that lost no worker come first, then those that were asked for by themselves, then
    the oldest: one that kills its workers does not hold up the others, nor does a batch.
    """
    # Owners with a queued job, the next to be served first.
    mine = tables.jobs.c.owner == tables.owners.c.name
    # LIMIT keeps it a look at an index for each owner; PostgreSQL makes EXISTS a scan of all waiting jobs.
    waits = (
        sa.select(tables.jobs.c.id)
        .where(mine, _is_queued(kinds))
        .limit(1)
        .correlate(tables.owners)
        .scalar_subquery()
    )
    running = sa.select(sa.func.count()).where(mine, _LEASED).correlate(tables.owners).scalar_subquery()
    wanted = sa.select(tables.owners.c.name).where(waits.is_not(None))
    waiting = wanted.order_by(running, tables.owners.c.served_us, tables.owners.c.name).where(
        tables.owners.c.name.not_in(without)
    )
    for owner in connection.scalars(waiting).all():
        oldest = (
            sa.select(*SHOWN)
            .where(tables.jobs.c.owner == owner, _is_queued(kinds))
            .order_by(tables.jobs.c.losses, tables.jobs.c.part, tables.jobs.c.created_us, tables.jobs.c.id)
            .limit(1)
            .with_for_update(skip_locked=True)
        )
        found = find_first(connection, oldest)
        if found is not None:
            connection.execute(
                sa.update(tables.owners).where(tables.owners.c.name == owner).values(served_us=db.NowUs())
            )
            return found
    return None


def has_queued_at_least(connection: sa.Connection, owner: str, number: int) -> bool:
    """Whether an owner has that many jobs queued or more."""
    some = sa.select(tables.jobs.c.id).where(tables.jobs.c.owner == owner, _QUEUED).limit(number)
    return (connection.scalar(sa.select(sa.func.count()).select_from(some.subquery())) or 0) >= number


def has_queued(
    database: db.Database, kinds: abc.Collection[str] | None = None, without: abc.Collection[str] = ()
) -> bool:
    """Whether a job waits, of any kind or of some, of any owner but these."""
    some = sa.select(tables.jobs.c.id).where(_is_queued(kinds), tables.jobs.c.owner.not_in(without)).limit(1)
    with database.read() as connection:
        return connection.scalar(some) is not None


def compute_lease_end(seconds: float) -> Any:
    """The moment so many seconds from now, by the database's clock."""
    return db.NowUs() + round(seconds * db.US_PER_S)


def lock_lost(connection: sa.Connection, dead: abc.Iterable[str]) -> list[tables.JobRow]:
    """Jobs, locked, that dead workers hold, or workers that did not renew their lease in time."""
    gone = sa.or_(tables.jobs.c.worker.in_(list(dead)), tables.jobs.c.lease_until_us < db.NowUs())
    wanted = sa.select(*SHOWN).where(_LEASED, gone).order_by(tables.jobs.c.id).with_for_update()
    return [tables.make_job_row(row) for row in connection.execute(wanted).mappings()]


def list_held(database: db.Database, worker: str) -> dict[str, tables.JobRow]:
    """The jobs that a worker holds."""
    with database.read() as connection:
        rows = connection.execute(sa.select(*SHOWN).where(tables.jobs.c.worker == worker, _LEASED)).mappings()
        return {row.id: row for row in map(tables.make_job_row, rows)}


def list_holders(database: db.Database) -> list[str]:
    """All workers that hold jobs."""
    with database.read() as connection:
        found = connection.scalars(sa.select(tables.jobs.c.worker).where(_LEASED).distinct())
        return [worker for worker in found if worker is not None]


def list_running_attempts(database: db.Database) -> set[tuple[str, int]]:
    """Every job and attempt that some worker holds."""
    with database.read() as connection:
        rows = connection.execute(sa.select(tables.jobs.c.id, tables.jobs.c.attempt).where(_LEASED))
        return {(row.id, row.attempt) for row in rows}


def renew(database: db.Database, worker: str, seconds: float) -> None:
    """Hold all of a worker's jobs for longer; those that it lost meanwhile stay lost."""
    held = sa.update(tables.jobs).where(tables.jobs.c.worker == worker, _LEASED)
    with database.write() as connection:
        connection.execute(held.values(lease_until_us=compute_lease_end(seconds)))


def explain_wait(database: db.Database, why: str) -> None:
    """Have all queued jobs say what they wait for."""
    queued = sa.update(tables.jobs).where(_QUEUED, tables.jobs.c.progress_what != why)
    with database.write() as connection:
        connection.execute(queued.values({"progress_what": why} | _NOTED))


def report(database: db.Database, worker: str, progress: abc.Iterable[tuple[str, int, float, str]]) -> None:
    """Write progress: job, attempt, share of the whole (0 to 1), what is being done."""
    running = sa.update(tables.jobs).where(
        tables.jobs.c.worker == worker, tables.jobs.c.state == State.RUNNING.value
    )
    with database.write() as connection:
        for job, attempt, share, what in progress:
            own = running.where(tables.jobs.c.id == job, tables.jobs.c.attempt == attempt)
            told = {"progress_share": share, "progress_what": what[:200]}
            connection.execute(own.values(told | _NOTED))
