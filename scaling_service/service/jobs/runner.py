"""Takes queued jobs and looks after them, whatever the store does meanwhile; keeps what they made."""

from __future__ import annotations

import dataclasses
import fcntl
import json
import logging
import os
import secrets
import socket
import threading
import time
from collections import abc
from concurrent import futures
from contextlib import suppress
from pathlib import Path
from typing import IO

from scaling_service.documents.jobs import Failure, State
from scaling_service.service.jobs import attempts, ledger, submission
from scaling_service.service.jobs.kinds import KINDS, Kind
from scaling_service.service.jobs.machine import Event
from scaling_service.service.jobs.settings import ServiceSettings
from scaling_service.service.sandbox import outcomes
from scaling_service.service.store import deletion, errors, jobs
from scaling_service.service.store.blobs import Content
from scaling_service.service.store.store import Store
from scaling_service.service.store.tables import JobRow

log = logging.getLogger(__name__)

_BOOT = Path("/proc/sys/kernel/random/boot_id")

TICK_S = 0.1
"""Between two looks at everything. Chosen: quick for a person, a few short statements for the database."""

TIDY_S = 600.0  # between two rounds of tidying. Chosen: rubbish is rare and does no harm.
_LONGEST_PAUSE_S = 5.0
"""Between two tries while the store does not answer. Chosen: it is used soon after it is back."""

_ENDING_S = 20.0
"""How long the end waits for the processes that it stopped. Chosen: they are killed, so it takes a moment."""

_RENEWALS = 3  # of a lease within its time: two may fail without harm

_UNKNOWN = Failure(
    kind="WorkerMismatch",
    problem="this version of the program cannot do this kind of job",
    remedy="Install the same version everywhere, then ask for the job again",
)


@dataclasses.dataclass(slots=True, kw_only=True)
class RunningAttempt:
    """An attempt that a runner looks after, of a job as it was leased."""

    row: JobRow
    order: attempts.Order
    folder: attempts.AttemptFolder
    future: futures.Future[outcomes.Outcome]
    beside: bool  # whether it runs beside the workers, in its owner's slot for what is brief
    begun: float = dataclasses.field(default_factory=time.monotonic)


