"""Threads: one for linear algebra, work on all cores, and an executor for those who have no other."""

from __future__ import annotations

import os
from collections import abc
from concurrent import futures
from typing import ParamSpec, TypeVar

_LIBRARIES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def use_one_thread() -> None:
    """Ask the linear algebra libraries for one thread each, unless the environment says otherwise.

    It works only before numpy is first imported: on two busy cores, scaling a full-body model took
    forty seconds with the default and one and a half with one thread.
    """
    for name in _LIBRARIES:
        os.environ.setdefault(name, "1")


def count_cores() -> int:
    """The processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


P = ParamSpec("P")
S = TypeVar("S")
T = TypeVar("T")


def map_parallel(work: abc.Callable[[S], T], items: abc.Iterable[S]) -> list[T]:
    """What the work makes of every item, in their order, on as many cores as this process may use.

    Array work leaves the interpreter free for others.
    """
    given = list(items)
    count = min(len(given), count_cores())
    if count < 2:
        return [work(item) for item in given]
    with futures.ThreadPoolExecutor(count) as pool:
        return list(pool.map(work, given))


class Serial(futures.Executor):
    """Does every task at once, in the thread that submits it."""

    def submit(self, fn: abc.Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> futures.Future[T]:
        """Run the task; its error is kept in the future, but for one that stops the program."""
        future: futures.Future[T] = futures.Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:  # noqa: BLE001 (an executor hands every error to whoever asks for the result)
            future.set_exception(error)
        return future
