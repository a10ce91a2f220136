"""One stretch of a file in place of all of it (RFC 9110, section 14)."""

from __future__ import annotations

import re
from dataclasses import dataclass

from scaling_service.core.errors import InputError

_RANGE = re.compile(r"bytes=(\d{0,18})-(\d{0,18})")


class RangeUnsatisfiable(InputError):
    """The stretch begins beyond the end of the file."""

    def __init__(self, size: int) -> None:
        super().__init__(
            f"the file has {size} bytes, and the stretch begins after them",
            field="Range",
            remedy="Ask for bytes that it has",
        )
        self.size = size


@dataclass(frozen=True, slots=True)
class Stretch:
    """Bytes ``first`` to ``last``, both included, of a file of ``size`` bytes."""

    first: int
    last: int
    size: int

    @property
    def length(self) -> int:
        """The number of bytes."""
        return self.last - self.first + 1

    @property
    def told(self) -> str:
        """Value of ``Content-Range``."""
        return f"bytes {self.first}-{self.last}/{self.size}"


def asked_for(header: str | None, size: int) -> Stretch | None:
    """The stretch that a ``Range`` header asks for; None for all of the file.

    A header that cannot be understood, or asks for several stretches, is left out of account.

    Raises
    ------
    RangeUnsatisfiable
        No byte of the file is in it.

    Examples
    --------
    >>> asked_for("bytes=0-99", 1000).told, asked_for("bytes=-10", 1000).first, asked_for(None, 1000)
    ('bytes 0-99/1000', 990, None)
    """
    found = _RANGE.fullmatch((header or "").strip())
    if found is None or found.group(1) == found.group(2) == "":
        return None
    begin, end = found.groups()
    if begin == "":
        first, last = max(size - int(end), 0), size - 1
        empty = int(end) == 0 or size == 0
    else:
        first, last = int(begin), min(int(end), size - 1) if end else size - 1
        if end and int(end) < first:
            return None
        empty = first >= size
    if empty:
        raise RangeUnsatisfiable(size)
    return Stretch(first, last, size)