class Runner:
    """One runner; any number may share a store.

    DependencyMissing is raised where the executor that the settings ask for is not installed.
    """

    def __init__(
        self,
        store: Store,
        settings: ServiceSettings,
        *,
        kinds: abc.Mapping[str, Kind] = KINDS,
        make_executor: attempts.MakeExecutor | None = None,
    ) -> None:
        self._store, self._settings, self._kinds = store, settings, kinds
        self._brief = [name for name, kind in kinds.items() if kind.brief]
        self._make_executor = make_executor or attempts.choose_executor(settings)
        self._ledger = ledger.Ledger(store, settings.most_losses, settings.lease_s)
        self._lock = RunnerLock(store.blobs.folder)
        self._executor: futures.Executor | None = None
        self._held: dict[str, RunningAttempt] = {}
        self._stop, self._wake = threading.Event(), threading.Event()
        self._renewed = self._looked_for_lost = self._take_back_from = float("-inf")
        self._pause_s = 0.0
        self._lacks_room = False

    @property
    def name(self) -> str:
        """How it is called in the store."""
        return self._lock.name

    def stop(self) -> None:
        """Have :meth:`run` end soon; from any thread or signal handler."""
        self._stop.set()
        self._wake.set()

    def run(self) -> None:
        """Work until asked to stop; then give back what is not finished.

        Whatever happens to the database or the disk, it goes on when they are there again.
        """
        log.info("runner started", extra={"runner": self.name, "code_version": submission.code_version()})
        tidying = threading.Thread(target=self._tidy, name="tidy", daemon=True)
        tidying.start()
        try:
            while not self._stop.is_set():
                for held in self._held.values():
                    held.folder.touch_heartbeat()
                try:
                    now = time.monotonic()
                    often = self._settings.lease_s / _RENEWALS
                    if self._held and now - self._renewed > often:
                        jobs.renew(self._store.database, self.name, self._settings.lease_s)
                        self._renewed = now
                    self._stop_and_report()
                    self._end_finished()
                    if now - self._looked_for_lost > min(often, 1.0) and now >= self._take_back_from:
                        # Queue again what dead runners held.
                        dead = self._lock.dead(jobs.list_holders(self._store.database))
                        for job in self._ledger.take_back(dead):
                            log.warning("job taken back", extra={"job": job})
                        self._looked_for_lost = now
                    self._executor = self._executor or self._make_executor()
                    self._start_queued(self._executor)
                    self._pause_s = 0.0
                except errors.StoreUnavailable as error:
                    longest = min(_LONGEST_PAUSE_S, self._settings.lease_s / 4)
                    self._pause_s = min(max(2 * self._pause_s, TICK_S), longest)
                    # Every runner gets the time to renew its leases before anyone takes jobs back.
                    self._take_back_from = time.monotonic() + self._settings.lease_s
                    log.warning("the store is not available", extra={"reason": error.problem})
                self._wake.wait(self._pause_s or TICK_S)
                self._wake.clear()
            # Stop all work; jobs that are not finished are queued again as good as new.
            for kept in self._held.values():
                kept.future.cancel()
                kept.folder.stop()
            futures.wait([kept.future for kept in self._held.values()], timeout=_ENDING_S)
            with suppress(errors.StoreUnavailable):  # then the leases run out
                self._end_finished()
        finally:
            self._lock.close()
            if self._executor is not None:
                self._executor.shutdown(wait=False)  # nothing is left in it
            tidying.join(timeout=_ENDING_S)
        log.info("runner stopped", extra={"runner": self.name})

    def _stop_and_report(self) -> None:
        """Stop what is no longer wanted, and pass progress on."""
        rows = jobs.list_held(self._store.database, self.name)
        for job, held in self._held.items():
            row = rows.get(job)
            wanted = row is not None and row.attempt == held.row.attempt and row.state is State.RUNNING
            if not wanted and not held.future.done():
                held.future.cancel()
                held.folder.stop()
        for job in rows.keys() - self._held.keys():  # the store went away right after the lease
            self._ledger.settle(rows[job], Event.RELEASE, _UNKNOWN, None)
        progress = [
            (job, held.row.attempt, news[1], news[0])
            for job, held in self._held.items()
            if (news := held.folder.read_progress()) is not None
        ]
        if progress:
            jobs.report(self._store.database, self.name, progress)

    def _end_finished(self) -> None:
        """Record what has ended; what cannot be recorded now does not hold up the rest."""
        trouble: errors.StoreUnavailable | None = None
        for job, held in list(self._held.items()):
            if held.future.done():
                try:
                    self._settle(held)
                except errors.StoreUnavailable as error:
                    trouble = error
                    continue
                except Exception as error:
                    log.exception("the outcome of a job cannot be recorded", extra={"job": job})
                    lost = ledger.report_worker_lost(
                        held.row, f"its result cannot be kept ({type(error).__name__})"
                    )
                    self._ledger.settle(held.row, Event.LOSE, lost, None)
                    held.folder.remove()
                del self._held[job]
        if trouble is not None:
            raise trouble

    def _settle(self, held: RunningAttempt) -> None:
        """Record how an attempt ended, and remove its folder; StoreUnavailable says that nothing was kept."""
        outcome, wall_s = read_outcome(held.future), time.monotonic() - held.begun
        try:
            state = self._record(held, outcome, wall_s)
        except errors.ContentMissing as error:  # somebody else removed what was made
            outcome = outcomes.Lost(error.problem)
            state = self._record(held, outcome, wall_s)
        # One line for the log, without anything of the patient's.
        entry = {
            "job": held.row.id,
            "kind": held.row.kind,
            "attempt": held.row.attempt,
            "outcome": type(outcome).__name__,
            "state": None if state is None else state.value,
            "wall_s": round(wall_s, 3),
        }
        if isinstance(outcome, outcomes.Failed):
            entry |= {"failure": outcome.failure.kind, "trace": outcome.trace}
        if isinstance(outcome, outcomes.Lost):
            entry["reason"] = outcome.reason
        usual = isinstance(outcome, outcomes.Finished | outcomes.Stopped) or (
            isinstance(outcome, outcomes.Failed) and not outcome.trace
        )
        log.log(logging.INFO if usual else logging.WARNING, "attempt ended", extra=entry)
        held.folder.remove()

    def _record(self, held: RunningAttempt, outcome: outcomes.Outcome, wall_s: float) -> State | None:
        """Where the job stands then; None where this attempt holds it no longer, and nothing was kept."""
        row, outputs = held.row, held.folder.folder / "outputs"
        host = outcome.host if isinstance(outcome, outcomes.Finished) else row.host
        origin = submission.write_provenance(row, held.order.specification, host, wall_s)
        match outcome:
            case outcomes.Finished():
                files = tuple((path, Content(sha, size, outputs / path)) for path, sha, size in outcome.files)
                made = ledger.AttemptOutput(json.dumps(outcome.result, allow_nan=False), files)
                return self._ledger.finish(row, made, origin)
            case outcomes.Failed():
                return self._ledger.settle(row, Event.FAIL, outcome.failure, origin)
            case outcomes.Stopped():
                stopped = ledger.report_worker_lost(row, "it was stopped")
                return self._ledger.settle(row, Event.RELEASE, stopped, origin)
            case outcomes.Lost():
                lost = ledger.report_worker_lost(row, outcome.reason)
                return self._ledger.settle(row, Event.LOSE, lost, origin)

    def _start_queued(self, executor: futures.Executor) -> None:
        """As many jobs as there are workers, and beside them one that is brief of each owner.

        So nobody waits hours for seconds, nor for what others have looked at.
        """
        while jobs.has_queued(self._store.database):
            served = {held.row.owner for held in self._held.values() if held.beside}
            row = self._lease(self._brief, served) if len(served) < attempts.SLOTS else None
            beside = row is not None
            if row is None and len(self._held) - len(served) < self._settings.workers:
                row = self._lease()
            if row is None:
                return
            self._start(row, executor, beside=beside)

    def _lease(
        self, kinds: abc.Collection[str] | None = None, without: abc.Collection[str] = ()
    ) -> JobRow | None:
        if not jobs.has_queued(self._store.database, kinds, without):
            return None
        # Raise StoreFull where the disk is nearly full; queued jobs say so while it is.
        try:
            self._store.require_room(self._settings.reserve_mb * 1_000_000)
        except errors.StoreFull as error:
            self._lacks_room = True
            jobs.explain_wait(self._store.database, error.problem)
            raise
        if self._lacks_room:
            jobs.explain_wait(self._store.database, ledger.WAITING)
            self._lacks_room = False
        return self._ledger.lease(self.name, socket.gethostname(), kinds, without)

    def _start(self, row: JobRow, executor: futures.Executor, *, beside: bool) -> None:
        kind = self._kinds.get(row.kind)
        if kind is None:
            self._ledger.settle(row, Event.FAIL, _UNKNOWN, None)
            return
        folder = attempts.AttemptFolder(self._store.blobs.work / f"{row.id}.{row.attempt}")
        limits = self._settings.choose_limits(brief=kind.brief, first=beside)
        order = attempts.make_order(self._store, self._settings, kind, row, folder.folder, limits)
        folder.open()
        try:
            future = executor.submit(attempts.run_attempt, order)
        except RuntimeError as error:  # broken, or shut down behind our back
            self._executor = None
            raise errors.StoreUnavailable(
                f"the executor is not available ({type(error).__name__})"
            ) from error
        self._held[row.id] = RunningAttempt(row=row, order=order, folder=folder, future=future, beside=beside)
        future.add_done_callback(lambda _future: self._wake.set())

    def _tidy(self) -> None:
        """Remove rubbish and what is older than it may get, now and then, apart from the work."""
        while not self._stop.is_set():
            try:
                self._lock.forget_dead()
                if self._settings.retention_days is not None:
                    deletion.expire(self._store.database, self._store.blobs, self._settings.retention_days)
                self._store.tidy()
            except errors.StoreUnavailable as error:
                log.warning("tidying was put off", extra={"reason": error.problem})
            self._stop.wait(TIDY_S)


