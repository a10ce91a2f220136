"""The warm process from which the processes of jobs are forked; run as ``python -m``.

It has one thread, imports what jobs need, and then does nothing but fork. A request is one datagram with
four file descriptors: the pickled call (from our own runner, never from a client), the pipe for messages,
the pipe for the exit status, and the lifeline. It ends when the program that started it is gone; children
end by their own lifelines.
"""

from __future__ import annotations

import importlib
import os
import pickle
import selectors
import signal
import socket
import sys
from contextlib import suppress
from typing import NoReturn

CALL, MESSAGES, STATUS, LIFELINE = range(4)
"""Order of the file descriptors in a request."""

REQUEST = b"fork"
_FIRST_FD = 3


def serve(requests: socket.socket, preload: str) -> None:
    """Fork a child for every request until the other end of the socket closes."""
    importlib.import_module(preload)
    waker, wakes = socket.socketpair()
    wakes.setblocking(False)
    signal.signal(signal.SIGCHLD, lambda _number, _frame: None)
    signal.set_wakeup_fd(wakes.fileno())
    children: dict[int, int] = {}
    chosen = selectors.DefaultSelector()
    chosen.register(requests, selectors.EVENT_READ)
    chosen.register(waker, selectors.EVENT_READ)
    while True:
        ready = [key.fileobj for key, _ in chosen.select()]
        if waker in ready:
            waker.recv(4096)
            _reap(children)
        if requests in ready:
            message, descriptors, _, _ = socket.recv_fds(requests, len(REQUEST), LIFELINE + 1)
            if not message:
                return
            _fork(descriptors, children)


def _fork(descriptors: list[int], children: dict[int, int]) -> None:
    child = os.fork()
    if child == 0:
        _become_child(descriptors)
    children[child] = descriptors[STATUS]
    for k in (CALL, MESSAGES, LIFELINE):
        os.close(descriptors[k])


def _reap(children: dict[int, int]) -> None:
    """Tell how children ended: a negative signal number, or the exit code."""
    while children:
        ended = os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT)
        if ended is None:
            return
        # While it is not waited for, its number belongs to nobody else: what it started goes with it.
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(ended.si_pid, signal.SIGKILL)
        child, status = os.waitpid(ended.si_pid, 0)
        pipe = children.pop(child)
        with suppress(BrokenPipeError):  # whoever asked is gone
            os.write(pipe, f"{os.waitstatus_to_exitcode(status)}\n".encode())
        os.close(pipe)


def _become_child(descriptors: list[int]) -> NoReturn:
    """Keep nothing of the server but what is imported, and make the call."""
    try:
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)
        with open(descriptors[CALL], "rb") as file:  # noqa: PTH123 (a descriptor, not a path)
            file.seek(0)
            call = pickle.load(file)
        # The status is the server's to tell: its pipe must end with the server, not with this process.
        above = max(*descriptors, _FIRST_FD) + 1
        messages = os.dup2(descriptors[MESSAGES], above, inheritable=False)
        lifeline = os.dup2(descriptors[LIFELINE], above + 1, inheritable=False)
        os.closerange(_FIRST_FD, above)
        os.closerange(above + 2, os.sysconf("SC_OPEN_MAX"))
        call(messages, lifeline)
    finally:
        os._exit(1)  # not reached by a call that ends as it should


if __name__ == "__main__":
    with socket.socket(fileno=int(sys.argv[1])) as _requests:
        serve(_requests, sys.argv[2])
