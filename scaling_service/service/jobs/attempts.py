"""One attempt of a job: its folder, what is done in it, and the executors that do it.

An executor may be any of ``concurrent.futures``: an attempt is a call of :func:`run_attempt`, which watches
over a limited process of its own. So the executor's workers only wait; threads are enough on one machine.

The folder is all that runner and supervisor share, so they may be on two machines::

    inputs/S01/…    copies of the inputs, checked against their digests
    outputs/        what the child writes
    tmp/            everything temporary
    progress.json   written by the supervisor, read by the runner
    heartbeat       changed by the runner while it lives
    cancel          made by the runner: stop
"""

from __future__ import annotations

import importlib
import json
import shutil
import socket
import time
from collections.abc import Callable
from concurrent import futures
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

from scaling_service.core.errors import DependencyMissing
from scaling_service.documents import base
from scaling_service.documents.jobs import Failure
from scaling_service.service.jobs.kinds import Kind
from scaling_service.service.jobs.settings import ServiceSettings
from scaling_service.service.jobs.submission import code_version
from scaling_service.service.sandbox import outcomes, supervisor
from scaling_service.service.sandbox.child import Child
from scaling_service.service.sandbox.limits import Limits
from scaling_service.service.store import errors, jobs, parts
from scaling_service.service.store.blobs import Blobs
from scaling_service.service.store.store import Store
from scaling_service.service.store.tables import JobRow

Result = TypeVar("Result")
MakeExecutor: TypeAlias = Callable[[], futures.Executor]  # called again when an executor broke
SLOTS = 8
"""Owners whose brief job runs beside a runner's workers at once. Chosen: each may take a job's memory."""

_CONNECT_S = 10.0  # chosen: a scheduler that does not answer by then is tried again later
_PROGRESS_S = 0.25  # between two notes of progress. Chosen: faster than a person reads.


@dataclass(frozen=True, slots=True, kw_only=True)
class Order:
    """An attempt, as it is sent to an executor."""

    kind: Kind
    specification: str  # of the job: request and documents as JSON
    inputs: tuple[tuple[str, str], ...]  # path below the folder of inputs, and SHA-256
    data: Path  # the data directory
    folder: Path  # of this attempt, in the data directory
    limits: Limits
    code_version: str  # of the runner; the executor's must be the same
    patience_s: float  # without a heartbeat for so long, the runner is taken for dead
    parts: str | None = None  # JSON: how the jobs ended that this one is made of


def make_order(
    store: Store, settings: ServiceSettings, kind: Kind, row: JobRow, folder: Path, limits: Limits
) -> Order:
    """The order for an attempt at a leased job."""
    specification, _, _ = jobs.read_documents(store.database, row.owner, row.id)
    if kind.parts is None:
        inputs, ends = jobs.list_inputs(store.database, row.id), None
    else:
        inputs = parts.list_files(store.database, row.id, kind.parts.file)
        ended = [
            {
                "request": json.loads(end.specification)["request"],
                "state": end.state.value,
                "result": end.result and json.loads(end.result),
                "failure": end.failure and json.loads(end.failure),
            }
            for end in parts.list_ends(store.database, row.id)
        ]
        ends = json.dumps(ended, ensure_ascii=False)
    return Order(
        kind=kind,
        specification=specification,
        inputs=tuple((file.name, file.sha256) for file in inputs),
        data=store.blobs.folder,
        folder=folder,
        limits=limits,
        code_version=code_version(),
        patience_s=settings.lease_s,
        parts=ends,
    )


def run_attempt(order: Order) -> outcomes.Outcome:
    """Do one attempt, whatever its end; this is what executors run."""
    if order.code_version != code_version():
        return outcomes.Failed(
            Failure(
                kind="WorkerMismatch",
                problem=f"a worker runs {code_version()}, the service {order.code_version}",
                remedy="Install the same version everywhere, then ask for the job again",
            )
        )
    asked = json.loads(order.specification)
    try:
        documents = asked["documents"]
        blobs, inputs = Blobs(order.data), order.folder / "inputs"
        with errors.disk_errors(order.data):
            for name in ("inputs", "outputs", "tmp"):
                (order.folder / name).mkdir(mode=0o700, parents=True)
            for subject, document in documents.items():
                (inputs / subject).mkdir()
                text = json.dumps(document, ensure_ascii=False)
                (inputs / subject / base.DOCUMENT).write_text(text, encoding="utf-8")
            if order.parts is not None:
                (inputs / base.PARTS).write_text(order.parts, encoding="utf-8")
        for path, sha256 in order.inputs:
            with errors.disk_errors(order.data):
                (inputs / path).parent.mkdir(exist_ok=True)
            blobs.copy(sha256, inputs / path)
        watch = Watch(order.folder, order.patience_s)
        child = Child(partial(order.kind.perform, asked["request"]), order.folder, order.limits)
        outcome = supervisor.supervise(child, stop=watch.should_stop, progress=watch.write_progress)
    except errors.StoreUnavailable as error:
        return outcomes.Lost(error.problem)
    return replace(outcome, host=socket.gethostname()) if isinstance(outcome, outcomes.Finished) else outcome


