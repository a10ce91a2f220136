"""Work on several recordings, or blocks of them, at once: array work leaves the interpreter free."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from scaling_service.core.threads import cores

_Given = TypeVar("_Given")
_Made = TypeVar("_Made")


def map_parallel(work: Callable[[_Given], _Made], items: Iterable[_Given]) -> list[_Made]:
    """What the work makes of every item, in their order, on as many cores as this process may use."""
    given = list(items)
    count = min(len(given), cores())
    if count < 2:
        return [work(item) for item in given]
    with ThreadPoolExecutor(count) as pool:
        return list(pool.map(work, given))
