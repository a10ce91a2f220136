"""From a request to the job that it is: checked, its files found, named."""

from __future__ import annotations

import difflib
import json
from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError
from sqlalchemy import Connection

from scaling_service.capabilities.shared.job import Documents, JobRequest
from scaling_service.core.errors import InputError, SubjectInvalid
from scaling_service.documents.reading import check_document
from scaling_service.documents.subject import Bones, Person
from scaling_service.service.jobs.identity import canonical, code_version, job_id, specification
from scaling_service.service.jobs.kinds import Kind, Parts
from scaling_service.service.store import subjects, uploads
from scaling_service.service.store.jobs import NewJob
from scaling_service.service.store.rows import FileRow


class RequestInvalid(InputError):
    """A request does not follow its contract."""


class ImagedPerson(BaseModel):
    """A subject of whom there are images only; landmarks can be found, models cannot be scaled."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    subject: Person
    bones: Bones | None = None


def check_subject(content: Mapping[str, Any]) -> str:
    """The name of the subject that a document describes.

    Without ``model`` and ``trials`` it may hold ``subject`` and ``bones`` only.

    Raises
    ------
    SubjectInvalid
        It does not follow its contract.
    """
    if not {"model", "trials"} & content.keys():
        try:
            return ImagedPerson.model_validate(dict(content)).subject.id
        except ValidationError:
            pass  # the full contract says what is wrong, in its own words
    return check_document(content).subject.id


def canonical_subject(content: Mapping[str, Any]) -> str:
    """A subject's document as it is kept.

    Raises
    ------
    SubjectInvalid
        It holds what is no text or number of JSON.
    """
    try:
        return canonical(content)
    except ValueError:
        raise SubjectInvalid(
            "a text or a number in it is none",
            field="(top level)",
            remedy="Send it as UTF-8, without NaN or infinity",
        ) from None


def check_request(kind: Kind, request: Mapping[str, Any] | JobRequest) -> JobRequest:
    """A request of a kind. A number in quotes, or a truth value for a number, is an error.

    Raises
    ------
    RequestInvalid
        It does not follow its contract; the first error is told.
    """
    if isinstance(request, kind.request):
        return request
    try:
        # As JSON, in which a strict check still takes lists for tuples, and objects for settings.
        return kind.request.model_validate_json(json.dumps(request), strict=True)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise RequestInvalid(
            str(first["msg"]).removeprefix("Value error, "),
            field=".".join(str(part) for part in first["loc"]),
            remedy="Correct it; the service's documentation shows examples",
        ) from None


def new_job(
    connection: Connection, owner: str, name: str, request: JobRequest, made_of: Parts | None = None
) -> NewJob:
    """The job that a request is, with the subjects' documents and files as they are now, and its parts.

    Raises
    ------
    NotFound
        This owner has no such subject.
    SubjectInvalid
        The document does not allow what is asked for, or a file that it names was not uploaded.
    """
    documents: Documents = {
        subject: json.loads(subjects.document_in(connection, owner, subject)) for subject in request.subjects
    }
    inputs = tuple(
        FileRow(f"{subject}/{file.name}", file.sha256, file.size)
        for subject, named in request.needed(documents).items()
        for file in (
            uploads.files_in(connection, owner, subject)
            if request.reads_every_file
            else _found(connection, owner, subject, named)
        )
    )
    hashes = {file.name: file.sha256 for file in inputs}
    try:
        told = request.model_dump(mode="json")
        text = specification(name, told, documents, hashes, code_version(), owner)
    except ValueError:
        raise RequestInvalid("a text in it is none", remedy="Send it as UTF-8") from None
    return NewJob(
        id=job_id(text),
        owner=owner,
        kind=name,
        code_version=code_version(),
        specification=text,
        subjects=request.subjects,
        inputs=inputs,
        parts=()
        if made_of is None
        else tuple(new_job(connection, owner, made_of.kind, part) for part in made_of.requests(request)),
    )


def _found(connection: Connection, owner: str, subject: str, named: Mapping[str, str]) -> list[FileRow]:
    """The uploaded files of these names, each once."""
    there = {file.name: file for file in uploads.files_in(connection, owner, subject)}
    for field, name in named.items():
        if name not in there:
            close = difflib.get_close_matches(name, there, n=1, cutoff=0.75)  # suffixes are alike
            guess = f"Did you mean '{close[0]}'?" if close else "Upload it to the subject, then ask again"
            raise SubjectInvalid(
                f"'{name}' was not uploaded for subject '{subject}'", field=field, remedy=guess
            )
    return [there[name] for name in dict.fromkeys(named.values())]
