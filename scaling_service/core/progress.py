"""How work says how far it is."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, float], None]
"""Called with what is being done and the share that is done."""


def share(progress: Progress, start: float, end: float) -> Progress:
    """Progress of a part of the work, between two shares of the whole."""
    return lambda what, done: progress(what, start + (end - start) * done)


def no_progress(what: str, share: float) -> None:
    """For who wants none."""
