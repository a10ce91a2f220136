"""How long computations tell how far they are."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from threading import Lock

Progress = Callable[[str, float], None]
"""Called with what is being done and the share of the whole that is done, 0 to 1."""

_STRIDE = 0.04
"""Share of the way to the next mark that a step takes (chosen: half way after seventeen steps)."""


def show_nothing(what: str, share: float = 0.0) -> None:
    """No progress is shown, whether with a share or by names alone."""


def report_nothing() -> None:
    """No steps are reported."""


def report_part(progress: Progress, start: float, length: float) -> Progress:
    """Progress of a part of the whole, reported as shares of that part.

    Examples
    --------
    >>> second_half = report_part(lambda what, share: print(what, share), 0.5, 0.5)
    >>> second_half("fitting", 0.5)
    fitting 0.75
    """
    return lambda what, share: progress(what, start + length * share)


@dataclasses.dataclass(slots=True, eq=False, kw_only=True)
class Steps:
    """Progress of work of which nobody knows how many steps it takes: nearer to a mark with each, never back.

    Any thread may take a step.
    """

    report: Progress
    what: str = ""
    share: float = 0.0
    mark: float = 0.0
    _lock: Lock = dataclasses.field(default_factory=Lock)

    def begin(self, what: str, share: float, mark: float) -> None:
        """Begin a part that goes from a share of the whole towards another."""
        with self._lock:
            self.what, self.share, self.mark = what, max(self.share, share), mark
            self.report(self.what, self.share)

    def advance(self) -> None:
        """Take a step."""
        with self._lock:
            self.share += _STRIDE * max(self.mark - self.share, 0.0)
            self.report(self.what, self.share)