class Watch:
    """The supervisor's side of the folder: may it go on, and how far is it."""

    def __init__(self, folder: Path, patience_s: float) -> None:
        self._folder, self._patience_s = folder, patience_s
        self._beat, self._changed = 0, time.monotonic()
        self._told = 0.0

    def should_stop(self) -> bool:
        """Whether the runner wants this to stop, has removed the folder, or is dead."""
        if (self._folder / "cancel").exists() or not self._folder.exists():
            return True
        now = time.monotonic()
        try:
            beat = (self._folder / "heartbeat").stat().st_mtime_ns
        except OSError:
            beat = self._beat
        if beat != self._beat:
            self._beat, self._changed = beat, now
        return now - self._changed > self._patience_s

    def write_progress(self, what: str, share: float) -> None:
        """Note the progress, now and then."""
        now = time.monotonic()
        if now - self._told < _PROGRESS_S and share < 1.0:
            return
        self._told = now
        part = self._folder / "progress.part"
        with suppress(OSError):  # the disk is full or the folder gone: the work itself will say so
            part.write_text(json.dumps([what, share]), encoding="utf-8")
            part.replace(self._folder / "progress.json")


class AttemptFolder:
    """The runner's side of the folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._seen = ""

    def open(self) -> None:
        """Make the folder, empty."""
        self.remove()
        with errors.disk_errors(self.folder.parent):
            self.folder.mkdir(mode=0o700)
        self.touch_heartbeat()

    def touch_heartbeat(self) -> None:
        """Show that the runner lives."""
        with suppress(OSError):  # the folder is gone: the work stops by itself
            (self.folder / "heartbeat").touch()

    def stop(self) -> None:
        """Have the work stopped; a folder that is gone has the same effect."""
        try:
            (self.folder / "cancel").touch()
        except OSError:
            self.remove()

    def read_progress(self) -> tuple[str, float] | None:
        """What is being done and the share that is done, where that is new."""
        try:
            text = (self.folder / "progress.json").read_text(encoding="utf-8")
            what, share = json.loads(text)
        except (OSError, ValueError):
            return None
        if text == self._seen:
            return None
        self._seen = text
        return str(what), float(share)

    def remove(self) -> None:
        """Remove the folder with all that is in it."""
        shutil.rmtree(self.folder, ignore_errors=True)


def choose_executor(settings: ServiceSettings) -> MakeExecutor:
    """The executor that the settings ask for: a Dask cluster where an address is given, else this machine."""
    address = settings.dask_address
    if address is None:
        return lambda: make_local_executor(settings.workers + SLOTS)
    try:
        distributed = importlib.import_module("distributed")
    except ImportError as error:
        raise DependencyMissing(
            "Dask is not installed",
            field="dask_address",
            remedy="Install it with `pip install 'scaling-service[dask]'`",
        ) from error
    return lambda: ClusterExecutor(distributed, address)


def make_local_executor(workers: int) -> futures.Executor:
    """Threads on this machine: each watches over one attempt, which computes in a process of its own."""
    supervisor.warm_up()
    return futures.ThreadPoolExecutor(workers, thread_name_prefix="attempt")


class ClusterExecutor(futures.Executor):
    """A Dask cluster, by its scheduler's address. Its workers need this package and the data directory."""

    def __init__(self, distributed: Any, address: str) -> None:
        try:
            self._client = distributed.Client(address, timeout=_CONNECT_S, set_as_default=False)
        except (OSError, TimeoutError) as error:
            raise errors.StoreUnavailable(
                "the Dask scheduler does not answer",
                field="dask_address",
                remedy="Start it; the service goes on by itself",
            ) from error
        # Not pure: the same order may be carried out twice. No retries: what is lost is our own matter.
        self._executor = self._client.get_executor(pure=False, retries=0)

    def submit(self, fn: Callable[..., Result], /, *args: Any, **kwargs: Any) -> futures.Future[Result]:
        """Run a call on one of the workers."""
        future: futures.Future[Result] = self._executor.submit(fn, *args, **kwargs)
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:  # noqa: ARG002 (the base's)
        """Leave the cluster; it goes on for others."""
        self._executor.shutdown(wait=wait)
        self._client.close()
