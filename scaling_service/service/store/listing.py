"""Lists and counts of jobs, quick with a hundred thousand of them."""

from __future__ import annotations

from sqlalchemy import Connection, func, select

from scaling_service.documents.jobs import State
from scaling_service.service.store.database import Database
from scaling_service.service.store.jobs import SHOWN
from scaling_service.service.store.paging import Page, cursor_of, newest_first
from scaling_service.service.store.rows import JobRow, job_row
from scaling_service.service.store.tables import job_subjects, jobs


def page(
    database: Database,
    owner: str,
    *,
    state: State | None = None,
    kind: str | None = None,
    subject: str | None = None,
    cursor: str | None = None,
    limit: int = 50,
) -> Page[JobRow]:
    """An owner's jobs, newest first, of one state, kind or subject where given.

    Raises
    ------
    InputError
        The cursor or the limit cannot be used.
    """
    statement, created, key = select(*SHOWN), jobs.c.created_us, jobs.c.id
    if subject is not None:
        statement = statement.join(job_subjects, job_subjects.c.job == jobs.c.id)
        statement = statement.where(job_subjects.c.owner == owner, job_subjects.c.subject == subject)
        created, key = job_subjects.c.created_us, job_subjects.c.job
    else:
        statement = statement.where(jobs.c.owner == owner)
    if state is not None:
        statement = statement.where(jobs.c.state == state.value)
    if kind is not None:
        statement = statement.where(jobs.c.kind == kind)
    with database.read() as connection:
        found = connection.execute(newest_first(statement, created, key, cursor, limit)).mappings()
        rows = [job_row(row) for row in found]
    shown = tuple(rows[:limit])
    more = len(rows) > limit
    return Page(shown, cursor_of(shown[-1].created_us, shown[-1].id) if more else None)


def counts(database: Database) -> dict[State, int]:
    """Jobs of all owners by state, for monitoring."""
    with database.read() as connection:
        rows = connection.execute(select(jobs.c.state, func.count()).group_by(jobs.c.state)).all()
    return dict.fromkeys(State, 0) | {State(state): number for state, number in rows}


def waiting_at_least(connection: Connection, owner: str, number: int) -> bool:
    """Whether an owner has that many jobs queued or more."""
    some = select(jobs.c.id).where(jobs.c.owner == owner, jobs.c.state == State.QUEUED.value).limit(number)
    return (connection.scalar(select(func.count()).select_from(some.subquery())) or 0) >= number
