"""Routes of jobs: ask, look, follow, fetch, cancel, delete.

A new kind of job is a new row in the table of kinds, and nothing here. Progress comes as server-sent events
(WHATWG HTML, section 9.2).
"""

from __future__ import annotations

import asyncio
import json
import time
from collections import abc
from http import HTTPStatus
from typing import Annotated, Any

import fastapi
from fastapi.responses import JSONResponse
from pydantic import BaseModel
from starlette.concurrency import run_in_threadpool

from scaling_service.documents import service as contracts
from scaling_service.documents.jobs import State
from scaling_service.service.http import bodies, callers, contents, documentation, streams, subjects
from scaling_service.service.http.problems import describe_refusals
from scaling_service.service.jobs.kinds import Kind
from scaling_service.service.store import errors
from scaling_service.service.store.tables import JobRow

router = fastapi.APIRouter(prefix="/v1/jobs", tags=["jobs"])

_EVENT: dict[str, Any] = {
    "type": "object",
    "properties": {
        "id": {"type": "string", "description": "The job's revision."},
        "event": {"enum": ["job", "gone"]},
        "data": {"type": "string", "description": "The job as JSON."},
    },
    "required": ["event", "data"],
}
"""One event, for the document of all routes."""

LOOK_S = 0.25  # between two looks at the job. Chosen: faster than a person reads, a short query each.
QUIET_S = 15.0
"""A comment is sent after so long without news. Chosen: well under the minute of usual proxies."""

JobId = Annotated[str, fastapi.Path(pattern="^[0-9a-f]{64}$", description="The job's id.")]
_Kind = Annotated[
    str | None, fastapi.Query(pattern=r"^[a-z0-9\-]*$", max_length=100, description="Only jobs of this kind.")
]
_Subject = Annotated[
    str | None,
    fastapi.Query(
        pattern=r"^[\p{L}\p{N}_ .\-]*$",
        max_length=100,
        description="Only jobs that rest on this subject's data.",
    ),
]
_Seen = Annotated[
    str | None, fastapi.Header(alias="Last-Event-ID", max_length=30, description="The last event that came.")
]


def as_document(row: JobRow) -> contracts.JobDocument:
    """A job as it travels."""
    here = f"/v1/jobs/{row.id}"
    return contracts.JobDocument(
        id=row.id,
        kind=row.kind,
        state=row.state,
        progress=contracts.Progress(what=row.progress_what, share=row.progress_share),
        attempt=row.attempt,
        revision=row.revision,
        created_at=subjects.as_datetime(row.created_us),
        started_at=None if row.started_us is None else subjects.as_datetime(row.started_us),
        finished_at=None if row.finished_us is None else subjects.as_datetime(row.finished_us),
        updated_at=subjects.as_datetime(row.updated_us),
        code_version=row.code_version,
        failure=row.failure,
        links={"self": here}
        | {name: f"{here}/{name}" for name in ("events", "result", "origin", "files", "files.zip")},
    )


def _answer(
    row: JobRow, status: HTTPStatus = HTTPStatus.OK, headers: dict[str, str] | None = None
) -> JSONResponse:
    return JSONResponse(as_document(row).model_dump(mode="json"), status, headers)


@router.get("", responses=describe_refusals())
def list_jobs(
    owner: callers.Owner,
    service: callers.ServiceDep,
    state: State | None = None,
    kind: _Kind = None,
    subject: _Subject = None,
    cursor: subjects.Cursor = None,
    limit: subjects.Size = 50,
) -> contracts.JobPage:
    """List jobs, newest first."""
    page = service.jobs(
        owner, state=state, kind=kind or None, subject=subject or None, cursor=cursor or None, limit=limit
    )
    return contracts.JobPage(items=[as_document(row) for row in page.items], next=page.following)


@router.get(
    "/{job}",
    response_model=contracts.JobDocument,
    responses=describe_refusals(404) | {304: {"description": "Unchanged"}},
)
def get_job(
    job: JobId, request: fastapi.Request, owner: callers.Owner, service: callers.ServiceDep
) -> fastapi.Response:
    """Look at a job."""
    row = service.job(owner, job)
    return contents.answer_unless_cached(request, row.revision, lambda headers: _answer(row, headers=headers))


