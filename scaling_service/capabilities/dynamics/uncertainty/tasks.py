"""Samples in chunks, here or in worker processes, always the same ones."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, as_completed
from typing import ParamSpec, TypeVar

import numpy as np

from scaling_service.numerics.multibody.laws import Array

P = ParamSpec("P")
T = TypeVar("T")

CHUNK = 125
"""Samples per task (chosen: some seconds of work each, so that two workers end together)."""


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
