"""What travels between a service and its clients, apart from results."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from scaling_service.documents.jobs import Failure, State


class _Travels(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Problem(_Travels):
    """Why a request was not answered (RFC 9457), in the words of the command line."""

    model_config = ConfigDict(extra="allow", frozen=True)

    type: str = Field(description="Names the kind of the problem.")
    title: str = Field(description="The status in words.")
    status: int
    detail: str = Field(description="The whole message: place, problem, remedy.")
    problem: str = Field(description="What is wrong, one sentence.")
    file: str | None = Field(default=None, description="The file in which it was found.")
    field: str | None = Field(default=None, description="The key, column, label or component in it.")
    remedy: str | None = Field(default=None, description="What to do about it.")


class FileEntry(_Travels):
    """A file that is kept."""

    name: str = Field(description="Its name, or its path among the files of a job.")
    size: int = Field(description="Bytes.")
    sha256: str = Field(description="Of the content, in hexadecimal.")


class FileList(_Travels):
    """Files by name."""

    items: list[FileEntry]


class SubjectSummary(_Travels):
    """A subject in a list."""

    id: str
    created_at: datetime
    updated_at: datetime
    revision: int = Field(description="Grows with every change of the document or the files.")


class SubjectDetail(SubjectSummary):
    """A subject with its document and its files."""

    document: dict[str, Any] = Field(description="As it was given.")
    files: list[FileEntry]


class SubjectPage(_Travels):
    """Some subjects, newest first."""

    items: list[SubjectSummary]
    next: str | None = Field(description="Give it as `cursor` for those that follow; null at the end.")


class ExampleList(_Travels):
    """Examples among the caller's subjects."""

    subjects: list[str] = Field(description="Their names.")


class LinkRequest(_Travels):
    """What a link is wanted for."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    path: str = Field(
        max_length=2000,
        description="Of a file of a job or a subject, or of a job's `files.zip`, as in its links.",
    )


class Link(_Travels):
    """A link that works without a key, for a short time."""

    path: str
    until: datetime = Field(description="It must be opened before.")


class Progress(_Travels):
    """How far a job is."""

    what: str
    share: float = Field(ge=0.0, le=1.0, description="Of the whole.")


class JobDocument(_Travels):
    """A job: where it stands, and where the rest is."""

    id: str = Field(description="SHA-256 of what was asked for, the inputs and the code's version.")
    kind: str
    state: State
    progress: Progress
    attempt: int = Field(description="How often it was begun.")
    revision: int = Field(description="Grows with every change.")
    created_at: datetime
    started_at: datetime | None
    finished_at: datetime | None
    updated_at: datetime
    code_version: str
    failure: Failure | None = Field(description="Why it failed; null unless it did.")
    links: dict[str, str] = Field(description="Paths of the events, the result and the files.")


class JobPage(_Travels):
    """Some jobs, newest first."""

    items: list[JobDocument]
    next: str | None = Field(description="Give it as `cursor` for those that follow; null at the end.")


class Origin(_Travels):
    """How to get a result again."""

    specification: dict[str, Any] = Field(description="What was asked for; its SHA-256 is the job's name.")
    provenance: dict[str, Any] | None = Field(description="How it was computed; null until it is over.")
