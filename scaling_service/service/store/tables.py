"""What is kept: tables, their rows as frozen values, pages of rows that stay quick however long the list is.

Times are µs since 1970, documents are JSON as text.
"""

from __future__ import annotations

import base64
import binascii
import typing
from collections.abc import Callable
from dataclasses import dataclass

import sqlalchemy as sa
from sqlalchemy.schema import ForeignKeyConstraint

from scaling_service.core.errors import InputError
from scaling_service.documents.jobs import Failure, State

metadata = sa.MetaData(
    naming_convention={
        "pk": "pk_%(table_name)s",
        "fk": "fk_%(table_name)s_%(column_0_name)s",
        "ix": "ix_%(table_name)s_%(column_0_N_name)s",
    }
)

owners = sa.Table(
    "owners",
    metadata,
    sa.Column("name", sa.String(200), primary_key=True),
    # When a job of this owner was last begun: whoever waited longest is next.
    sa.Column("served_us", sa.BigInteger, nullable=False, default=0, server_default="0"),
)
"""Whose things are kept apart. Rows appear with the first key or subject."""

api_keys = sa.Table(
    "api_keys",
    metadata,
    sa.Column("id", sa.String(32), primary_key=True),
    sa.Column("owner", sa.ForeignKey("owners.name", ondelete="CASCADE"), nullable=False, index=True),
    sa.Column("label", sa.String(200), nullable=False),
    sa.Column("secret_sha256", sa.String(64), nullable=False),
    sa.Column("created_us", sa.BigInteger, nullable=False),
    sa.Column("revoked_us", sa.BigInteger),
)

subjects = sa.Table(
    "subjects",
    metadata,
    sa.Column("owner", sa.ForeignKey("owners.name", ondelete="CASCADE"), primary_key=True),
    sa.Column("id", sa.String(200), primary_key=True),
    sa.Column("created_us", sa.BigInteger, nullable=False),
    sa.Column("updated_us", sa.BigInteger, nullable=False),
    sa.Column("revision", sa.Integer, nullable=False, default=1, server_default="1"),
    sa.Column("document", sa.Text, nullable=False),
    sa.Index(None, "owner", "created_us", "id"),
    sa.Index(None, "updated_us"),
)

marker_maps = sa.Table(
    "marker_maps",
    metadata,
    sa.Column("owner", sa.ForeignKey("owners.name", ondelete="CASCADE"), primary_key=True),
    sa.Column("document", sa.Text, nullable=False),
    sa.Column("updated_us", sa.BigInteger, nullable=False),
)
"""Which label is which marker in an owner's laboratory; one map each."""

links = sa.Table(
    "links",
    metadata,
    sa.Column("sha256", sa.String(64), primary_key=True),
    sa.Column("owner", sa.ForeignKey("owners.name", ondelete="CASCADE"), nullable=False, index=True),
    sa.Column("until_us", sa.BigInteger, nullable=False, index=True),
)
"""What opens one path without a key; see ``store/links.py``."""

blobs = sa.Table(
    "blobs",
    metadata,
    sa.Column("sha256", sa.String(64), primary_key=True),
    sa.Column("size", sa.BigInteger, nullable=False),
    sa.Column("touched_us", sa.BigInteger, nullable=False),
)

subject_files = sa.Table(
    "subject_files",
    metadata,
    sa.Column("owner", sa.String(200), primary_key=True),
    sa.Column("subject", sa.String(200), primary_key=True),
    sa.Column("name", sa.String(255), primary_key=True),
    sa.Column("sha256", sa.ForeignKey("blobs.sha256"), nullable=False, index=True),
    sa.Column("size", sa.BigInteger, nullable=False),
    sa.Column("updated_us", sa.BigInteger, nullable=False),
    ForeignKeyConstraint(["owner", "subject"], ["subjects.owner", "subjects.id"], ondelete="CASCADE"),
)

notes = sa.Table(
    "notes",
    metadata,
    sa.Column("owner", sa.String(200), primary_key=True),
    sa.Column("subject", sa.String(200), primary_key=True),
    sa.Column("document", sa.Text, nullable=False),
    sa.Column("updated_us", sa.BigInteger, nullable=False),
    sa.ForeignKeyConstraint(["owner", "subject"], ["subjects.owner", "subjects.id"], ondelete="CASCADE"),
)
"""What people wrote about a subject's results, and who signed it."""

