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
from dataclasses import dataclass
from pathlib import Path

from scaling_service.service.sandbox import forkserver

PRELOAD = "scaling_service.service.sandbox.warm"
_ROOT = Path(__file__).resolve().parents[3]

_GONE_S = 10.0
"""Chosen: SIGKILL takes effect at once, unless the machine itself is stuck."""

Call = Callable[[int, int], None]
"""Runs in the child with the descriptors of its pipe for messages and of its lifeline."""


@dataclass(slots=True)
class Launched:
    """A child that was asked for: the reading ends of its pipes, and the lifeline that it hangs on.

    Parameters
    ----------
    messages, status : int
        Descriptors to read; both end when child and server are gone.
    lifeline : int
        The child is killed when this is closed.
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
    """One fork server of this process.

    Parameters
    ----------
    preload : str
        Module that the server imports first.
    """

    def __init__(self, preload: str = PRELOAD) -> None:
        self._preload = preload
        self._lock = threading.Lock()
        self._socket: socket.socket | None = None
        self._server: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Start the server, so that it is warm when the first child is asked for."""
        with self._lock:
            if self._server is None or self._server.poll() is not None:
                self._start()

    def launch(self, call: Call) -> Launched:
        """Start a child; it makes the call as soon as the server is warm.

        Raises
        ------
        OSError
            The machine gives no more processes or descriptors.
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
            if self._server is None or self._server.poll() is not None:
                self._start()
            assert self._socket is not None
            try:
                socket.send_fds(self._socket, [forkserver.REQUEST], descriptors)
            except (BrokenPipeError, ConnectionError):  # killed since it was looked at
                self._start()
                socket.send_fds(self._socket, [forkserver.REQUEST], descriptors)

    def _start(self) -> None:
        self._end()
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        path = os.pathsep.join(filter(None, [str(_ROOT), os.environ.get("PYTHONPATH")]))
        with theirs:
            self._server = subprocess.Popen(
                [sys.executable, "-m", forkserver.__name__, str(theirs.fileno()), self._preload],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C at a terminal is for the service, which then ends it
                env={**os.environ, "PYTHONPATH": path},
            )
        self._socket = ours

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
