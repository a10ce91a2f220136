"""Every change of a job, each in one transaction that follows the machine."""

from __future__ import annotations

from collections import abc
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection
from sqlalchemy.exc import IntegrityError

from scaling_service.core.errors import InputError
from scaling_service.documents.jobs import Failure, State
from scaling_service.service.jobs import machine
from scaling_service.service.store import blobs, jobs, parts, tables
from scaling_service.service.store.database import NowUs
from scaling_service.service.store.errors import report_needed
from scaling_service.service.store.store import Store

PARTS_SHARE = 0.95
"""Of a job that is made of others. Chosen: what is left to do when they are over takes seconds."""

WAITING = "waiting"  # what a job does that waits for nothing but its turn, or for others

_FRESH: abc.Mapping[str, Any] = {"finished_us": None, "started_us": None}  # of a job that is asked for again

_AGAIN = (State.FAILED, State.CANCELLED)  # asked for in one of these states, a job is queued again
_TRIES = 5
"""Of asking, before an error counts. Chosen: each needs another who asks for the same at the same moment."""


class QueueFull(InputError):
    """An owner has as many jobs waiting as are allowed."""


@dataclass(frozen=True, slots=True)
class AttemptOutput:
    """What an attempt made, ready to be kept: the result as JSON, path and content of each file."""

    result: str
    files: tuple[tuple[str, blobs.Content], ...] = ()


