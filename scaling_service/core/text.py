"""Plain words for lists and numbers."""

from __future__ import annotations

from collections import abc

_SHOWN = 6  # chosen: as many names as fit one line


def list_few(names: abc.Sequence[str]) -> str:
    """Some names, and how many more there are.

    Examples
    --------
    >>> list_few(["a", "b"])
    'a, b'
    """
    more = len(names) - _SHOWN
    return ", ".join(names[:_SHOWN]) + (f" and {more} more" if more > 0 else "")


def suggest_name(name: str, known: abc.Iterable[str], *, cutoff: float = 0.6) -> str:
    """A question with the name that comes closest, and a space; empty where none is close.

    Examples
    --------
    >>> suggest_name("full_bdoy", ["full_body", "squat"])
    "Did you mean 'full_body'? "
    """
    import difflib

    close = difflib.get_close_matches(name, list(known), n=1, cutoff=cutoff)
    return f"Did you mean '{close[0]}'? " if close else ""


def format_p(p: float) -> str:
    """A probability as papers give it.

    Examples
    --------
    >>> format_p(0.0004), format_p(0.0321)
    ('< 0.001', '0.032')
    """
    return "< 0.001" if p < 0.001 else f"{p:.3f}"


def name_version() -> str:
    """The program and its version."""
    from importlib.metadata import version

    return f"scaling-service {version('scaling-service')}"
