"""What is kept: tables, their rows as frozen values, pages of rows that stay quick however long the list is.

Times are µs since 1970, documents are JSON as text.
"""

from __future__ import annotations

import base64
import binascii
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from sqlalchemy import (
    BigInteger,
    Column,
    ColumnElement,
    Connection,
    Float,
    ForeignKey,
    Index,
    Integer,
    MetaData,
    RowMapping,
    Select,
    String,
    Table,
    Text,
    tuple_,
)
from sqlalchemy.schema import ForeignKeyConstraint

from scaling_service.core.errors import InputError
from scaling_service.documents.jobs import Failure, State

metadata = MetaData(
    naming_convention={
        "pk": "pk_%(table_name)s",
        "fk": "fk_%(table_name)s_%(column_0_name)s",
        "ix": "ix_%(table_name)s_%(column_0_N_name)s",
    }
)

owners = Table(
    "owners",
    metadata,
    Column("name", String(200), primary_key=True),
    # When a job of this owner was last begun: whoever waited longest is next.
    Column("served_us", BigInteger, nullable=False, default=0, server_default="0"),
)
"""Whose things are kept apart. Rows appear with the first key or subject."""

api_keys = Table(
    "api_keys",
    metadata,
    Column("id", String(32), primary_key=True),
    Column("owner", ForeignKey("owners.name", ondelete="CASCADE"), nullable=False, index=True),
    Column("label", String(200), nullable=False),
    Column("secret_sha256", String(64), nullable=False),
    Column("created_us", BigInteger, nullable=False),
    Column("revoked_us", BigInteger),
)

subjects = Table(
    "subjects",
    metadata,
    Column("owner", ForeignKey("owners.name", ondelete="CASCADE"), primary_key=True),
    Column("id", String(200), primary_key=True),
    Column("created_us", BigInteger, nullable=False),
    Column("updated_us", BigInteger, nullable=False),
    Column("revision", Integer, nullable=False, default=1, server_default="1"),
    Column("document", Text, nullable=False),
    Index(None, "owner", "created_us", "id"),
    Index(None, "updated_us"),
)

marker_maps = Table(
    "marker_maps",
    metadata,
    Column("owner", ForeignKey("owners.name", ondelete="CASCADE"), primary_key=True),
    Column("document", Text, nullable=False),
    Column("updated_us", BigInteger, nullable=False),
)
"""Which label is which marker in an owner's laboratory; one map each."""

links = Table(
    "links",
    metadata,
    Column("sha256", String(64), primary_key=True),
    Column("owner", ForeignKey("owners.name", ondelete="CASCADE"), nullable=False, index=True),
    Column("until_us", BigInteger, nullable=False, index=True),
)
"""What opens one path without a key; see ``store/links.py``."""

blobs = Table(
    "blobs",
    metadata,
    Column("sha256", String(64), primary_key=True),
    Column("size", BigInteger, nullable=False),
    Column("touched_us", BigInteger, nullable=False),
)

subject_files = Table(
    "subject_files",
    metadata,
    Column("owner", String(200), primary_key=True),
    Column("subject", String(200), primary_key=True),
    Column("name", String(255), primary_key=True),
    Column("sha256", ForeignKey("blobs.sha256"), nullable=False, index=True),
    Column("size", BigInteger, nullable=False),
    Column("updated_us", BigInteger, nullable=False),
    ForeignKeyConstraint(["owner", "subject"], ["subjects.owner", "subjects.id"], ondelete="CASCADE"),
)

notes = Table(
    "notes",
    metadata,
    Column("owner", String(200), primary_key=True),
    Column("subject", String(200), primary_key=True),
    Column("document", Text, nullable=False),
    Column("updated_us", BigInteger, nullable=False),
    ForeignKeyConstraint(["owner", "subject"], ["subjects.owner", "subjects.id"], ondelete="CASCADE"),
)
"""What people wrote about a subject's results, and who signed it."""

