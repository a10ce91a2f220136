"""What travels between a service and its clients, apart from results."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, StringConstraints

from scaling_service.documents import jobs
from scaling_service.documents.base import Part

MOST = 2000  # entries of a map. Chosen: many times the markers of a whole body


class Problem(Part):
    """Why a request was not answered (RFC 9457), in the words of the command line."""

    model_config = ConfigDict(extra="allow")

    type: str = Field(description="Names the kind of the problem.")
    title: str = Field(description="The status in words.")
    status: int
    detail: str = Field(description="The whole message: place, problem, remedy.")
    problem: str = Field(description="What is wrong, one sentence.")
    file: str | None = Field(default=None, description="The file in which it was found.")
    field: str | None = Field(default=None, description="The key, column, label or component in it.")
    remedy: str | None = Field(default=None, description="What to do about it.")


class FileEntry(Part):
    """A file that is kept."""

    name: str = Field(description="Its name, or its path among the files of a job.")
    size: int = Field(description="Bytes.")
    sha256: str = Field(description="Of the content, in hexadecimal.")


class FileList(Part):
    """Files by name."""

    items: list[FileEntry]


class SubjectSummary(Part):
    """A subject in a list."""

    id: str
    created_at: datetime
    updated_at: datetime
    revision: int = Field(description="Grows with every change of the document or the files.")


class SubjectDetail(SubjectSummary):
    """A subject with its document and its files."""

    document: dict[str, Any] = Field(description="As it was given.")
    files: list[FileEntry]


class SubjectPage(Part):
    """Some subjects, newest first."""

    items: list[SubjectSummary]
    next: str | None = Field(description="Give it as `cursor` for those that follow; null at the end.")


class ExampleList(Part):
    """Examples among the caller's subjects."""

    subjects: list[str] = Field(description="Their names.")


class LinkRequest(Part):
    """What a link is wanted for."""

    model_config = ConfigDict(strict=True)

    path: str = Field(
        max_length=2000,
        description="Of a file of a job or a subject, or of a job's `files.zip`, as in its links.",
    )
    lifetime_s: int = Field(
        default=60, ge=1, le=30 * 86_400, description="Seconds for which it works, up to 30 days."
    )


class Link(Part):
    """A link that works without a key until it ends."""

    path: str
    until: datetime = Field(description="It must be opened before.")


class Progress(Part):
    """How far a job is."""

    what: str
    share: float = Field(ge=0.0, le=1.0, description="Of the whole.")


class JobDocument(Part):
    """A job: where it stands, and where the rest is."""

    id: str = Field(description="SHA-256 of what was asked for, the inputs and the code's version.")
    kind: str
    state: jobs.State
    progress: Progress
    attempt: int = Field(description="How often it was begun.")
    revision: int = Field(description="Grows with every change.")
    created_at: datetime
    started_at: datetime | None
    finished_at: datetime | None
    updated_at: datetime
    code_version: str
    failure: jobs.Failure | None = Field(description="Why it failed; null unless it did.")
    links: dict[str, str] = Field(description="Paths of the events, the result and the files.")


class JobPage(Part):
    """Some jobs, newest first."""

    items: list[JobDocument]
    next: str | None = Field(description="Give it as `cursor` for those that follow; null at the end.")


class Specification(Part):
    """What was asked for; the SHA-256 of its canonical JSON is the job's name."""

    kind: str
    request: dict[str, Any] = Field(description="With every default.")
    documents: dict[str, dict[str, Any]] = Field(description="Subject to its document.")
    inputs: dict[str, str] = Field(description="Path of each input to its SHA-256.")
    code_version: str
    owner: str


class Origin(Part):
    """How to get a result again."""

    specification: Specification
    provenance: dict[str, Any] | None = Field(description="How it was computed; null until it is over.")


class MarkerWord(Part):
    """A marker of a model."""

    name: str
    segment: str = Field(description="What it sits on.")
    anatomical: bool = Field(description="Whether it is on a bony landmark.")


class CoordinateWord(Part):
    """A degree of freedom of a model."""

    name: str
    unit: Literal["deg", "m"]


class ModelWord(Part):
    """A built-in model."""

    name: str
    segments: list[str]
    markers: list[MarkerWord]
    coordinates: list[CoordinateWord]
    feet: bool = Field(description="Whether forces of the ground can act on it.")


class MethodWord(Part):
    """A method of scaling."""

    name: str
    meaning: str = Field(description="What is fitted, in plain words.")
    starts_from: str | None = Field(description="The method that gives the first guess.")
    needs_images: bool


class GaitAngleWord(Part):
    """A conventional angle of gait laboratories."""

    name: str
    title: str
    negative: str = Field(description="What its negative values mean.")
    positive: str = Field(description="What its positive values mean.")
    usual_deg: list[float] | None = Field(
        description="The reference population's mean over the gait cycle, at even steps from 0 to 100 %; "
        "null where it has none."
    )
    usual_sd_deg: list[float] | None


class Vocabulary(Part):
    """Built-in models, methods and bones."""

    models: list[ModelWord]
    methods: list[MethodWord]
    bones: list[str] = Field(description="Segments of which meshes can be given.")
    gait_angles: list[GaitAngleWord]
    hidden_in_example: list[str] = Field(
        description="What the built-in example's recordings hold that its model lacks, a sentence each: the "
        "answer to a discovery on it."
    )


_Word = Annotated[str, StringConstraints(min_length=1, max_length=200)]
MarkerLabels = Annotated[dict[_Word, _Word], Field(max_length=MOST)]
"""Label in the recordings to model marker."""


class SubjectNote(Part):
    """What people write about a subject's results, and who signs it."""

    text: str = Field(max_length=20_000, description="Anything, as it is to be read.")
    signed_by: str | None = Field(
        default=None,
        min_length=1,
        max_length=200,
        description="Who signs text and results; whoever writes anew without it takes the signature away.",
    )
    results: list[str] = Field(
        default=[], max_length=100, description="The jobs whose results are signed.", examples=[["0f…"]]
    )


class SubjectNoteDocument(SubjectNote):
    """A note as it is kept."""

    updated_at: datetime | None = Field(description="When it was written or signed; null without a note.")


class MarkerMap(Part):
    """Which label is which marker in a laboratory."""

    labels: MarkerLabels = Field(
        description="Label in the recordings to model marker.", examples=[{"RKN": "RLFE"}]
    )


class MarkerMapDocument(MarkerMap):
    """A laboratory's map as it is kept."""

    updated_at: datetime | None = Field(description="Null where none was given yet.")
