"""Rows as frozen values, and pages of them that stay quick however long the list is."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from sqlalchemy import ColumnElement, Connection, RowMapping, Select, tuple_

from scaling_service.core.errors import InputError
from scaling_service.documents.jobs import Failure, State

_DIGITS = 18  # of a time in µs, at most: more would not fit a column
LARGEST = 500  # rows of a page. Chosen: answered in milliseconds, and enough for a screen.


@dataclass(frozen=True, slots=True)
class KeyRow:
    """An API key, without its secret."""

    id: str
    owner: str
    label: str
    created_us: int
    revoked_us: int | None


@dataclass(frozen=True, slots=True)
class SubjectRow:
    """A subject without its document."""

    owner: str
    id: str
    created_us: int
    updated_us: int
    revision: int


@dataclass(frozen=True, slots=True)
class MarkerMapRow:
    """An owner's map of labels, as JSON."""

    document: str
    updated_us: int


@dataclass(frozen=True, slots=True)
class FileRow:
    """A named content: size in bytes, digest in hexadecimal."""

    name: str
    sha256: str
    size: int


@dataclass(frozen=True, slots=True)
class JobRow:
    """A job without its large documents."""

    id: str
    owner: str
    kind: str
    state: State
    attempt: int  # number of times that it was leased; the fencing token of the worker that holds it
    losses: int  # how many of these ended with the worker gone
    revision: int  # grows with every change, progress included
    worker: str | None  # who holds it, until ``lease_until_us``
    lease_until_us: int | None
    progress_share: float
    progress_what: str
    created_us: int
    started_us: int | None
    finished_us: int | None
    updated_us: int
    code_version: str
    host: str | None
    failure: Failure | None


def job_row(row: RowMapping) -> JobRow:
    """A job from what the database gave."""
    failure = row["failure"]
    read = {
        "state": State(row["state"]),
        "failure": None if failure is None else Failure.model_validate_json(failure),
    }
    return JobRow(**dict(row) | read)


Item = TypeVar("Item", SubjectRow, JobRow)


@dataclass(frozen=True, slots=True)
class Page(Generic[Item]):
    """Some rows, newest first, and the cursor of those after them (None at the end)."""

    items: tuple[Item, ...]
    following: str | None


def read_page(
    connection: Connection,
    statement: Select[Any],
    order: tuple[ColumnElement[int], ColumnElement[str]],
    cursor: str | None,
    limit: int,
    row: Callable[[RowMapping], Item],
) -> Page[Item]:
    """One page of a statement's rows, newest first by the columns of ``order``: time made, and name."""
    if not 1 <= limit <= LARGEST:
        raise InputError(f"a page of {limit} is not possible", field="limit", remedy=f"Give 1 to {LARGEST}")
    if cursor is not None:
        statement = statement.where(tuple_(*order) < tuple_(*_opened(cursor)))
    created, key = order
    ordered = statement.order_by(created.desc(), key.desc()).limit(limit + 1)  # one more: is there another?
    found = [row(each) for each in connection.execute(ordered).mappings()]
    shown = tuple(found[:limit])
    return Page(shown, _cursor_of(shown[-1]) if len(found) > limit else None)


def _cursor_of(last: SubjectRow | JobRow) -> str:
    """The cursor of what comes after this row."""
    return base64.urlsafe_b64encode(f"{last.created_us} {last.id}".encode()).decode().rstrip("=")


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