jobs = Table(
    "jobs",
    metadata,
    Column("id", String(64), primary_key=True),
    Column("owner", ForeignKey("owners.name", ondelete="CASCADE"), nullable=False),
    Column("kind", String(64), nullable=False),
    Column("state", String(16), nullable=False),
    Column("attempt", Integer, nullable=False, default=0, server_default="0"),
    Column("losses", Integer, nullable=False, default=0, server_default="0"),
    # 1 for what was made for another job: it comes after what was asked for by itself.
    Column("part", Integer, nullable=False, default=0, server_default="0"),
    Column("revision", Integer, nullable=False, default=1, server_default="1"),
    Column("worker", String(200)),
    Column("lease_until_us", BigInteger),
    Column("progress_share", Float, nullable=False, default=0.0, server_default="0"),
    Column("progress_what", String(200), nullable=False, default="", server_default=""),
    Column("created_us", BigInteger, nullable=False),
    Column("started_us", BigInteger),
    Column("finished_us", BigInteger),
    Column("updated_us", BigInteger, nullable=False),
    Column("code_version", String(100), nullable=False),
    Column("host", String(255)),
    Column("failure", Text),
    # The large columns stand last: pages of jobs are read without them.
    Column("specification", Text, nullable=False),
    Column("provenance", Text),
    Column("result", Text),
    Index(None, "owner", "created_us", "id"),
    Index(None, "owner", "state", "created_us", "id"),
    Index(None, "owner", "kind", "created_us", "id"),
    Index(None, "owner", "state", "losses", "part", "created_us", "id"),
    Index(None, "state", "lease_until_us"),
    Index(None, "worker", "state"),
    Index(None, "finished_us"),
)

job_subjects = Table(
    "job_subjects",
    metadata,
    Column("job", ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
    Column("subject", String(200), primary_key=True),
    Column("owner", String(200), nullable=False),
    Column("created_us", BigInteger, nullable=False),
    Index(None, "owner", "subject", "created_us", "job"),
)
"""Whose data a job rests on: deleted with any of them."""

job_inputs = Table(
    "job_inputs",
    metadata,
    Column("job", ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
    Column("path", String(512), primary_key=True),
    Column("sha256", ForeignKey("blobs.sha256"), nullable=False, index=True),
    Column("size", BigInteger, nullable=False),
)
"""The content that a job was asked to work on, kept even when the subject's file is replaced."""

job_files = Table(
    "job_files",
    metadata,
    Column("job", ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
    Column("path", String(512), primary_key=True),
    Column("sha256", ForeignKey("blobs.sha256"), nullable=False, index=True),
    Column("size", BigInteger, nullable=False),
)
"""What a job made."""

job_parts = Table(
    "job_parts",
    metadata,
    Column("whole", ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
    Column("part", ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True, index=True),
    Column("position", Integer, nullable=False),
)
"""What a job is made of. A part may belong to several wholes, and goes with the last of them."""

REFERENCES = (subject_files, job_inputs, job_files)  # tables that keep content alive

_DIGITS = 18  # of a time in µs, at most: more would not fit a column
LARGEST = 500  # rows of a page. Chosen: answered in milliseconds, and enough for a screen.


@dataclass(frozen=True, slots=True, kw_only=True)
class KeyRow:
    """An API key, without its secret."""

    id: str
    owner: str
    label: str
    created_us: int
    revoked_us: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
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
class NoteRow:
    """A subject's note, as JSON."""

    document: str
    updated_us: int


@dataclass(frozen=True, slots=True)
class FileRow:
    """A named content: size in bytes, digest in hexadecimal."""

    name: str
    sha256: str
    size: int


@dataclass(frozen=True, slots=True, kw_only=True)
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


def make_job_row(row: RowMapping) -> JobRow:
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
        statement = statement.where(tuple_(*order) < tuple_(*_decode_cursor(cursor)))
    created, key = order
    ordered = statement.order_by(created.desc(), key.desc()).limit(limit + 1)  # one more: is there another?
    found = [row(each) for each in connection.execute(ordered).mappings()]
    shown = tuple(found[:limit])
    return Page(shown, _encode_cursor(shown[-1]) if len(found) > limit else None)


def _encode_cursor(last: SubjectRow | JobRow) -> str:
    """The cursor of what comes after this row."""
    return base64.urlsafe_b64encode(f"{last.created_us} {last.id}".encode()).decode().rstrip("=")


def _decode_cursor(cursor: str) -> tuple[int, str]:
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
