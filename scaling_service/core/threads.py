"""Threads: one for linear algebra, the cores there are, and an executor for those who have no other."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import ParamSpec, TypeVar

_LIBRARIES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def use_one_thread() -> None:
    """Ask the linear algebra libraries for one thread each, unless the environment says otherwise.

    It works only before numpy is first imported: on two busy cores, scaling a full-body model took
    forty seconds with the default and one and a half with one thread.
    """
    for name in _LIBRARIES:
        os.environ.setdefault(name, "1")


def cores() -> int:
    """The processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


P = ParamSpec("P")
T = TypeVar("T")


class Serial(Executor):
    """Does every task at once, in the thread that submits it."""

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Run the task; its error is kept in the future, but for one that stops the program."""
        future: Future[T] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:  # noqa: BLE001 (an executor hands every error to whoever asks for the result)
            future.set_exception(error)
        return future
