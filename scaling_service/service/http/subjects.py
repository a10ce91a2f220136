"""Routes of subjects and their files."""

from __future__ import annotations

import json
from contextlib import ExitStack
from datetime import UTC, datetime
from http import HTTPStatus
from typing import Annotated, Any
from urllib.parse import quote

import fastapi
from fastapi.responses import JSONResponse
from starlette.concurrency import run_in_threadpool

from scaling_service.documents import service as contracts
from scaling_service.documents.subject import SubjectDocument
from scaling_service.service.http import bodies, callers, contents
from scaling_service.service.http.documentation import describe_json_body
from scaling_service.service.http.problems import describe_refusals
from scaling_service.service.http.streams import hold_stream
from scaling_service.service.jobs.service import Service
from scaling_service.service.jobs.submission import ImagedPerson
from scaling_service.service.store import tables
from scaling_service.service.store.errors import TooLarge

router = fastapi.APIRouter(prefix="/v1/subjects", tags=["subjects"])

Named = Annotated[
    str,
    fastapi.Path(
        pattern=r"^[\p{L}\p{N}_][\p{L}\p{N}_ .\-]*$", max_length=100, description="The subject's id."
    ),
]
FileName = Annotated[
    str,
    fastapi.Path(
        pattern=r"^[\p{L}\p{N}_][\p{L}\p{N}_ .()+=@,\-]{0,199}$", description="A plain name without folders."
    ),
]
Cursor = Annotated[
    str | None,
    fastapi.Query(pattern=r"^[A-Za-z0-9_\-]*$", max_length=400, description="`next` of the page before."),
]
Size = Annotated[int, fastapi.Query(ge=1, le=tables.LARGEST, description="Entries of a page.")]

EXAMPLE: dict[str, Any] = {
    "subject": {"id": "S01", "sex": "F", "height_m": 1.70, "mass_kg": 62.0},
    "model": "lower_limb_14dof",
    "trials": {"static": "standing.trc", "calibration": ["hips.trc"], "evaluation": ["walk.trc"]},
}
"""A subject whose files are then uploaded under the names that it uses."""

NOTE: dict[str, Any] = {"text": "Left knee marker slipped in the second walk.", "signed_by": "A. Smith"}

DOCUMENTS = (SubjectDocument, ImagedPerson, contracts.SubjectNote)
"""What a subject's document and note follow."""

_BYTES = {"type": "string", "format": "binary"}


@router.post(
    "",
    status_code=HTTPStatus.CREATED,
    responses=describe_refusals(400, 408, 413, 415, 507)
    | {200: {"model": contracts.SubjectDetail, "description": "Replaced"}},
    openapi_extra=describe_json_body(EXAMPLE, SubjectDocument, ImagedPerson),
)
async def put_subject(
    request: fastapi.Request, response: fastapi.Response, owner: callers.Owner, service: callers.ServiceDep
) -> contracts.SubjectDetail:
    """Give a subject's document: a new subject, or in place of the document of that name.

    It is the subject file of the command line as JSON; files stand in it by the names under which they are
    uploaded. For landmarks alone it may hold `subject` and `bones` only.
    """
    document = await bodies.read_json(request)
    row, new = await bodies.in_writer_thread(service.put_subject, owner, document)
    response.status_code = HTTPStatus.CREATED if new else HTTPStatus.OK
    response.headers["Location"] = f"/v1/subjects/{quote(row.id)}"
    return await run_in_threadpool(_make_detail, service, owner, row.id)


@router.get("", responses=describe_refusals())
def list_subjects(
    owner: callers.Owner, service: callers.ServiceDep, cursor: Cursor = None, limit: Size = 50
) -> contracts.SubjectPage:
    """List subjects, newest first."""
    page = service.subjects(owner, cursor or None, limit)
    return contracts.SubjectPage(
        items=[contracts.SubjectSummary(**_make_entry(row)) for row in page.items], next=page.following
    )


@router.get(
    "/{subject}",
    response_model=contracts.SubjectDetail,
    responses=describe_refusals(404) | {304: {"description": "Unchanged"}},
)
def get_subject(
    subject: Named, request: fastapi.Request, owner: callers.Owner, service: callers.ServiceDep
) -> fastapi.Response:
    """Look at a subject: its document and its files."""
    detail = _make_detail(service, owner, subject)
    return contents.answer_unless_cached(
        request, detail.revision, lambda h: JSONResponse(detail.model_dump(mode="json"), headers=h)
    )


@router.get("/{subject}/note", responses=describe_refusals(404))
def get_note(
    subject: Named, owner: callers.Owner, service: callers.ServiceDep
) -> contracts.SubjectNoteDocument:
    """Look at what was written about a subject's results, and who signed it; empty until it is given."""
    return _make_note(service.note(owner, subject))