def read_outcome(future: futures.Future[outcomes.Outcome]) -> outcomes.Outcome:
    """How an attempt ended, also where the executor itself broke."""
    try:
        return future.result()
    except futures.CancelledError:
        return outcomes.Stopped()
    except Exception as error:  # noqa: BLE001 (an executor raises what it likes when a worker is gone)
        return outcomes.Lost(f"the executor failed ({type(error).__name__})")


def read_machine_id() -> str:
    """A name of this machine since it was started, the same in all its containers.

    Where the kernel gives none, a name of this process: nothing is then concluded of others.
    """
    try:
        return _BOOT.read_text(encoding="ascii").strip().replace("-", "")[:12]
    except OSError:
        return f"p{os.getpid()}x{secrets.token_hex(4)}"


class RunnerLock:
    """The lock of one runner in a data directory, which the kernel lets go however the runner ends.

    Runners of the same machine see at once when one of them was killed, and take its jobs back without
    waiting for the leases. Of other machines nothing is concluded: there the leases decide.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder / "runners"
        self._machine = read_machine_id()
        self.name = f"{self._machine}-{os.getpid()}-{secrets.token_hex(4)}"
        with errors.disk_errors(folder):
            self._folder.mkdir(mode=0o700, exist_ok=True)
            hidden = self._folder / f".{self.name}"
            self._file: IO[str] = hidden.open("x", encoding="ascii")
            fcntl.flock(self._file, fcntl.LOCK_EX)
            hidden.rename(self._folder / self.name)  # locked before anyone can see it

    def dead(self, names: abc.Iterable[str]) -> list[str]:
        """Those runners that were on this machine and are no more."""
        mine = [name for name in names if name.startswith(f"{self._machine}-") and name != self.name]
        with errors.disk_errors(self._folder):
            return [name for name in mine if not _is_locked(self._folder / name)]

    def forget_dead(self) -> None:
        """Remove what dead runners of this machine left."""
        with errors.disk_errors(self._folder):
            for name in self.dead(path.name for path in self._folder.iterdir()):
                (self._folder / name).unlink(missing_ok=True)

    def close(self) -> None:
        """Be gone."""
        (self._folder / self.name).unlink(missing_ok=True)
        self._file.close()


def _is_locked(file: Path) -> bool:
    """Whether a living process holds the file; one that is not there is held by nobody."""
    try:
        with file.open("r", encoding="ascii") as handle:
            fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
            return False
    except BlockingIOError:
        return True
    except FileNotFoundError:
        return False