@dataclass(frozen=True, slots=True)
class Ledger:
    """The changes of jobs in a store."""

    store: Store
    most_losses: int
    lease_s: float

    def ask(
        self, make: abc.Callable[[Connection], jobs.NewJob], most_waiting: int
    ) -> tuple[tables.JobRow, bool]:
        """Make a job or find the one that there is, and whether it was put in the queue by this.

        One that failed or was cancelled is queued again. ``make`` reads what the job rests on within the
        transaction. QueueFull is raised where the owner has ``most_waiting`` jobs waiting.
        """
        for _ in range(_TRIES - 1):
            with suppress(IntegrityError):  # made by another, or a file replaced, since we read
                return self._ask(make, most_waiting)
        return self._ask(make, most_waiting)

    def _ask(
        self, make: abc.Callable[[Connection], jobs.NewJob], most_waiting: int
    ) -> tuple[tables.JobRow, bool]:
        with self.store.write() as connection:
            new = make(connection)
            row = jobs.find(connection, new.id)
            if row is not None and row.state not in _AGAIN:
                return row, False
            room_from = most_waiting - max(len(new.parts), 1) + 1
            if jobs.has_queued_at_least(connection, new.owner, room_from):
                raise QueueFull(
                    f"{most_waiting} jobs are waiting, which is the most",
                    remedy="Wait until some are done, or cancel some",
                )
            for part in sorted(new.parts, key=lambda job: job.id):  # locked before the whole, in this order
                member = jobs.lock(connection, part.id)
                if member is None:
                    jobs.add(connection, part, State.QUEUED.value, part=True)
                elif member.state in _AGAIN and not parts.is_counted_on(connection, part.id):
                    self._move(connection, member, machine.Event.ASK, _FRESH)
            row = jobs.lock(connection, new.id)
            if row is None:
                jobs.add(connection, new, State.QUEUED.value)
            elif row.state in _AGAIN:
                self._move(connection, row, machine.Event.ASK, _FRESH)
            else:  # somebody else asked meanwhile
                return row, False
            if new.parts:
                parts.link(connection, new.id, [part.id for part in new.parts])
                # Let a job that is queued wait for its parts, unless they are over
                stored = _require_existing(connection, new.id)
                over, count = parts.count_ended(connection, stored.id)
                if over < count:
                    self._move(connection, stored, machine.Event.WAIT, _sum_progress(over, count))
            return _require_existing(connection, new.id), True

    def lease(
        self,
        worker: str,
        host: str,
        kinds: abc.Collection[str] | None = None,
        without: abc.Collection[str] = (),
    ) -> tables.JobRow | None:
        """Take the next job, of any kind or of some, of no owner ``without``; None where nothing waits."""
        with self.store.write() as connection:
            row = jobs.lock_next(connection, kinds, without)
            if row is None:
                return None
            begun = {
                "worker": worker,
                "host": host,
                "lease_until_us": jobs.compute_lease_end(self.lease_s),
                "started_us": NowUs(),
                "progress_what": "starting",
            }
            self._move(connection, row, machine.Event.LEASE, begun)
            return jobs.lock(connection, row.id)

    def finish(self, held: tables.JobRow, made: AttemptOutput, provenance: str) -> State | None:
        """Keep a result, all of it or nothing; None where the job is no longer ours."""
        with self.store.write() as connection:
            row = self._lock_if_held(connection, held)
            if row is None:
                return None
            if row.state is State.CANCELLING:
                return self._move(connection, row, machine.Event.FINISH)
            blobs.keep(connection, self.store.blobs, [content for _, content in made.files])
            files = [tables.FileRow(path, content.sha256, content.size) for path, content in made.files]
            jobs.add_files(connection, row.id, files)
            parts.take_files(connection, row.id)
            done = {"result": made.result, "provenance": provenance}
            progress = {"progress_share": 1.0, "progress_what": "done"}
            return self._move(connection, row, machine.Event.FINISH, done | progress)

    def settle(
        self, held: tables.JobRow, event: machine.Event, failure: Failure, provenance: str | None
    ) -> State | None:
        """Record an attempt that ended without a result; None where the job is no longer ours.

        The failure is kept where the job ends as failed by this.
        """
        with self.store.write() as connection:
            row = self._lock_if_held(connection, held)
            if row is None:
                return None
            if event is machine.Event.RELEASE and row.state is State.CANCELLING:
                event = machine.Event.STOP
            return self._move(connection, row, event, _list_failure_columns(failure, provenance))

    def cancel(self, owner: str, job: str) -> tables.JobRow:
        """Wish that a job ends; one that is over stays as it is.

        NotFound where this owner has no such job, InUse where it is a part of one that is not over.
        """
        with self.store.write() as connection:
            made_of = [jobs.lock(connection, part) for part in parts.of(connection, [job])]
            row = jobs.lock(connection, job, owner)
            if row is None:
                raise jobs.report_no_job(job)
            if _is_active(row):
                if parts.is_needed(connection, job):
                    raise report_needed(job)
                self._move(connection, row, machine.Event.CANCEL)
                for part in made_of:
                    if part is not None and _is_active(part) and not parts.is_needed(connection, part.id):
                        self._move(connection, part, machine.Event.CANCEL)
            return _require_existing(connection, job)

    def take_back(self, dead: abc.Iterable[str] = ()) -> list[str]:
        """Queue jobs again whose worker is lost: its lease ran out, or it is known to be dead; these jobs."""
        with self.store.write() as connection:
            taken = jobs.lock_lost(connection, dead)
            for row in taken:
                why = _list_failure_columns(report_worker_lost(row, "its worker ended"), None)
                self._move(connection, row, machine.Event.LOSE, why)
        return [row.id for row in taken]

    def _lock_if_held(self, connection: Connection, held: tables.JobRow) -> tables.JobRow | None:
        """The job, locked, if this very attempt still holds it."""
        row = jobs.lock(connection, held.id)
        if row is None or (row.attempt, row.worker) != (held.attempt, held.worker):
            return None
        return row if row.state.is_leased else None

    def _move(
        self,
        connection: Connection,
        row: tables.JobRow,
        event: machine.Event,
        values: abc.Mapping[str, Any] | None = None,
    ) -> State:
        """Write where a locked job stands after an event, with all that changes with it."""
        new = machine.follow_event(
            machine.Standing(row.state, row.attempt, row.losses), event, self.most_losses
        )
        written: dict[str, Any] = dict(values or {})
        written |= {"state": new.state.value, "attempt": new.attempt, "losses": new.losses}
        if not new.state.is_leased:
            written |= {"worker": None, "lease_until_us": None}
        if new.state.is_over:
            written["finished_us"] = NowUs()
        if new.state is State.QUEUED:
            _, count = parts.count_ended(connection, row.id)
            share = PARTS_SHARE if count else 0.0
            written |= {"progress_share": share, "progress_what": WAITING, "provenance": None}
        if new.state is not State.FAILED:
            written["failure"] = None
        jobs.change(connection, row.id, written)
        if new.state.is_over:
            self._update_wholes(connection, row.id, new.state)
        return new.state

    def _update_wholes(self, connection: Connection, part: str, state: State) -> None:
        """A part is over: count again, and let go on what waited for the last one."""
        waiting = parts.list_waiting(connection, part)
        if waiting and state is State.CANCELLED:  # with another whole, just before this one was asked for
            self._move(connection, _require_existing(connection, part), machine.Event.ASK, _FRESH)
            return
        for whole in waiting:
            row = jobs.lock(connection, whole)
            if row is None or row.state is not State.WAITING:
                continue
            over, count = parts.count_ended(connection, whole)
            if over == count:
                self._move(connection, row, machine.Event.READY)
            else:
                jobs.change(connection, whole, _sum_progress(over, count))


def report_worker_lost(row: tables.JobRow, reason: str) -> Failure:
    """Why a job fails that lost its last worker."""
    return Failure(
        kind="WorkerLost",
        problem=f"the process that computed was lost {row.losses + 1} times; the last time: {reason}",
        remedy="Look at the machine's memory and disk, then ask for the job again",
    )


def _require_existing(connection: Connection, job: str) -> tables.JobRow:
    """A job that is there, for it was made or locked in this transaction."""
    row = jobs.find(connection, job)
    assert row is not None
    return row


def _is_active(row: tables.JobRow) -> bool:
    return not (row.state.is_over or row.state is State.CANCELLING)


def _sum_progress(over: int, count: int) -> dict[str, Any]:
    return {"progress_share": PARTS_SHARE * over / count, "progress_what": f"{over} of {count} ended"}


def _list_failure_columns(failure: Failure, provenance: str | None) -> dict[str, Any]:
    return {"failure": failure.model_dump_json(), "provenance": provenance}
