"""Routes of jobs: look, follow, fetch, cancel, delete."""

from __future__ import annotations

import json
from http import HTTPStatus
from typing import Annotated

from fastapi import APIRouter, Header, Path, Query, Request, Response
from fastapi.responses import JSONResponse, StreamingResponse
from starlette.concurrency import run_in_threadpool

from scaling_service.documents.jobs import State
from scaling_service.documents.service import FileList, JobDocument, JobPage, Origin, Progress
from scaling_service.service.http import conditional
from scaling_service.service.http.callers import Asked, Desk, Owner
from scaling_service.service.http.contents import archive, stored_file
from scaling_service.service.http.events import EVENT, MEDIA_TYPE, follow
from scaling_service.service.http.problems import described
from scaling_service.service.http.subjects import Cursor, Size, entries, moment
from scaling_service.service.http.threads import writing
from scaling_service.service.store.errors import NotFound
from scaling_service.service.store.rows import JobRow

router = APIRouter(prefix="/v1/jobs", tags=["jobs"])

JobId = Annotated[str, Path(pattern="^[0-9a-f]{64}$", description="The job's id.")]
_Kind = Annotated[
    str | None, Query(pattern=r"^[a-z0-9\-]*$", max_length=100, description="Only jobs of this kind.")
]
_Subject = Annotated[
    str | None,
    Query(
        pattern=r"^[\p{L}\p{N}_ .\-]*$",
        max_length=100,
        description="Only jobs that rest on this subject's data.",
    ),
]
_Seen = Annotated[
    str | None, Header(alias="Last-Event-ID", max_length=30, description="The last event that came.")
]


def as_document(row: JobRow) -> JobDocument:
    """A job as it travels."""
    here = f"/v1/jobs/{row.id}"
    return JobDocument(
        id=row.id,
        kind=row.kind,
        state=row.state,
        progress=Progress(what=row.progress_what, share=row.progress_share),
        attempt=row.attempt,
        revision=row.revision,
        created_at=moment(row.created_us),
        started_at=None if row.started_us is None else moment(row.started_us),
        finished_at=None if row.finished_us is None else moment(row.finished_us),
        updated_at=moment(row.updated_us),
        code_version=row.code_version,
        failure=row.failure,
        links={"self": here}
        | {name: f"{here}/{name}" for name in ("events", "result", "origin", "files", "files.zip")},
    )


@router.get("", responses=described())
def list_jobs(
    owner: Owner,
    service: Desk,
    state: State | None = None,
    kind: _Kind = None,
    subject: _Subject = None,
    cursor: Cursor = None,
    limit: Size = 50,
) -> JobPage:
    """List jobs, newest first."""
    page = service.jobs(
        owner, state=state, kind=kind or None, subject=subject or None, cursor=cursor or None, limit=limit
    )
    return JobPage(items=[as_document(row) for row in page.items], next=page.following)


@router.get(
    "/{job}", response_model=JobDocument, responses=described(404) | {304: {"description": "Unchanged"}}
)
async def get_job(job: JobId, request: Request, callers: Asked, service: Desk) -> Response:
    """Look at a job."""
    row = await callers.look(request, lambda owner: service.job(owner, job))
    current = conditional.tag(row.revision)
    if conditional.is_known(request, current):
        return conditional.unchanged(current)
    return JSONResponse(as_document(row).model_dump(mode="json"), headers=conditional.headers(current))


@router.delete(
    "/{job}",
    status_code=HTTPStatus.ACCEPTED,
    response_model=JobDocument,
    response_description="It was not over and is being cancelled",
    responses=described(404, 409) | {204: {"description": "It was over and is deleted for good"}},
)
async def delete_job(job: JobId, owner: Owner, service: Desk) -> Response:
    """Cancel a job that is not over; delete one that is, with all that it made."""
    row = await run_in_threadpool(service.job, owner, job)
    if row.state.is_over:
        await writing(service.delete_job, owner, job)
        return Response(status_code=HTTPStatus.NO_CONTENT)
    row = await writing(service.cancel, owner, job)
    return JSONResponse(as_document(row).model_dump(mode="json"), HTTPStatus.ACCEPTED)


