"""Numbers as people read them."""

from __future__ import annotations

from collections import abc


def number(value: float | None, digits: int = 1) -> str:
    """A number as shown, a dash where there is none."""
    return "–" if value is None else f"{value:.{digits}f}"


def format_signed(value: float | None, digits: int = 1) -> str:
    """A difference as shown, with its sign."""
    return "–" if value is None else f"{value:+.{digits}f}"


def describe_spans(spans: abc.Iterable[tuple[float, float]]) -> str:
    """Where along a cycle something holds.

    Examples
    --------
    >>> describe_spans([(10.0, 32.0)]), describe_spans([])
    ('10–32', 'nowhere')
    """
    return ", ".join(f"{start:.0f}–{end:.0f}" for start, end in spans) or "nowhere"


def unite_keys(mappings: abc.Iterable[abc.Mapping[str, object]]) -> list[str]:
    """All keys, in the order in which they first appear."""
    return list(dict.fromkeys(name for mapping in mappings for name in mapping))