jobs = sa.Table(
    "jobs",
    metadata,
    sa.Column("id", sa.String(64), primary_key=True),
    sa.Column("owner", sa.ForeignKey("owners.name", ondelete="CASCADE"), nullable=False),
    sa.Column("kind", sa.String(64), nullable=False),
    sa.Column("state", sa.String(16), nullable=False),
    sa.Column("attempt", sa.Integer, nullable=False, default=0, server_default="0"),
    sa.Column("losses", sa.Integer, nullable=False, default=0, server_default="0"),
    # 1 for what was made for another job: it comes after what was asked for by itself.
    sa.Column("part", sa.Integer, nullable=False, default=0, server_default="0"),
    sa.Column("revision", sa.Integer, nullable=False, default=1, server_default="1"),
    sa.Column("worker", sa.String(200)),
    sa.Column("lease_until_us", sa.BigInteger),
    sa.Column("progress_share", sa.Float, nullable=False, default=0.0, server_default="0"),
    sa.Column("progress_what", sa.String(200), nullable=False, default="", server_default=""),
    sa.Column("created_us", sa.BigInteger, nullable=False),
    sa.Column("started_us", sa.BigInteger),
    sa.Column("finished_us", sa.BigInteger),
    sa.Column("updated_us", sa.BigInteger, nullable=False),
    sa.Column("code_version", sa.String(100), nullable=False),
    sa.Column("host", sa.String(255)),
    sa.Column("failure", sa.Text),
    # The large columns stand last: pages of jobs are read without them.
    sa.Column("specification", sa.Text, nullable=False),
    sa.Column("provenance", sa.Text),
    sa.Column("result", sa.Text),
    sa.Index(None, "owner", "created_us", "id"),
    sa.Index(None, "owner", "state", "created_us", "id"),
    sa.Index(None, "owner", "kind", "created_us", "id"),
    sa.Index(None, "owner", "state", "losses", "part", "created_us", "id"),
    sa.Index(None, "state", "lease_until_us"),
    sa.Index(None, "worker", "state"),
    sa.Index(None, "finished_us"),
)

job_subjects = sa.Table(
    "job_subjects",
    metadata,
    sa.Column("job", sa.ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
    sa.Column("subject", sa.String(200), primary_key=True),
    sa.Column("owner", sa.String(200), nullable=False),
    sa.Column("created_us", sa.BigInteger, nullable=False),
    sa.Index(None, "owner", "subject", "created_us", "job"),
)
"""Whose data a job rests on: deleted with any of them."""


def _list_job_files(name: str) -> sa.Table:
    return sa.Table(
        name,
        metadata,
        sa.Column("job", sa.ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
        sa.Column("path", sa.String(512), primary_key=True),
        sa.Column("sha256", sa.ForeignKey("blobs.sha256"), nullable=False, index=True),
        sa.Column("size", sa.BigInteger, nullable=False),
    )


job_inputs = _list_job_files("job_inputs")
"""The content that a job was asked to work on, kept even when the subject's file is replaced."""

job_files = _list_job_files("job_files")
"""What a job made."""

job_parts = sa.Table(
    "job_parts",
    metadata,
    sa.Column("whole", sa.ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
    sa.Column("part", sa.ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True, index=True),
    sa.Column("position", sa.Integer, nullable=False),
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
class WrittenRow:
    """What people wrote, as JSON: an owner's map of labels, or a subject's note."""

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


def make_job_row(row: sa.RowMapping) -> JobRow:
    """A job from what the database gave."""
    failure = row["failure"]
    read = {
        "state": State(row["state"]),
        "failure": None if failure is None else Failure.model_validate_json(failure),
    }
    return JobRow(**dict(row) | read)


Item = typing.TypeVar("Item", SubjectRow, JobRow)


@dataclass(frozen=True, slots=True)
class Page(typing.Generic[Item]):
    """Some rows, newest first, and the cursor of those after them (None at the end)."""

    items: tuple[Item, ...]
    following: str | None


def read_page(
    connection: sa.Connection,
    statement: sa.Select[typing.Any],
    order: tuple[sa.ColumnElement[int], sa.ColumnElement[str]],
    cursor: str | None,
    limit: int,
    row: Callable[[sa.RowMapping], Item],
) -> Page[Item]:
    """One page of a statement's rows, newest first by the columns of ``order``: time made, and name."""
    if not 1 <= limit <= LARGEST:
        raise InputError(f"a page of {limit} is not possible", field="limit", remedy=f"Give 1 to {LARGEST}")
    if cursor is not None:
        statement = statement.where(sa.tuple_(*order) < sa.tuple_(*_decode_cursor(cursor)))
    created, key = order
    ordered = statement.order_by(created.desc(), key.desc()).limit(limit + 1)  # one more: is there another?
    found = [row(each) for each in connection.execute(ordered).mappings()]
    shown = tuple(found[:limit])
    if len(found) > limit:
        # The cursor of what comes after this row
        last = shown[-1]
        after = base64.urlsafe_b64encode(f"{last.created_us} {last.id}".encode()).decode().rstrip("=")
    else:
        after = None
    return Page(shown, after)


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
