"""Processes forked from a warm one, by Python's own fork server; they end with whoever started them."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from multiprocessing import connection, forkserver
from multiprocessing.popen_forkserver import Popen
from pathlib import Path

PRELOAD = "scaling_service.service.sandbox.warm"  # what the fork server imports before any job

_ROOT = Path(__file__).resolve().parents[3]
_CONTEXT = multiprocessing.get_context("forkserver")
_GONE_S = 10.0  # chosen: SIGKILL takes effect at once, unless the machine itself is stuck


def find_python(module: str, *arguments: str) -> tuple[list[str], dict[str, str]]:
    """Command line and environment of a process of ours that finds this very package."""
    path = os.pathsep.join(filter(None, [str(_ROOT), os.environ.get("PYTHONPATH")]))
    return [sys.executable, "-m", module, *arguments], {**os.environ, "PYTHONPATH": path}


def warm_up() -> None:
    """Start the fork server where it does not run, so that it is warm when a child is asked for."""
    _CONTEXT.set_forkserver_preload([PRELOAD])
    forkserver.ensure_running()


class SandboxProcess:
    """A child that makes a call with a pipe for its messages, as soon as the fork server is warm.

    It sees this process end by ``multiprocessing.parent_process().sentinel``. OSError or EOFError is raised
    where the machine gives no more processes, or the fork server was killed meanwhile.
    """

    def __init__(self, call: Callable[[connection.Connection], None]) -> None:
        self.messages, theirs = _CONTEXT.Pipe(duplex=False)
        try:
            with theirs:
                warm_up()
                # What `Process.start` uses, without its bookkeeping: that is for one thread, and refuses
                # daemonic processes, which Dask's workers are.
                self._process = Popen(_CONTEXT.Process(target=call, args=(theirs,)))
        except BaseException:
            self.messages.close()
            raise

    @property
    def sentinel(self) -> int:
        """A descriptor that can be read when the child is gone."""
        return self._process.sentinel

    @property
    def exit_code(self) -> int | None:
        """Of a child that is gone: a negative signal number, or what it ended with."""
        return self._process.poll()

    def end(self) -> None:
        """Kill the child with all that it started, if it lives, and wait until it is gone."""
        if self._process.poll() is None:
            self._process.kill()
        with suppress(ProcessLookupError, PermissionError):  # while one of a group lives, its number is taken
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait(_GONE_S)
        self._process.close()
        self.messages.close()
