"""The route that gives a caller something to try."""

from __future__ import annotations

from http import HTTPStatus
from typing import Annotated

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import JSONResponse

from scaling_service.documents.service import ExampleList
from scaling_service.service.http.callers import Owner
from scaling_service.service.http.problems import described
from scaling_service.service.http.threads import writing
from scaling_service.service.jobs.example import MOST, Examples

router = APIRouter(prefix="/v1/examples", tags=["subjects"])

Persons = Annotated[int, Query(ge=1, le=MOST, description="How many; more than one make a cohort.")]


@router.post(
    "",
    status_code=HTTPStatus.CREATED,
    response_model=ExampleList,
    responses=described(409, 413, 507) | {200: {"model": ExampleList, "description": "They were there"}},
)
async def put_examples(request: Request, owner: Owner, persons: Persons = 1) -> Response:
    """Put the built-in example among the caller's subjects.

    It is a virtual person with recordings of standing, hip and knee movements and walking, with bones and
    image markers. In the recordings two things are hidden for a discovery to find. It takes seconds.
    """
    examples: Examples = request.app.state.examples
    names, new = await writing(examples.put, owner, persons)
    content = ExampleList(subjects=names).model_dump(mode="json")
    return JSONResponse(content, HTTPStatus.CREATED if new else HTTPStatus.OK)
