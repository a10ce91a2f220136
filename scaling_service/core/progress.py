"""How long computations tell how far they are."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, float], None]
"""Called with what is being done and the share of the whole that is done, 0 to 1."""


def silent(what: str, share: float = 0.0) -> None:
    """No progress is shown, whether it is told with a share or by names alone."""


def part_of(progress: Progress, start: float, length: float) -> Progress:
    """Progress of a part of the whole, reported as shares of that part.

    Examples
    --------
    >>> second_half = part_of(lambda what, share: print(what, share), 0.5, 0.5)
    >>> second_half("fitting", 0.5)
    fitting 0.75
    """
    return lambda what, share: progress(what, start + length * share)
