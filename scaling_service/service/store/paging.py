"""Pages that stay quick however long the list is: each starts where the one before it ended."""

from __future__ import annotations

import base64
import binascii
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from sqlalchemy import ColumnElement, Select, tuple_

from scaling_service.core.errors import InputError

_DIGITS = 18
"""Of a time in µs, at most: more would not fit a column."""

LARGEST = 500
"""Rows of a page. Chosen: answered in milliseconds, and enough for a screen."""


Item = TypeVar("Item")


@dataclass(frozen=True, slots=True)
class Page(Generic[Item]):
    """Some rows, newest first, and the cursor of those after them (None at the end)."""

    items: tuple[Item, ...]
    following: str | None


def newest_first(
    statement: Select[Any],
    created: ColumnElement[int],
    key: ColumnElement[str],
    cursor: str | None,
    limit: int,
) -> Select[Any]:
    """The statement's rows of one page, and one more to see whether there is another page.

    Raises
    ------
    InputError
        The cursor is not one that was given out, or the limit is out of range.
    """
    if not 1 <= limit <= LARGEST:
        raise InputError(f"a page of {limit} is not possible", field="limit", remedy=f"Give 1 to {LARGEST}")
    if cursor is not None:
        statement = statement.where(tuple_(created, key) < tuple_(*_opened(cursor)))
    return statement.order_by(created.desc(), key.desc()).limit(limit + 1)


def cursor_of(created_us: int, key: str) -> str:
    """The cursor of what comes after this row."""
    return base64.urlsafe_b64encode(f"{created_us} {key}".encode()).decode().rstrip("=")


def _opened(cursor: str) -> tuple[int, str]:
    try:
        text = base64.urlsafe_b64decode(cursor + "=" * (-len(cursor) % 4)).decode()
        created, _, key = text.partition(" ")
        if not key.isprintable() or len(created) > _DIGITS:
            raise ValueError(cursor)
        return int(created), key
    except (binascii.Error, ValueError):
        raise InputError(
            "the cursor is none that was given out",
            field="cursor",
            remedy="Take it from the page before, or leave it out",
        ) from None
