"""Deleting for good: rows, files, what is in scratch, and what the database still holds of them.

SQLite overwrites deleted rows (``secure_delete``), and its write-ahead log is emptied after each
deletion. PostgreSQL's dead rows are vacuumed; its own log and backups keep them for as long as they are
kept. Blocks that a file system has freed are the disk's business: encrypt it.
"""

from __future__ import annotations

import shutil
import time
from collections import abc

import sqlalchemy as sa

from scaling_service.service.store import database as db
from scaling_service.service.store import errors, parts, tables
from scaling_service.service.store.blobs import Blobs, remove_unreferenced
from scaling_service.service.store.jobs import report_no_job
from scaling_service.service.store.subjects import is_subject, list_files_in, report_no_subject

_AT_ONCE = 200  # jobs deleted in one transaction. Chosen: others wait for some ms only.
_DAY_S = 86_400
_PATIENCE_S = 2.0
"""How long readers of the log are waited for. Chosen: every reading transaction is far shorter."""

_TABLES = (
    "jobs",
    "job_subjects",
    "job_parts",
    "subjects",
    "blobs",
    *(table.name for table in tables.REFERENCES),
)


def delete_job(database: db.Database, blobs: Blobs, owner: str, job: str) -> None:
    """Delete a job with all that it made, and what it alone is made of; workers notice and stop.

    NotFound where this owner has no such job, InUse where it is a part of one that is not over.
    """
    with database.write() as connection:
        mine = (
            sa.select(tables.jobs.c.id)
            .where(tables.jobs.c.id == job, tables.jobs.c.owner == owner)
            .with_for_update()
        )
        found = list(connection.scalars(mine))
        if not found:
            raise report_no_job(job)
        if parts.is_needed(connection, job):
            raise errors.report_needed(job)
        gone, digests = _delete_jobs(connection, found)
    erase(database, blobs, gone, digests)


def delete_subject(database: db.Database, blobs: Blobs, owner: str, identity: str) -> None:
    """Delete a subject, its files, and every job that rests on its data; NotFound where there is none.

    Where the disk has no room to do so at once, it is done in steps, each of which makes room for the next.
    """
    try:
        with database.write() as connection:
            found, digests = _delete_subject(connection, owner, identity)
    except errors.StoreFull:
        _delete_jobs_singly(database, blobs, owner, identity)
        with database.write() as connection:
            found, digests = _delete_subject(connection, owner, identity)
    erase(database, blobs, found, digests)


def _delete_jobs_singly(database: db.Database, blobs: Blobs, owner: str, identity: str) -> None:
    resting = (tables.job_subjects.c.owner == owner) & (tables.job_subjects.c.subject == identity)
    with database.read() as connection:
        # Wholes before their parts, which go with them.
        wanted = (
            sa.select(tables.jobs.c.id)
            .join(tables.job_subjects, tables.job_subjects.c.job == tables.jobs.c.id)
            .where(resting)
        )
        found = list(connection.scalars(wanted.order_by(tables.jobs.c.part, tables.jobs.c.id)))
    for job in found:
        with database.write() as connection:
            gone, digests = _delete_jobs(connection, [job])
        erase(database, blobs, gone, digests)


def expire(database: db.Database, blobs: Blobs, days: float) -> tuple[int, int]:
    """Delete jobs that ended longer ago than so many days, and subjects untouched for as long; how many.

    A subject on whose data a kept job rests stays, and so does what a kept job is made of.
    """
    before = db.NowUs() - round(days * _DAY_S * db.US_PER_S)
    over = tables.jobs.c.state.in_(parts.OVER)
    old_jobs = sa.select(tables.jobs.c.id).where(
        over, tables.jobs.c.finished_us < before, tables.jobs.c.part == 0
    )
    used = sa.exists().where(
        tables.job_subjects.c.owner == tables.subjects.c.owner,
        tables.job_subjects.c.subject == tables.subjects.c.id,
    )
    old_subjects = sa.select(tables.subjects.c.owner, tables.subjects.c.id).where(
        tables.subjects.c.updated_us < before, ~used
    )
    gone_jobs, found = 0, [""]
    while found:
        with database.write() as connection:
            found = list(connection.scalars(old_jobs.limit(_AT_ONCE).with_for_update()))
            gone, digests = _delete_jobs(connection, found)
        if found:
            erase(database, blobs, gone, digests)
            gone_jobs += len(gone)
    with database.write() as connection:
        stale = connection.execute(old_subjects.with_for_update()).all()
        digests = [d for owner, identity in stale for d in _delete_subject(connection, owner, identity)[1]]
    if stale:
        erase(database, blobs, (), digests)
    return gone_jobs, len(stale)


def erase(database: db.Database, blobs: Blobs, gone: abc.Iterable[str], digests: abc.Iterable[str]) -> None:
    """After rows were deleted: remove scratch and contents of theirs, and their traces in the database."""
    for job in gone:
        for folder in blobs.work.glob(f"{job}.*"):
            shutil.rmtree(folder, ignore_errors=True)
    remove_unreferenced(database, blobs, digests)
    remove_traces(database)


def remove_traces(database: db.Database) -> bool:
    """Overwrite what deleted rows left behind; whether nothing is left.

    SQLite's log cannot be emptied while another program reads an old state of it; call it again then.
    """
    if not database.is_sqlite:
        database.run_apart(*(f"VACUUM {name}" for name in _TABLES))
        return True
    end = time.monotonic() + _PATIENCE_S
    while True:
        (busy,) = database.run_apart("PRAGMA wal_checkpoint(TRUNCATE)")
        if not busy or time.monotonic() > end:
            return not busy
        time.sleep(0.02)


def _delete_subject(connection: sa.Connection, owner: str, identity: str) -> tuple[list[str], list[str]]:
    """The jobs that went with it, and the contents that nothing of it refers to any more."""
    mine = is_subject(owner, identity)
    if connection.scalar(sa.select(tables.subjects.c.id).where(mine).with_for_update()) is None:
        raise report_no_subject(identity)
    resting = (tables.job_subjects.c.owner == owner) & (tables.job_subjects.c.subject == identity)
    found = list(connection.scalars(sa.select(tables.job_subjects.c.job).where(resting)))
    gone, digests = _delete_jobs(connection, found)
    digests += (file.sha256 for file in list_files_in(connection, owner, identity))
    connection.execute(sa.delete(tables.subjects).where(mine))
    return gone, digests


def _delete_jobs(connection: sa.Connection, found: abc.Sequence[str]) -> tuple[list[str], list[str]]:
    """Delete rows of jobs and of parts that belonged to them alone; all these, and what they referred to."""
    gone, digests = list(found), list[str]()
    while found:
        made_of: list[str] = []
        for k in range(0, len(found), _AT_ONCE):
            some = found[k : k + _AT_ONCE]
            made_of += parts.of(connection, some)
            referred = (
                sa.select(t.c.sha256).where(t.c.job.in_(some)) for t in (tables.job_inputs, tables.job_files)
            )
            digests += connection.scalars(sa.union(*referred))
            connection.execute(sa.delete(tables.jobs).where(tables.jobs.c.id.in_(some)))
        found = parts.list_unneeded(connection, made_of)
        gone += found
    return gone, digests