@router.delete(
    "/{job}",
    status_code=HTTPStatus.ACCEPTED,
    response_model=contracts.JobDocument,
    response_description="It was not over and is being cancelled",
    responses=describe_refusals(404, 409) | {204: {"description": "It was over and is deleted for good"}},
)
def delete_job(job: JobId, owner: callers.Owner, service: callers.ServiceDep) -> fastapi.Response:
    """Cancel a job that is not over; delete one that is, with all that it made."""
    if service.job(owner, job).state.is_over:
        service.delete_job(owner, job)
        return fastapi.Response(status_code=HTTPStatus.NO_CONTENT)
    return _answer(service.cancel(owner, job), HTTPStatus.ACCEPTED)


@router.get(
    "/{job}/events",
    response_class=fastapi.Response,
    responses=describe_refusals(404)
    | {
        200: {
            "description": "Events `job`, each with the job as it then is; the last one when it is over",
            "content": {"text/event-stream": {"schema": _EVENT}},
        },
        204: {"description": "It is over, and its last event was seen"},
    },
    dependencies=[fastapi.Depends(streams.hold_stream)],
)
async def get_events(
    job: JobId,
    request: fastapi.Request,
    owner: callers.Owner,
    service: callers.ServiceDep,
    last_event_id: _Seen = None,
) -> fastapi.Response:
    """Follow a job's progress as server-sent events; ids are revisions of the job."""
    row = await run_in_threadpool(service.job, owner, job)
    seen = int(last_event_id) if last_event_id is not None and last_event_id.isdecimal() else -1
    if row.state.is_over and row.revision <= seen:
        return fastapi.Response(status_code=HTTPStatus.NO_CONTENT)

    async def look() -> contracts.JobDocument:
        return as_document(await run_in_threadpool(service.job, owner, job))

    longest_s = service.settings.limit_stream_s
    return streams.BoundedResponse(
        stream_events(as_document(row), look, seen, request.app.state.stopping, longest_s),
        longest_s=longest_s + QUIET_S,  # for who reads it; who does not is cut off
        media_type="text/event-stream",
        headers={"Cache-Control": "no-store"},
    )


@router.get(
    "/{job}/result",
    response_class=fastapi.Response,
    responses=describe_refusals(404)
    | {
        200: {"description": "The result", "content": {"application/json": {"schema": documentation.RESULT}}},
        304: {"description": "Unchanged"},
    },
)
def get_result(
    job: JobId, request: fastapi.Request, owner: callers.Owner, service: callers.ServiceDep
) -> fastapi.Response:
    """Fetch the result of a job that is done; what it holds depends on the job's kind."""
    row, text = service.job(owner, job), service.result(owner, job)
    if text is None:
        raise _report_no_result(row)
    version = f"{job[:16]}-{row.attempt}"
    return contents.answer_unless_cached(
        request, version, lambda h: fastapi.Response(text, headers=h, media_type="application/json")
    )


@router.get("/{job}/origin", responses=describe_refusals(404))
def get_origin(job: JobId, owner: callers.Owner, service: callers.ServiceDep) -> contracts.Origin:
    """See how to get the result again: what was asked for, inputs, code, machine, attempts."""
    made = service.provenance(owner, job)
    return contracts.Origin(
        specification=contracts.Specification.model_validate_json(service.specification(owner, job)),
        provenance=None if made is None else json.loads(made),
    )


@router.get("/{job}/files", responses=describe_refusals(404))
def list_files(job: JobId, owner: callers.Owner, service: callers.ServiceDep) -> contracts.FileList:
    """List what a job made."""
    return contracts.FileList(items=subjects.list_file_entries(service.files(owner, job)))


@router.get(
    "/{job}/files.zip",
    response_class=fastapi.Response,
    responses=describe_refusals(404)
    | {200: {"description": "An archive", "content": {"application/zip": {"schema": {"type": "string"}}}}},
    dependencies=[fastapi.Depends(streams.hold_stream)],
)
def get_archive(job: JobId, owner: callers.Owner, service: callers.ServiceDep) -> fastapi.Response:
    """Download all that a job made as one zip."""
    row, files = service.job(owner, job), service.files(owner, job)
    if not files:
        raise _report_no_result(row)
    headers = {
        "Content-Disposition": f'attachment; filename="{row.kind}-{job[:8]}.zip"',
        "Cache-Control": "no-store",
    }
    stream = contents.zip_files(files, service.store.blobs.open)
    longest_s = service.settings.limit_stream_s
    return streams.BoundedResponse(stream, longest_s=longest_s, media_type="application/zip", headers=headers)


