"""From a request to the job that it is: checked, its files found, named by one SHA-256.

The digest is over all that the result depends on, and the owner, so that no owner can ask whether another has
the same data.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import Any

import pydantic
from sqlalchemy import Connection

from scaling_service.capabilities.shared import job
from scaling_service.core import errors
from scaling_service.core.text import suggest_name
from scaling_service.documents.reading import check_document
from scaling_service.documents.subject import Bones, Person
from scaling_service.documents.writing import code_version as released_version
from scaling_service.files.segmentation import list_tables
from scaling_service.service.jobs import kinds
from scaling_service.service.store import subjects
from scaling_service.service.store.jobs import NewJob
from scaling_service.service.store.tables import FileRow, JobRow

_SUFFIXES = (".py", ".yaml", ".json", ".csv")  # files of the package that results can depend on
_PAGE = "service/page/"  # the web page's sources and bundle: no result depends on them


class RequestInvalid(errors.InputError):
    """A request does not follow its contract."""

    @classmethod
    def of(cls, error: pydantic.ValidationError, remedy: str) -> RequestInvalid:
        """By the first of what was found."""
        first = error.errors(include_url=False)[0]
        field = ".".join(str(part) for part in first["loc"])
        return cls(str(first["msg"]).removeprefix("Value error, "), field=field, remedy=remedy)


class ImagedPerson(pydantic.BaseModel):
    """A subject of whom there are images only; landmarks can be found, models cannot be scaled."""

    model_config = pydantic.ConfigDict(extra="forbid", strict=True, frozen=True)

    subject: Person
    bones: Bones | None = None


def check_subject(content: Mapping[str, Any]) -> str:
    """The name of the subject that a document describes, or SubjectInvalid.

    Without ``model`` and ``trials`` it may hold ``subject`` and ``bones`` only.
    """
    if not {"model", "trials"} & content.keys():
        try:
            return ImagedPerson.model_validate(dict(content)).subject.id
        except pydantic.ValidationError:
            pass  # the full contract says what is wrong, in its own words
    return check_document(content).subject.id


def write_canonical_subject(content: Mapping[str, Any]) -> str:
    """A subject's document as it is kept, or SubjectInvalid."""
    try:
        return write_canonical(content)
    except ValueError:
        raise errors.SubjectInvalid(
            "a text or a number in it is none",
            field="(top level)",
            remedy="Send it as UTF-8, without NaN or infinity",
        ) from None


def check_request(kind: kinds.Kind, request: Mapping[str, Any] | job.JobRequest) -> job.JobRequest:
    """A request of a kind, or RequestInvalid; a number in quotes, or a truth value for a number, is one."""
    if isinstance(request, kind.request):
        return request
    try:
        # As JSON, in which a strict check still takes lists for tuples, and objects for settings.
        return kind.request.model_validate_json(json.dumps(request), strict=True)
    except pydantic.ValidationError as error:
        remedy = "Correct it; the service's documentation shows examples"
        raise RequestInvalid.of(error, remedy) from None


def make_new_job(
    connection: Connection, owner: str, name: str, request: job.JobRequest, made_of: kinds.Parts | None = None
) -> NewJob:
    """The job that a request is, with the subjects' documents and files as they are now, and its parts.

    NotFound where this owner has no such subject; SubjectInvalid where the document does not allow what is
    asked for, or a file that it names was not uploaded.
    """
    documents: job.Documents = {
        subject: json.loads(subjects.read_document(connection, owner, subject))
        for subject in request.subjects
    }
    inputs: list[FileRow] = []
    for subject, named in request.list_needed(documents).items():
        there = subjects.list_files_in(connection, owner, subject)
        chosen = there if request.reads_every_file else _match_uploads(there, subject, named)
        inputs += (FileRow(f"{subject}/{file.name}", file.sha256, file.size) for file in chosen)
    hashes = {file.name: file.sha256 for file in inputs}
    try:
        text = write_specification(
            name, request.model_dump(mode="json"), documents, hashes, code_version(), owner
        )
    except ValueError:
        raise RequestInvalid("a text in it is none", remedy="Send it as UTF-8") from None
    parts = [] if made_of is None else [(made_of.kind, part) for part in made_of.requests(request)]
    return NewJob(
        id=hash_specification(text),
        owner=owner,
        kind=name,
        code_version=code_version(),
        specification=text,
        subjects=request.subjects,
        inputs=tuple(inputs),
        parts=tuple(make_new_job(connection, owner, kind, part) for kind, part in parts),
    )


