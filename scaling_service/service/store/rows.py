"""Rows as frozen values."""

from __future__ import annotations

from dataclasses import dataclass

from sqlalchemy import RowMapping

from scaling_service.documents.jobs import Failure, State


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
    """A job without its large documents.

    Parameters
    ----------
    attempt : int
        Number of times that it was leased; the fencing token of the worker that holds it.
    losses : int
        How many of these ended with the worker gone.
    revision : int
        Grows with every change, progress included.
    worker : str, optional
        Who holds it, until ``lease_until_us``.
    """

    id: str
    owner: str
    kind: str
    state: State
    attempt: int
    losses: int
    revision: int
    worker: str | None
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
    fields = {name: row[name] for name in JOB_COLUMNS}
    told = fields["failure"]
    return JobRow(
        **fields
        | {
            "state": State(fields["state"]),
            "failure": None if told is None else Failure.model_validate_json(told),
        }
    )


JOB_COLUMNS = tuple(JobRow.__dataclass_fields__)
"""Columns of a job that are small."""