@router.get(
    "/{job}/files/{path:path}",
    response_class=fastapi.Response,
    responses=contents.describe_file_responses({"type": "string"}),
    dependencies=[fastapi.Depends(streams.hold_stream)],
)
def get_file(
    job: JobId,
    path: Annotated[str, fastapi.Path(max_length=512)],
    request: fastapi.Request,
    owner: callers.Owner,
    service: callers.ServiceDep,
) -> fastapi.Response:
    """Download one file that a job made, or with `Range: bytes=a-b` a part of it."""
    row, _ = service.file(owner, job, path)
    return contents.send_stored_file(request, service.store.blobs, row)


def _report_no_result(row: JobRow) -> errors.NotFound:
    if not row.state.is_over:
        remedy = "Wait until the job is done; its events tell"
    elif row.failure is not None:
        remedy = f"It failed: {row.failure}"
    else:
        remedy = "Ask for it again"
    return errors.NotFound(f"the job has no result: it is {row.state}", field="job", remedy=remedy)


def make_submission_routes(kinds: abc.Mapping[str, Kind]) -> fastapi.APIRouter:
    """The routes that ask for jobs, one for each kind that can be asked for by itself."""
    router = fastapi.APIRouter(prefix="/v1", tags=["asking"])
    for name, kind in kinds.items():
        if kind.route is None:
            continue
        summary, _, more = (kind.request.__doc__ or name).partition("\n")
        result = "" if kind.result is None else f"\n\nThe result follows `{kind.result.__name__}`."
        router.post(
            f"/{kind.route}",
            operation_id=name,
            summary=summary.strip().rstrip("."),
            description=f"{summary.strip()}\n{more.strip()}{result}",
            status_code=HTTPStatus.ACCEPTED,
            response_model=contracts.JobDocument,
            response_description="It waits or runs",
            responses=describe_refusals(400, 404, 408, 413, 415, 507)
            | {200: {"model": contracts.JobDocument, "description": "It was done before"}},
            openapi_extra=documentation.describe_json_body(make_example(kind.request), kind.request),
        )(_make_submission(name))
    return router


def make_example(model: type[BaseModel]) -> dict[str, Any]:
    """A request made of the examples of its fields."""
    return {
        field.alias or name: field.examples[0] for name, field in model.model_fields.items() if field.examples
    }


def _make_submission(
    kind: str,
) -> abc.Callable[[fastapi.Request, callers.Owner, callers.ServiceDep], abc.Awaitable[fastapi.Response]]:
    async def ask(
        request: fastapi.Request, owner: callers.Owner, service: callers.ServiceDep
    ) -> fastapi.Response:
        asked = await bodies.read_json(request)
        row, _ = await bodies.in_writer_thread(service.ask, owner, kind, asked)
        status = HTTPStatus.OK if row.state is State.DONE else HTTPStatus.ACCEPTED
        return _answer(row, status, {"Location": f"/v1/jobs/{row.id}"})

    return ask


async def stream_events(
    first: contracts.JobDocument,
    look: abc.Callable[[], abc.Awaitable[contracts.JobDocument]],
    seen: int,
    stopping: asyncio.Event,
    longest_s: float,
) -> abc.AsyncIterator[str]:
    """The events of a job from the revision ``seen`` on, until it is over, the server stops, or time is up.

    Who follows it then asks again, from the last event that came.

    ``id`` is the revision, ``event`` is ``job``, ``data`` is the job; its deletion is the event ``gone``.
    """
    document, told_at = first, time.monotonic()
    end = told_at + longest_s
    while True:
        if document.revision > seen:
            seen, told_at = document.revision, time.monotonic()
            yield _format_event("job", document.model_dump_json(), document.revision)
        elif time.monotonic() - told_at > QUIET_S:
            told_at = time.monotonic()
            yield ": still here\n\n"
        if document.state.is_over or time.monotonic() > end or await _wait_for_stop(stopping):
            return
        try:
            document = await look()
        except errors.NotFound:
            yield _format_event("gone", "{}")
            return
        except errors.StoreUnavailable:
            continue  # the client keeps what it knows; the store comes back by itself


async def _wait_for_stop(stopping: asyncio.Event) -> bool:
    """Wait for the next look; whether the server stops meanwhile."""
    try:
        await asyncio.wait_for(stopping.wait(), LOOK_S)
    except TimeoutError:
        return False
    return True


def _format_event(name: str, data: str, number: int | None = None) -> str:
    identity = "" if number is None else f"id: {number}\n"
    return f"{identity}event: {name}\ndata: {data}\n\n"
