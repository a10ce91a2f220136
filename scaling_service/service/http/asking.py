"""One route for each row of the table of kinds: a new kind of job is a new row there, and nothing here."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from http import HTTPStatus
from typing import Any

from fastapi import APIRouter, Request, Response
from fastapi.responses import JSONResponse
from pydantic import BaseModel

from scaling_service.documents.jobs import State
from scaling_service.documents.service import JobDocument
from scaling_service.service.http.bodies import read_json
from scaling_service.service.http.callers import Desk, Owner
from scaling_service.service.http.jobs import as_document
from scaling_service.service.http.openapi import json_body
from scaling_service.service.http.problems import described
from scaling_service.service.http.threads import writing
from scaling_service.service.jobs.kinds import Kind


def routes(kinds: Mapping[str, Kind]) -> APIRouter:
    """The routes that ask for jobs.

    Parameters
    ----------
    kinds : mapping
        What can be asked for.
    """
    router = APIRouter(prefix="/v1", tags=["asking"])
    for name, kind in kinds.items():
        if kind.route is None:
            continue
        told, _, more = (kind.request.__doc__ or name).partition("\n")
        result = "" if kind.result is None else f"\n\nThe result follows `{kind.result.__name__}`."
        router.post(
            f"/{kind.route}",
            name=name,
            summary=told.strip().rstrip("."),
            description=f"{told.strip()}\n{more.strip()}{result}",
            status_code=HTTPStatus.ACCEPTED,
            response_model=JobDocument,
            response_description="It waits or runs",
            responses=described(400, 404, 408, 413, 415, 507)
            | {200: {"model": JobDocument, "description": "It was done before"}},
            openapi_extra=json_body(example_of(kind.request), kind.request),
        )(_asking(name))
    return router


def models(kinds: Mapping[str, Kind]) -> set[type[BaseModel]]:
    """What requests and results of the kinds follow."""
    return {kind.request for kind in kinds.values() if kind.route is not None} | {
        kind.result for kind in kinds.values() if kind.result is not None
    }


def example_of(model: type[BaseModel]) -> dict[str, Any]:
    """A request made of the examples of its fields."""
    return {
        field.alias or name: field.examples[0] for name, field in model.model_fields.items() if field.examples
    }


def _asking(kind: str) -> Callable[[Request, Owner, Desk], Awaitable[Response]]:
    async def ask(request: Request, owner: Owner, service: Desk) -> Response:
        asked = await read_json(request)
        row, _ = await writing(service.ask, owner, kind, asked)
        status = HTTPStatus.OK if row.state is State.DONE else HTTPStatus.ACCEPTED
        return JSONResponse(
            as_document(row).model_dump(mode="json"), status, headers={"Location": f"/v1/jobs/{row.id}"}
        )

    return ask
