"""Routes of subjects and their files."""

from __future__ import annotations

from contextlib import ExitStack
from datetime import UTC, datetime
from http import HTTPStatus
from typing import Annotated, Any
from urllib.parse import quote

from fastapi import APIRouter, Path, Query, Request, Response
from fastapi.responses import JSONResponse
from starlette.concurrency import run_in_threadpool

from scaling_service.documents.service import FileEntry, FileList, SubjectDetail, SubjectPage, SubjectSummary
from scaling_service.documents.subject import SubjectDocument
from scaling_service.service.http.bodies import chunks, read_json, writing
from scaling_service.service.http.callers import Desk, Owner
from scaling_service.service.http.contents import file_responses, stored_file, unless_known
from scaling_service.service.http.documentation import json_body
from scaling_service.service.http.problems import described
from scaling_service.service.jobs.service import Service
from scaling_service.service.jobs.submission import ImagedPerson
from scaling_service.service.store.errors import TooLarge
from scaling_service.service.store.rows import LARGEST, FileRow, SubjectRow

router = APIRouter(prefix="/v1/subjects", tags=["subjects"])

Named = Annotated[
    str, Path(pattern=r"^[\p{L}\p{N}_][\p{L}\p{N}_ .\-]*$", max_length=100, description="The subject's id.")
]
FileName = Annotated[
    str,
    Path(
        pattern=r"^[\p{L}\p{N}_][\p{L}\p{N}_ .()+=@,\-]{0,199}$", description="A plain name without folders."
    ),
]
Cursor = Annotated[
    str | None, Query(pattern=r"^[A-Za-z0-9_\-]*$", max_length=400, description="`next` of the page before.")
]
Size = Annotated[int, Query(ge=1, le=LARGEST, description="Entries of a page.")]

EXAMPLE: dict[str, Any] = {
    "subject": {"id": "S01", "sex": "F", "height_m": 1.70, "mass_kg": 62.0},
    "model": "lower_limb_14dof",
    "trials": {"static": "standing.trc", "calibration": ["hips.trc"], "evaluation": ["walk.trc"]},
}
"""A subject whose files are then uploaded under the names that it uses."""

DOCUMENTS = (SubjectDocument, ImagedPerson)  # a subject's document follows one of these

_BYTES = {"type": "string", "format": "binary"}


@router.post(
    "",
    status_code=HTTPStatus.CREATED,
    responses=described(400, 408, 413, 415, 507) | {200: {"model": SubjectDetail, "description": "Replaced"}},
    openapi_extra=json_body(EXAMPLE, *DOCUMENTS),
)
async def put_subject(request: Request, response: Response, owner: Owner, service: Desk) -> SubjectDetail:
    """Give a subject's document: a new subject, or in place of the document of that name.

    It is the subject file of the command line as JSON; files stand in it by the names under which they are
    uploaded. For landmarks alone it may hold `subject` and `bones` only.
    """
    document = await read_json(request)
    row, new = await writing(service.put_subject, owner, document)
    response.status_code = HTTPStatus.CREATED if new else HTTPStatus.OK
    response.headers["Location"] = f"/v1/subjects/{quote(row.id)}"
    return await run_in_threadpool(_detail, service, owner, row.id)


@router.get("", responses=described())
def list_subjects(owner: Owner, service: Desk, cursor: Cursor = None, limit: Size = 50) -> SubjectPage:
    """List subjects, newest first."""
    page = service.subjects(owner, cursor or None, limit)
    return SubjectPage(items=[SubjectSummary(**_entry(row)) for row in page.items], next=page.following)


@router.get(
    "/{subject}", response_model=SubjectDetail, responses=described(404) | {304: {"description": "Unchanged"}}
)
def get_subject(subject: Named, request: Request, owner: Owner, service: Desk) -> Response:
    """Look at a subject: its document and its files."""
    detail = _detail(service, owner, subject)
    return unless_known(
        request, detail.revision, lambda h: JSONResponse(detail.model_dump(mode="json"), headers=h)
    )


@router.delete("/{subject}", status_code=HTTPStatus.NO_CONTENT, responses=described(404))
def delete_subject(subject: Named, owner: Owner, service: Desk) -> None:
    """Delete a subject, its files, and all jobs on them, for good."""
    service.delete_subject(owner, subject)


@router.get("/{subject}/files", responses=described(404))
def list_files(subject: Named, owner: Owner, service: Desk) -> FileList:
    """List a subject's files."""
    return FileList(items=entries(service.subject_files(owner, subject)))


@router.put(
    "/{subject}/files/{name}",
    responses=described(404, 408, 413, 507),
    # No body is a file without content, which is the fault of the job that reads it.
    openapi_extra={
        "requestBody": {"required": False, "content": {"application/octet-stream": {"schema": _BYTES}}}
    },
)
async def put_file(
    subject: Named, name: FileName, request: Request, owner: Owner, service: Desk
) -> FileEntry:
    """Upload a file of a subject; one of the same name is replaced. The body is the file as it is."""
    _refuse_too_large(request, service.settings.limit_upload_mb)
    with ExitStack() as entered:
        upload = await run_in_threadpool(entered.enter_context, service.upload(owner, subject, name))
        async for chunk in chunks(request):
            await writing(upload.write, chunk)
        (entry,) = entries([await writing(upload.keep)])
        return entry


@router.get("/{subject}/files/{name}", response_class=Response, responses=file_responses(_BYTES))
def get_file(subject: Named, name: FileName, request: Request, owner: Owner, service: Desk) -> Response:
    """Download a file of a subject, or with `Range: bytes=a-b` a stretch of it."""
    row, _ = service.subject_file(owner, subject, name)
    return stored_file(request, service.store.blobs, row)


@router.delete("/{subject}/files/{name}", status_code=HTTPStatus.NO_CONTENT, responses=described(404))
def delete_file(subject: Named, name: FileName, owner: Owner, service: Desk) -> None:
    """Remove a file of a subject; jobs that were asked for before keep theirs."""
    service.remove_subject_file(owner, subject, name)


def _refuse_too_large(request: Request, limit_mb: int) -> None:
    """Say no before anything comes, where the length is told."""
    told = request.headers.get("content-length", "")
    if told.isdigit() and int(told[:20]) > limit_mb * 1_000_000:
        raise TooLarge(
            f"the upload is larger than {limit_mb} MB",
            remedy="Cut or compress the recording, or raise the limit in the service's settings",
        )


def moment(microseconds: int) -> datetime:
    """A time of the store as it travels."""
    return datetime.fromtimestamp(microseconds / 1e6, UTC)


def entries(rows: list[FileRow]) -> list[FileEntry]:
    """Files as they travel."""
    return [FileEntry(name=row.name, size=row.size, sha256=row.sha256) for row in rows]


def _entry(row: SubjectRow) -> dict[str, Any]:
    times = {"created_at": moment(row.created_us), "updated_at": moment(row.updated_us)}
    return {"id": row.id, "revision": row.revision} | times


def _detail(service: Service, owner: str, subject: str) -> SubjectDetail:
    return SubjectDetail(
        **_entry(service.subject(owner, subject)),
        document=service.subject_document(owner, subject),
        files=entries(service.subject_files(owner, subject)),
    )
