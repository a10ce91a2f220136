"""A process that ends with the one that needs it, however that one ended.

A pipe is held open by whoever needs the process. When its other end closes, the kernel kills the whole
process group: no thread of ours has to run for that, so it also ends a process that is stuck in a library.
"""

from __future__ import annotations

import fcntl
import os
import select
import signal
import threading


def bind(pipe: int) -> None:
    """Kill this process group when the writing end of a pipe closes.

    Parameters
    ----------
    pipe : int
        The reading end. Nothing is ever written.
    """
    if hasattr(fcntl, "F_SETSIG"):
        _by_kernel(pipe)
    else:
        _by_thread(pipe)


def _by_kernel(pipe: int) -> None:
    """Have SIGKILL sent in place of SIGIO (fcntl(2), "Signal-driven I/O")."""
    fcntl.fcntl(pipe, fcntl.F_SETSIG, signal.SIGKILL)
    fcntl.fcntl(pipe, fcntl.F_SETOWN, -os.getpgrp())
    fcntl.fcntl(pipe, fcntl.F_SETFL, fcntl.fcntl(pipe, fcntl.F_GETFL) | os.O_ASYNC)
    watch = select.poll()
    watch.register(pipe, select.POLLHUP)
    if watch.poll(0):  # it was closed before the kernel was asked
        os.killpg(os.getpgrp(), signal.SIGKILL)


def _by_thread(pipe: int) -> None:
    def wait() -> None:
        os.read(pipe, 1)
        os.killpg(os.getpgrp(), signal.SIGKILL)

    threading.Thread(target=wait, name="lifeline", daemon=True).start()
