"""One thread for linear algebra (our matrices are small, threads only wait for each other), and the cores."""

from __future__ import annotations

import os

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
