"""A runner in a process of its own, so that nothing it does slows those who answer requests."""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

from scaling_service.core.errors import InputError
from scaling_service.service.jobs.configuration import load_settings
from scaling_service.service.jobs.logs import log_as_json
from scaling_service.service.jobs.runner import Runner
from scaling_service.service.jobs.service import open_store
from scaling_service.service.jobs.settings import ServiceSettings
from scaling_service.service.store.errors import StoreUnavailable
from scaling_service.service.store.store import Store

log = logging.getLogger(__name__)

FROM_PARENT = "--from-parent"
"""Settings come over standard input, whose end is also the sign to end."""

EXIT_INPUT = 2
"""What was given cannot be used, as on the command line."""

_ROOT = Path(__file__).resolve().parents[3]
_TRY_AGAIN_S = 1.0
"""Before a store that did not answer at the start is tried again. Chosen."""

_ENDING_S = 30.0
"""How long a runner may take to give its jobs back. Chosen: longer than it gives itself."""


def main(arguments: Sequence[str]) -> int:
    """Run until SIGTERM, SIGINT or the end of the parent.

    Parameters
    ----------
    arguments : sequence of str
        A settings file, or nothing for the environment alone.

    Returns
    -------
    int
        0, or 2 where the settings or the store cannot be used.
    """
    log_as_json()
    stopped = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda _number, _frame: stopped.set())
    try:
        if list(arguments) == [FROM_PARENT]:
            settings = ServiceSettings.model_validate_json(sys.stdin.readline())
            threading.Thread(target=_await_end_of_input, args=(stopped,), daemon=True).start()
        else:
            settings = load_settings(Path(arguments[0]) if arguments else None)
        store = _store_when_there(settings, stopped)
        if store is not None:
            _run(Runner(store, settings), stopped)
    except InputError as error:
        sys.stderr.write(f"scaling-service runner: {error}\n")
        return EXIT_INPUT
    return 0


class RunnerProcess:
    """A runner beside this process: started again when it dies, ended with this process.

    Parameters
    ----------
    settings : ServiceSettings
    """

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
        self._process = self._started()
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
                    self._process = self._started()

    def _started(self) -> subprocess.Popen[str]:
        path = os.pathsep.join(filter(None, [str(_ROOT), os.environ.get("PYTHONPATH")]))
        process = subprocess.Popen(
            [sys.executable, "-m", self.module, FROM_PARENT],
            stdin=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": path},
            start_new_session=True,  # Ctrl-C at a terminal is for this process, which then ends it
        )
        assert process.stdin is not None
        process.stdin.write(self._settings.with_secrets() + "\n")
        process.stdin.flush()
        return process


def _await_end_of_input(stopped: threading.Event) -> None:
    sys.stdin.read()
    stopped.set()


def _store_when_there(settings: ServiceSettings, stopped: threading.Event) -> Store | None:
    """The store as soon as it answers: at the start of a machine the database may be later than we."""
    while not stopped.is_set():
        try:
            return open_store(settings)
        except StoreUnavailable as error:
            log.warning("the store is not available", extra={"reason": error.problem})
            stopped.wait(_TRY_AGAIN_S)
    return None


def _run(runner: Runner, stopped: threading.Event) -> None:
    def stop_when_asked() -> None:
        stopped.wait()
        runner.stop()

    threading.Thread(target=stop_when_asked, daemon=True).start()
    runner.run()