@router.get(
    "/{job}/events",
    response_class=Response,
    responses=described(404)
    | {
        200: {
            "description": "Events `job`, each with the job as it then is; the last one when it is over",
            "content": {MEDIA_TYPE: {"schema": EVENT}},
        },
        204: {"description": "It is over, and its last event was seen"},
    },
)
async def get_events(
    job: JobId, request: Request, owner: Owner, service: Desk, last_event_id: _Seen = None
) -> Response:
    """Follow a job's progress as server-sent events; ids are revisions of the job."""
    row = await run_in_threadpool(service.job, owner, job)
    seen = int(last_event_id) if last_event_id is not None and last_event_id.isdecimal() else -1
    if row.state.is_over and row.revision <= seen:
        return Response(status_code=HTTPStatus.NO_CONTENT)

    async def look() -> JobDocument:
        return as_document(await run_in_threadpool(service.job, owner, job))

    stream = follow(as_document(row), look, seen, request.app.state.stopping)
    return StreamingResponse(stream, media_type=MEDIA_TYPE, headers={"Cache-Control": "no-store"})


@router.get(
    "/{job}/result",
    response_class=Response,
    responses=described(404)
    | {
        200: {"description": "The result", "content": {"application/json": {"schema": {}}}},
        304: {"description": "Unchanged"},
    },
)
async def get_result(job: JobId, request: Request, owner: Owner, service: Desk) -> Response:
    """Fetch the result of a job that is done; what it holds depends on the job's kind."""
    row = await run_in_threadpool(service.job, owner, job)
    text = await run_in_threadpool(service.result, owner, job)
    if text is None:
        raise _no_result(row)
    current = conditional.tag(f"{job[:16]}-{row.attempt}")
    if conditional.is_known(request, current):
        return conditional.unchanged(current)
    return Response(text, media_type="application/json", headers=conditional.headers(current))


@router.get("/{job}/origin", responses=described(404))
def get_origin(job: JobId, owner: Owner, service: Desk) -> Origin:
    """See how to get the result again: what was asked for, inputs, code, machine, attempts."""
    made = service.provenance(owner, job)
    return Origin(
        specification=json.loads(service.specification(owner, job)),
        provenance=None if made is None else json.loads(made),
    )


@router.get("/{job}/files", responses=described(404))
def list_files(job: JobId, owner: Owner, service: Desk) -> FileList:
    """List what a job made."""
    return FileList(items=entries(service.files(owner, job)))


@router.get(
    "/{job}/files.zip",
    response_class=Response,
    responses=described(404)
    | {200: {"description": "An archive", "content": {"application/zip": {"schema": {"type": "string"}}}}},
)
async def get_archive(job: JobId, owner: Owner, service: Desk) -> Response:
    """Download all that a job made as one zip."""
    row = await run_in_threadpool(service.job, owner, job)
    files = await run_in_threadpool(service.files, owner, job)
    if not files:
        raise _no_result(row)
    headers = {
        "Content-Disposition": f'attachment; filename="{row.kind}-{job[:8]}.zip"',
        "Cache-Control": "no-store",
    }
    stream = archive(files, service.store.blobs.open)
    return StreamingResponse(stream, media_type="application/zip", headers=headers)


@router.get(
    "/{job}/files/{path:path}",
    response_class=Response,
    responses=described(404, 416)
    | {
        200: {"description": "The file", "content": {"*/*": {"schema": {"type": "string"}}}},
        206: {"description": "The stretch", "content": {"*/*": {"schema": {"type": "string"}}}},
        304: {"description": "Unchanged"},
    },
)
async def get_file(
    job: JobId,
    path: Annotated[str, Path(max_length=512)],
    request: Request,
    owner: Owner,
    service: Desk,
) -> Response:
    """Download one file that a job made, or with `Range: bytes=a-b` a stretch of it."""
    row, _ = await run_in_threadpool(service.file, owner, job, path)
    return await stored_file(request, service.store.blobs, row)


def _no_result(row: JobRow) -> NotFound:
    if not row.state.is_over:
        remedy = "Wait until the job is done; its events tell"
    elif row.failure is not None:
        remedy = f"It failed: {row.failure}"
    else:
        remedy = "Ask for it again"
    return NotFound(f"the job has no result: it is {row.state}", field="job", remedy=remedy)
