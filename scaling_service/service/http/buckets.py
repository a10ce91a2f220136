"""How many requests a caller may make: a token bucket for each."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable

MOST_CALLERS = 10_000
"""Buckets kept. Chosen: a megabyte; the one unused for longest is forgotten, and was full again long ago."""


class Buckets:
    """A bucket of tokens for each caller; each request takes one, and they come back with time.

    Parameters
    ----------
    rate : float
        Tokens that come back a second.
    burst : int
        Tokens in a full bucket.
    clock : callable
        Seconds that only grow.

    Examples
    --------
    >>> now = 0.0
    >>> buckets = Buckets(rate=2.0, burst=1, clock=lambda: now)
    >>> buckets.take("a"), buckets.take("a"), buckets.take("b")
    (0.0, 0.5, 0.0)
    >>> now = 0.5
    >>> buckets.take("a")
    0.0
    """

    def __init__(self, rate: float, burst: int, clock: Callable[[], float] = time.monotonic) -> None:
        self._rate, self._burst, self._clock = rate, float(burst), clock
        self._lock = threading.Lock()
        self._filled: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def take(self, caller: str) -> float:
        """Take a token; 0, or the seconds until there is one."""
        with self._lock:
            left = self._left(caller)
            enough = left >= 1.0
            self._filled[caller] = (left - 1.0 if enough else left, self._clock())
            self._filled.move_to_end(caller)
            if len(self._filled) > MOST_CALLERS:
                self._filled.popitem(last=False)
            return 0.0 if enough else (1.0 - left) / self._rate

    def wait_s(self, caller: str) -> float:
        """The seconds until there is a token; none is taken."""
        with self._lock:
            return max(0.0, 1.0 - self._left(caller)) / self._rate

    def _left(self, caller: str) -> float:
        left, since = self._filled.get(caller, (self._burst, self._clock()))
        return min(self._burst, left + (self._clock() - since) * self._rate)