def _match_uploads(uploaded: list[FileRow], subject: str, named: Mapping[str, str]) -> list[FileRow]:
    """The uploaded files of these names, each once; of a label map also its table of labels."""
    there = {file.name: file for file in uploaded}
    for field, name in named.items():
        if name not in there:
            guess = suggest_name(name, there, cutoff=0.75)  # suffixes are alike
            raise errors.SubjectInvalid(
                f"'{name}' was not uploaded for subject '{subject}'",
                field=field,
                remedy=guess.strip() or "Upload it to the subject, then ask again",
            )
    tables = [table for name in named.values() for table in list_tables(name) if table in there]
    return [there[name] for name in dict.fromkeys((*named.values(), *tables))]


def write_canonical(document: Any) -> str:
    """JSON in the one form that equal documents share: sorted keys, no spaces.

    ValueError is raised where a number is not finite, or a text holds half a character.

    Examples
    --------
    >>> write_canonical({"b": 1.0, "a": ["µ", None]})
    '{"a":["µ",null],"b":1.0}'
    """
    text = json.dumps(document, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    text.encode()  # UnicodeEncodeError, which is a ValueError
    return text


def write_specification(
    kind: str,
    request: Mapping[str, Any],
    documents: Mapping[str, Any],
    inputs: Mapping[str, str],
    code: str,
    owner: str,
) -> str:
    """The canonical JSON of a job: its request with every default, documents and SHA-256 of each input."""
    content = {"kind": kind, "request": request, "documents": documents, "inputs": inputs}
    return write_canonical(content | {"code_version": code, "owner": owner})


def hash_specification(text: str) -> str:
    """The SHA-256 of a specification, in hexadecimal."""
    return hashlib.sha256(text.encode()).hexdigest()


def write_provenance(row: JobRow, specification: str, host: str | None, wall_s: float) -> str:
    """What is needed to get a result again, as JSON; the time on the clock is that of the last attempt."""
    asked = json.loads(specification)
    settings = asked["request"].get("settings", {})
    return write_canonical(
        {
            "code_version": code_version(),
            "asked_code_version": asked["code_version"],
            "kind": row.kind,
            "request": asked["request"],
            "seed": settings.get("seed") if isinstance(settings, dict) else None,
            "input_hashes": asked["inputs"],
            "host": host,
            "worker": row.worker,
            "attempts": row.attempt,
            "losses": row.losses,
            "wall_s": round(wall_s, 3),
        }
    )


@cache
def code_version() -> str:
    """The released version, and the first digits of the SHA-256 of the package's files.

    The files are read once in a process, so that it tells what the process started with.
    """
    digest = hashlib.sha256()
    for name, file in sorted(_list_files(files("scaling_service"), "")):
        content = file.read_bytes()
        digest.update(f"{len(name)}:{name}:{len(content)}:".encode() + content)
    return f"{released_version()}+{digest.hexdigest()[:12]}"


def _list_files(folder: Traversable, path: str) -> list[tuple[str, Traversable]]:
    found: list[tuple[str, Traversable]] = []
    for entry in folder.iterdir():
        name = f"{path}{entry.name}"
        if entry.is_dir():
            apart = entry.name.startswith(("__", ".")) or f"{name}/" == _PAGE
            found += [] if apart else _list_files(entry, f"{name}/")
        elif name.endswith(_SUFFIXES):
            found.append((name, entry))
    return found
