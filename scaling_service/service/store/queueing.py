"""Which job is next, whose lease ran out, who holds what."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any

from sqlalchemy import ColumnElement, Connection, Select, func, or_, select, update

from scaling_service.documents.jobs import State
from scaling_service.service.store.database import US_PER_S, Database, NowUs
from scaling_service.service.store.jobs import SHOWN, find_first
from scaling_service.service.store.tables import JobRow, jobs, make_job_row, owners

_LEASED = jobs.c.state.in_([state.value for state in State if state.is_leased])
_QUEUED = jobs.c.state == State.QUEUED.value


def _is_queued(kinds: Collection[str] | None) -> ColumnElement[bool]:
    return _QUEUED if kinds is None else _QUEUED & jobs.c.kind.in_(kinds)


def lock_next(connection: Connection, kinds: Collection[str] | None = None) -> JobRow | None:
    """The next job, locked, of any kind or of some; None where nothing waits.

    Owners take turns: first who has the fewest jobs running, then who was served longest ago. Among an
    owner's jobs, those that lost no worker come first, then those that were asked for by themselves, then
    the oldest: one that kills its workers does not hold up the others, nor does a batch.
    """
    for owner in connection.scalars(_select_waiting(kinds)).all():
        oldest = (
            select(*SHOWN)
            .where(jobs.c.owner == owner, _is_queued(kinds))
            .order_by(jobs.c.losses, jobs.c.part, jobs.c.created_us, jobs.c.id)
            .limit(1)
            .with_for_update(skip_locked=True)
        )
        found = find_first(connection, oldest)
        if found is not None:
            connection.execute(update(owners).where(owners.c.name == owner).values(served_us=NowUs()))
            return found
    return None


def _select_waiting(kinds: Collection[str] | None) -> Select[tuple[str]]:
    """Owners with a queued job, the next to be served first."""
    mine = jobs.c.owner == owners.c.name
    # LIMIT keeps it a look at an index for each owner; PostgreSQL makes EXISTS a scan of all waiting jobs.
    waits = select(jobs.c.id).where(mine, _is_queued(kinds)).limit(1).correlate(owners).scalar_subquery()
    running = select(func.count()).where(mine, _LEASED).correlate(owners).scalar_subquery()
    wanted = select(owners.c.name).where(waits.is_not(None))
    return wanted.order_by(running, owners.c.served_us, owners.c.name)


def has_queued_at_least(connection: Connection, owner: str, number: int) -> bool:
    """Whether an owner has that many jobs queued or more."""
    some = select(jobs.c.id).where(jobs.c.owner == owner, _QUEUED).limit(number)
    return (connection.scalar(select(func.count()).select_from(some.subquery())) or 0) >= number


def has_queued(database: Database, kinds: Collection[str] | None = None) -> bool:
    """Whether a job waits, of any kind or of some."""
    with database.read() as connection:
        return connection.scalar(select(jobs.c.id).where(_is_queued(kinds)).limit(1)) is not None


def compute_lease_end(seconds: float) -> Any:
    """The moment so many seconds from now, by the database's clock."""
    return NowUs() + round(seconds * US_PER_S)


def lock_lost(connection: Connection, dead: Iterable[str]) -> list[JobRow]:
    """Jobs, locked, that dead workers hold, or workers that did not renew their lease in time."""
    gone = or_(jobs.c.worker.in_(list(dead)), jobs.c.lease_until_us < NowUs())
    wanted = select(*SHOWN).where(_LEASED, gone).order_by(jobs.c.id).with_for_update()
    return [make_job_row(row) for row in connection.execute(wanted).mappings()]


def list_held(database: Database, worker: str) -> dict[str, JobRow]:
    """The jobs that a worker holds."""
    with database.read() as connection:
        rows = connection.execute(select(*SHOWN).where(jobs.c.worker == worker, _LEASED)).mappings()
        return {row.id: row for row in map(make_job_row, rows)}


def list_holders(database: Database) -> list[str]:
    """All workers that hold jobs."""
    with database.read() as connection:
        found = connection.scalars(select(jobs.c.worker).where(_LEASED).distinct())
        return [worker for worker in found if worker is not None]


def list_running_attempts(database: Database) -> set[tuple[str, int]]:
    """Every job and attempt that some worker holds."""
    with database.read() as connection:
        rows = connection.execute(select(jobs.c.id, jobs.c.attempt).where(_LEASED))
        return {(row.id, row.attempt) for row in rows}


def renew(database: Database, worker: str, seconds: float) -> None:
    """Hold all of a worker's jobs for longer; those that it lost meanwhile stay lost."""
    held = update(jobs).where(jobs.c.worker == worker, _LEASED)
    with database.write() as connection:
        connection.execute(held.values(lease_until_us=compute_lease_end(seconds)))


def explain_wait(database: Database, why: str) -> None:
    """Have all queued jobs say what they wait for."""
    queued = update(jobs).where(jobs.c.state == State.QUEUED.value, jobs.c.progress_what != why)
    with database.write() as connection:
        connection.execute(queued.values(progress_what=why, updated_us=NowUs(), revision=jobs.c.revision + 1))


def report(database: Database, worker: str, progress: Iterable[tuple[str, int, float, str]]) -> None:
    """Write progress: job, attempt, share of the whole (0 to 1), what is being done."""
    running = update(jobs).where(jobs.c.worker == worker, jobs.c.state == State.RUNNING.value)
    with database.write() as connection:
        for job, attempt, share, what in progress:
            connection.execute(
                running.where(jobs.c.id == job, jobs.c.attempt == attempt).values(
                    progress_share=share,
                    progress_what=what[:200],
                    updated_us=NowUs(),
                    revision=jobs.c.revision + 1,
                )
            )
