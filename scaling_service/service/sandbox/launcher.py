"""Asks the fork server for processes, and starts it where it is not there (any more)."""

from __future__ import annotations

import atexit
import os
import pickle
import select
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from scaling_service.service.sandbox import forkserver

PRELOAD = "scaling_service.service.sandbox.warm"
_ROOT = Path(__file__).resolve().parents[3]

_GONE_S = 10.0  # chosen: SIGKILL takes effect at once, unless the machine itself is stuck

Call = Callable[[int, int], None]
"""Runs in the child with the descriptors of its pipe for messages and of its lifeline."""


def python(module: str, *arguments: str) -> tuple[list[str], dict[str, str]]:
    """Command line and environment of a process of ours that finds this very package."""
    path = os.pathsep.join(filter(None, [str(_ROOT), os.environ.get("PYTHONPATH")]))
    return [sys.executable, "-m", module, *arguments], {**os.environ, "PYTHONPATH": path}


@dataclass(slots=True)
class Launched:
    """A child that was asked for: the reading ends of its pipes, and the lifeline that it hangs on.

    Both pipes end when child and server are gone; the child is killed when the lifeline is closed.
    """

    messages: int
    status: int
    lifeline: int

    def end(self) -> None:
        """Kill the child with all that it started, if it lives, and wait until it is gone."""
        os.close(self.lifeline)
        os.close(self.messages)
        select.select([self.status], [], [], _GONE_S)
        os.close(self.status)


class Launcher:
    """One fork server of this process, which imports the module ``preload`` first."""

    def __init__(self, preload: str = PRELOAD) -> None:
        self._preload = preload
        self._lock = threading.Lock()
        self._socket: socket.socket | None = None
        self._server: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Start the server, so that it is warm when the first child is asked for."""
        with self._lock:
            self._alive()

    def launch(self, call: Call) -> Launched:
        """Start a child; it makes the call as soon as the server is warm.

        OSError is raised where the machine gives no more processes or descriptors.
        """
        messages, status, lifeline = os.pipe(), os.pipe(), os.pipe()
        given = (messages[1], status[1], lifeline[0])
        try:
            with tempfile.TemporaryFile() as file:
                pickle.dump(call, file)
                file.flush()
                self._ask([file.fileno(), *given])
        except BaseException:
            for descriptor in (messages[0], status[0], lifeline[1]):
                os.close(descriptor)
            raise
        finally:
            for descriptor in given:
                os.close(descriptor)
        return Launched(messages[0], status[0], lifeline[1])

    def close(self) -> None:
        """End the server and all its children."""
        with self._lock:
            self._end()

    def _ask(self, descriptors: list[int]) -> None:
        with self._lock:
            with suppress(ConnectionError):  # killed since it was looked at
                socket.send_fds(self._alive(), [forkserver.REQUEST], descriptors)
                return
            self._end()
            socket.send_fds(self._alive(), [forkserver.REQUEST], descriptors)

    def _alive(self) -> socket.socket:
        """The way to the server, which is started where it does not run."""
        if self._socket is None or self._server is None or self._server.poll() is not None:
            self._end()
            ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            with theirs:
                command, environment = python(forkserver.__name__, str(theirs.fileno()), self._preload)
                self._server = subprocess.Popen(
                    command,
                    pass_fds=[theirs.fileno()],
                    stdin=subprocess.DEVNULL,
                    start_new_session=True,  # Ctrl-C at a terminal is for the service, which then ends it
                    env=environment,
                )
            self._socket = ours
        return self._socket

    def _end(self) -> None:
        if self._socket is not None:
            self._socket.close()
        if self._server is not None:
            try:
                self._server.wait(timeout=1.0)
            except subprocess.TimeoutExpired:  # still importing
                self._server.kill()
                self._server.wait()
        self._socket = self._server = None


_LAUNCHER = Launcher()
atexit.register(_LAUNCHER.close)


def launcher() -> Launcher:
    """The launcher of this process."""
    return _LAUNCHER
