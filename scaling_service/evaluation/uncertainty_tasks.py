"""Samples in chunks, here or in worker processes, always the same ones."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future, as_completed
from typing import ParamSpec, TypeVar

import numpy as np

from scaling_service.kernels.laws import Array

P = ParamSpec("P")
T = TypeVar("T")

CHUNK = 125
"""Samples per task (chosen: some seconds of work each, so that two workers end together)."""


class InThisThread(Executor):
    """Does every task at once, where it is submitted."""

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Run the task; its error is kept in the future, but for one that stops the program."""
        future: Future[T] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:  # noqa: BLE001 (an executor hands every error to whoever asks for the result)
            future.set_exception(error)
        return future


def in_chunks(
    executor: Executor,
    sample: Callable[[range], Array],
    count: int,
    progress: Callable[[float], None] | None = None,
) -> Array:
    """Rows of all samples, in their order.

    Parameters
    ----------
    executor : Executor
    sample : callable
        From sample numbers to one row each; must be picklable for worker processes.
    count : int
    progress : callable, optional
        Called with the share that is done.
    """
    chunks = [range(start, min(start + CHUNK, count)) for start in range(0, count, CHUNK)]
    futures = [executor.submit(sample, chunk) for chunk in chunks]
    for done, _ in enumerate(as_completed(futures), start=1):
        if progress is not None:
            progress(done / len(futures))
    return np.concatenate([future.result() for future in futures])