@router.put(
    "/{subject}/note",
    responses=describe_refusals(400, 404, 408, 413, 415, 507),
    openapi_extra=describe_json_body(NOTE, contracts.SubjectNote),
)
async def put_note(
    subject: Named, request: fastapi.Request, owner: callers.Owner, service: callers.ServiceDep
) -> contracts.SubjectNoteDocument:
    """Write about a subject's results, and sign it, in place of what stood there before."""
    await run_in_threadpool(service.note, owner, subject)  # whose subject it is, before what is sent
    given = await bodies.read_model(contracts.SubjectNote, request, "Give `text`, and `signed_by` to sign it")
    row = await bodies.in_writer_thread(service.put_note, owner, subject, given.model_dump())
    return _make_note(row)


def _make_note(row: tables.WrittenRow | None) -> contracts.SubjectNoteDocument:
    if row is None:
        return contracts.SubjectNoteDocument(text="", updated_at=None)
    return contracts.SubjectNoteDocument(**json.loads(row.document), updated_at=as_datetime(row.updated_us))


@router.delete("/{subject}", status_code=HTTPStatus.NO_CONTENT, responses=describe_refusals(404))
def delete_subject(subject: Named, owner: callers.Owner, service: callers.ServiceDep) -> None:
    """Delete a subject, its files, and all jobs on them, for good."""
    service.delete_subject(owner, subject)


@router.get("/{subject}/files", responses=describe_refusals(404))
def list_files(subject: Named, owner: callers.Owner, service: callers.ServiceDep) -> contracts.FileList:
    """List a subject's files."""
    return contracts.FileList(items=list_file_entries(service.subject_files(owner, subject)))


@router.put(
    "/{subject}/files/{name}",
    responses=describe_refusals(404, 408, 413, 507),
    dependencies=[fastapi.Depends(hold_stream)],
    # No body is a file without content, which is the fault of the job that reads it.
    openapi_extra={
        "requestBody": {"required": False, "content": {"application/octet-stream": {"schema": _BYTES}}}
    },
)
async def put_file(
    subject: Named,
    name: FileName,
    request: fastapi.Request,
    owner: callers.Owner,
    service: callers.ServiceDep,
) -> contracts.FileEntry:
    """Upload a file of a subject; one of the same name is replaced. The body is the file as it is."""
    _refuse_too_large(request, service.settings.limit_upload_mb)
    with ExitStack() as entered:
        upload = await run_in_threadpool(entered.enter_context, service.upload(owner, subject, name))
        async for chunk in bodies.read_chunks(request, service.settings.limit_stream_s):
            await bodies.in_writer_thread(upload.write, chunk)
        (entry,) = list_file_entries([await bodies.in_writer_thread(upload.keep)])
        return entry


@router.get(
    "/{subject}/files/{name}",
    response_class=fastapi.Response,
    responses=contents.describe_file_responses(_BYTES),
    dependencies=[fastapi.Depends(hold_stream)],
)
def get_file(
    subject: Named,
    name: FileName,
    request: fastapi.Request,
    owner: callers.Owner,
    service: callers.ServiceDep,
) -> fastapi.Response:
    """Download a file of a subject, or with `Range: bytes=a-b` a part of it."""
    row, _ = service.subject_file(owner, subject, name)
    return contents.send_stored_file(request, service.store.blobs, row)


@router.delete("/{subject}/files/{name}", status_code=HTTPStatus.NO_CONTENT, responses=describe_refusals(404))
def delete_file(subject: Named, name: FileName, owner: callers.Owner, service: callers.ServiceDep) -> None:
    """Remove a file of a subject; jobs that were asked for before keep theirs."""
    service.remove_subject_file(owner, subject, name)


def _refuse_too_large(request: fastapi.Request, limit_mb: int) -> None:
    """Say no before anything comes, where the length is stated."""
    length = request.headers.get("content-length", "")
    if length.isdigit() and int(length[:20]) > limit_mb * 1_000_000:
        raise TooLarge(
            f"the upload is larger than {limit_mb} MB",
            remedy="Cut or compress the recording, or raise the limit in the service's settings",
        )


def as_datetime(microseconds: int) -> datetime:
    """A time of the store as it travels."""
    return datetime.fromtimestamp(microseconds / 1e6, UTC)


def list_file_entries(rows: list[tables.FileRow]) -> list[contracts.FileEntry]:
    """Files as they travel."""
    return [contracts.FileEntry(name=row.name, size=row.size, sha256=row.sha256) for row in rows]


def _make_entry(row: tables.SubjectRow) -> dict[str, Any]:
    times = {"created_at": as_datetime(row.created_us), "updated_at": as_datetime(row.updated_us)}
    return {"id": row.id, "revision": row.revision} | times


def _make_detail(service: Service, owner: str, subject: str) -> contracts.SubjectDetail:
    return contracts.SubjectDetail(
        **_make_entry(service.subject(owner, subject)),
        document=service.subject_document(owner, subject),
        files=list_file_entries(service.subject_files(owner, subject)),
    )
