"""Threads for what writes, apart from those that only look: a queue of writers holds up no reader."""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar

from anyio import CapacityLimiter
from anyio.lowlevel import RunVar
from anyio.to_thread import run_sync

P = ParamSpec("P")
T = TypeVar("T")

WRITERS = 8
"""Chosen: SQLite writes one at a time anyway, and a few uploads keep a disk busy."""

_LIMITER: RunVar[CapacityLimiter] = RunVar("writers")


async def writing(call: Callable[P, T], *args: P.args, **_none: P.kwargs) -> T:
    """Make a call that writes to the store, in one of the threads for that."""
    try:
        limiter = _LIMITER.get()
    except LookupError:
        limiter = CapacityLimiter(WRITERS)
        _LIMITER.set(limiter)
    return await run_sync(call, *args, limiter=limiter)
