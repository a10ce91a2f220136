"""Every change of a job, each in one transaction that follows the machine."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection
from sqlalchemy.exc import IntegrityError

from scaling_service.core.errors import InputError
from scaling_service.runner.machine import Event, Standing, after
from scaling_service.schemas.jobs import Failure, State
from scaling_service.store import jobs, listing, queueing, references
from scaling_service.store.blobs import Content
from scaling_service.store.clock import NowUs
from scaling_service.store.rows import FileRow, JobRow
from scaling_service.store.store import Store


class QueueFull(InputError):
    """An owner has as many jobs waiting as are allowed."""


@dataclass(frozen=True, slots=True)
class Made:
    """What an attempt made, ready to be kept.

    Parameters
    ----------
    result : str
        JSON.
    files : tuple of (str, Content)
        Path and content of each file.
    """

    result: str
    files: tuple[tuple[str, Content], ...] = ()


@dataclass(frozen=True, slots=True)
class Ledger:
    """The changes of jobs in a store.

    Parameters
    ----------
    store : Store
    most_losses : int
    lease_s : float
    """

    store: Store
    most_losses: int
    lease_s: float

    def ask(self, make: Callable[[Connection], jobs.NewJob], most_waiting: int) -> tuple[JobRow, bool]:
        """Make a job, or find the one that there is; one that failed or was cancelled is queued again.

        Parameters
        ----------
        make : callable
            Reads what the job rests on within the transaction.
        most_waiting : int

        Returns
        -------
        row : JobRow
        queued : bool
            Whether it was put in the queue by this.

        Raises
        ------
        QueueFull
            The owner has too many jobs waiting.
        """
        try:
            return self._ask(make, most_waiting)
        except IntegrityError:  # made by another, or a file replaced, between our reading and writing
            return self._ask(make, most_waiting)

    def _ask(self, make: Callable[[Connection], jobs.NewJob], most_waiting: int) -> tuple[JobRow, bool]:
        with self.store.write() as connection:
            new = make(connection)
            row = jobs.locked(connection, new.id, new.owner)
            if row is not None and row.state not in (State.FAILED, State.CANCELLED):
                return row, False
            if listing.waiting_at_least(connection, new.owner, most_waiting):
                raise QueueFull(
                    f"{most_waiting} jobs are waiting, which is the most",
                    remedy="Wait until some are done, or cancel some",
                )
            if row is None:
                jobs.add(connection, new, State.QUEUED.value)
            else:
                self._move(connection, row, Event.ASK, _FRESH)
            found = jobs.locked(connection, new.id)
            assert found is not None
            return found, True

    def lease(self, worker: str, host: str) -> JobRow | None:
        """Take the next job; None where nothing waits."""
        with self.store.write() as connection:
            row = queueing.next_queued(connection)
            if row is None:
                return None
            begun = {
                "worker": worker,
                "host": host,
                "lease_until_us": queueing.lease_end(self.lease_s),
                "started_us": NowUs(),
                "progress_share": 0.0,
                "progress_what": "starting",
            }
            self._move(connection, row, Event.LEASE, begun)
            return jobs.locked(connection, row.id)

    def finish(self, held: JobRow, made: Made, provenance: str) -> State | None:
        """Keep a result, all of it or nothing; None where the job is no longer ours."""
        with self.store.write() as connection:
            row = self._ours(connection, held)
            if row is None:
                return None
            if row.state is State.CANCELLING:
                return self._move(connection, row, Event.FINISH, {})
            references.keep(connection, self.store.blobs, [content for _, content in made.files])
            files = [FileRow(path, content.sha256, content.size) for path, content in made.files]
            jobs.add_files(connection, row.id, files)
            done = {
                "result": made.result,
                "provenance": provenance,
                "progress_share": 1.0,
                "progress_what": "done",
            }
            return self._move(connection, row, Event.FINISH, done)

    def settle(self, held: JobRow, event: Event, failure: Failure, provenance: str | None) -> State | None:
        """Record an attempt that ended without a result; None where the job is no longer ours.

        Parameters
        ----------
        failure : Failure
            Kept where the job ends as failed by this.
        """
        with self.store.write() as connection:
            row = self._ours(connection, held)
            if row is None:
                return None
            if event is Event.RELEASE and row.state is State.CANCELLING:
                event = Event.STOP
            return self._move(connection, row, event, _why(failure, provenance))

    def cancel(self, owner: str, job: str) -> JobRow:
        """Wish that a job ends; one that is over stays as it is.

        Raises
        ------
        NotFound
            This owner has no such job.
        """
        with self.store.write() as connection:
            row = jobs.locked(connection, job, owner)
            if row is None:
                raise jobs.no_job(job)
            if not (row.state.is_over or row.state is State.CANCELLING):
                self._move(connection, row, Event.CANCEL, {})
            found = jobs.locked(connection, job)
            assert found is not None
            return found

    def take_back(self, dead: Iterable[str] = ()) -> list[str]:
        """Queue jobs again whose worker is lost: its lease ran out, or it is known to be dead.

        Returns
        -------
        list of str
            The jobs.
        """
        gone = set(dead)
        taken: list[str] = []
        with self.store.write() as connection:
            for job in [*queueing.held_by(connection, gone), *queueing.expired(connection)]:
                row = jobs.locked(connection, job)
                # Looked at again now that nobody can change it: it may have been renewed since.
                if row is not None and (row.worker in gone or queueing.is_expired(connection, row)):
                    why = _why(lost_too_often(row, "its worker ended"), None)
                    self._move(connection, row, Event.LOSE, why)
                    taken.append(job)
        return taken

    def _ours(self, connection: Connection, held: JobRow) -> JobRow | None:
        """The job, locked, if this very attempt still holds it."""
        row = jobs.locked(connection, held.id)
        fenced = row is not None and (row.attempt, row.worker) == (held.attempt, held.worker)
        return row if fenced and row is not None and row.state.is_leased else None

    def _move(self, connection: Connection, row: JobRow, event: Event, values: Mapping[str, Any]) -> State:
        """Write where a job stands after an event, with what belongs to its new state."""
        new = after(Standing(row.state, row.attempt, row.losses), event, self.most_losses)
        written = {"state": new.state.value, "attempt": new.attempt, "losses": new.losses} | dict(values)
        if not new.state.is_leased:
            written |= {"worker": None, "lease_until_us": None}
        if new.state.is_over:
            written["finished_us"] = NowUs()
        if new.state is State.QUEUED:
            written |= {"progress_share": 0.0, "progress_what": "waiting", "provenance": None}
        if new.state is not State.FAILED:
            written["failure"] = None
        jobs.change(connection, row.id, written)
        return new.state


_FRESH: Mapping[str, Any] = {"finished_us": None, "started_us": None}


def lost_too_often(row: JobRow, reason: str) -> Failure:
    """Why a job fails that lost its last worker."""
    return Failure(
        kind="WorkerLost",
        problem=f"the process that computed was lost {row.losses + 1} times; the last time: {reason}",
        remedy="Look at the machine's memory and disk, then ask for the job again",
    )


def _why(failure: Failure, provenance: str | None) -> dict[str, Any]:
    return {"failure": failure.model_dump_json(), "provenance": provenance}
