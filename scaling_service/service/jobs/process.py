"""A runner in a process of its own, so that nothing it does slows those who answer requests; its log."""

from __future__ import annotations

import json
import logging
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from scaling_service.core.errors import InputError
from scaling_service.service.jobs.runner import Runner
from scaling_service.service.jobs.service import open_store
from scaling_service.service.jobs.settings import ServiceSettings, load_settings
from scaling_service.service.sandbox.supervisor import find_python
from scaling_service.service.store.errors import StoreUnavailable
from scaling_service.service.store.store import Store

log = logging.getLogger(__name__)

FROM_PARENT = "--from-parent"  # settings come over standard input, whose end is also the sign to end
EXIT_INPUT = 2  # what was given cannot be used, as on the command line
_TRY_AGAIN_S = 1.0  # before a store that did not answer at the start is tried again. Chosen.
_ENDING_S = 30.0  # how long a runner may take to give its jobs back. Chosen: longer than it gives itself.

_OF_EVERY_RECORD = frozenset(logging.makeLogRecord({}).__dict__) | {"message", "asctime", "taskName"}


def main(arguments: Sequence[str]) -> int:
    """Run until SIGTERM, SIGINT or the end of the parent, by a settings file or the environment alone.

    The exit code is 0, or 2 where the settings or the store cannot be used.
    """
    log_as_json()
    stopped = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda _number, _frame: stopped.set())
    try:
        if list(arguments) == [FROM_PARENT]:
            settings = ServiceSettings.model_validate_json(sys.stdin.readline())
            threading.Thread(target=_wait_for_parent, args=(stopped,), daemon=True).start()
        else:
            settings = load_settings(Path(arguments[0]) if arguments else None)
        store = _open_store_when_available(settings, stopped)
        if store is not None:
            runner = Runner(store, settings)
            threading.Thread(target=_stop_when, args=(stopped, runner), daemon=True).start()
            runner.run()
    except InputError as error:
        sys.stderr.write(f"scaling-service runner: {error}\n")
        return EXIT_INPUT
    return 0


def _stop_when(stopped: threading.Event, runner: Runner) -> None:
    stopped.wait()
    runner.stop()


def _wait_for_parent(stopped: threading.Event) -> None:
    sys.stdin.read()
    stopped.set()


def _open_store_when_available(settings: ServiceSettings, stopped: threading.Event) -> Store | None:
    """The store as soon as it answers: at the start of a machine the database may be later than we."""
    while not stopped.is_set():
        try:
            return open_store(settings)
        except StoreUnavailable as error:
            log.warning("the store is not available", extra={"reason": error.problem})
            stopped.wait(_TRY_AGAIN_S)
    return None


class RunnerProcess:
    """A runner beside this process: started again when it dies, ended with this process."""

    module = "scaling_service.service.jobs"
    """What is run, with :data:`FROM_PARENT`; another one may know other kinds of jobs."""

    def __init__(self, settings: ServiceSettings) -> None:
        self._settings = settings
        self._stopped = threading.Event()
        self._lock = threading.Lock()
        self._process: subprocess.Popen[str] | None = None
        self._watcher = threading.Thread(target=self._watch, name="runner-process", daemon=True)

    @property
    def pid(self) -> int | None:
        """Of the process that runs now."""
        process = self._process
        return process.pid if process is not None and process.poll() is None else None

    def start(self) -> None:
        """Start it; it takes jobs as soon as it is warm."""
        self._process = self._start_process()
        self._watcher.start()

    def stop(self) -> None:
        """Have it give its jobs back, and wait for its end."""
        self._stopped.set()
        with self._lock:
            process = self._process
            if process is None:
                return
            assert process.stdin is not None
            process.stdin.close()
            try:
                process.wait(_ENDING_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def _watch(self) -> None:
        while self._process is not None and not self._stopped.is_set():
            code = self._process.wait()
            assert self._process.stdin is not None
            self._process.stdin.close()
            if self._stopped.wait(_TRY_AGAIN_S):
                return
            log.warning("the runner ended and is started again", extra={"exit_code": code})
            with self._lock:
                if not self._stopped.is_set():
                    self._process = self._start_process()

    def _start_process(self) -> subprocess.Popen[str]:
        command, environment = find_python(self.module, FROM_PARENT)
        process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            text=True,
            env=environment,
            start_new_session=True,  # Ctrl-C at a terminal is for this process, which then ends it
        )
        assert process.stdin is not None
        process.stdin.write(self._settings.with_secrets() + "\n")
        process.stdin.flush()
        return process


class JsonLines(logging.Formatter):
    """One JSON object a line: what happened, when, to which job; nothing of a patient."""

    def format(self, record: logging.LogRecord) -> str:
        """Time, level, logger and message of a record, and what was given as ``extra``."""
        entry: dict[str, object] = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        entry |= {k: v for k, v in record.__dict__.items() if k not in _OF_EVERY_RECORD}
        if record.exc_info and record.exc_info[0] is not None:
            entry["error"] = record.exc_info[0].__name__
        return json.dumps(entry, default=str)


def log_as_json(name: str = "scaling_service", level: int = logging.INFO) -> None:
    """Send a package's log to standard error, without tracebacks, which could hold what clients sent."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(JsonLines())
    logger = logging.getLogger(name)
    logger.handlers[:] = [handler]
    logger.setLevel(level)
    logger.propagate = False
