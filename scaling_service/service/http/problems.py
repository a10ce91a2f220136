"""Errors as problem documents (RFC 9457), with the texts of the command line; a defect is one, too."""

from __future__ import annotations

from http import HTTPStatus
from typing import Any

import fastapi
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException
from starlette.routing import Match
from starlette.types import Scope

from scaling_service.core.errors import InputError
from scaling_service.documents.service import Problem
from scaling_service.service.jobs.example import ExampleFailed
from scaling_service.service.jobs.ledger import QueueFull
from scaling_service.service.jobs.submission import RequestInvalid
from scaling_service.service.store import errors
from scaling_service.service.store.links import TooManyLinks
from scaling_service.service.store.room import QuotaReached

MEDIA_TYPE = "application/problem+json"

_METHODS = ("DELETE", "GET", "HEAD", "PATCH", "POST", "PUT")

RETRY_S = {429: 5, 503: 5, 507: 60}
"""Status to the seconds of ``Retry-After``. Chosen: soon where it may pass by itself, later where
somebody must make room."""


class KeyNeeded(InputError):
    """The request comes without a key, or with one that opens nothing."""


class TooManyRequests(InputError):
    """A caller asks faster, or for more at once, than is allowed."""

    def __init__(self, wait_s: float, problem: str = "requests come faster than is allowed") -> None:
        super().__init__(problem, remedy=f"Wait {wait_s:.1f} s, and ask less often")
        self.wait_s = wait_s


class BodyUnreadable(InputError):
    """The body is not JSON that can be used."""


class WrongMediaType(InputError):
    """The body is announced as something else than what is wanted."""


class TooSlow(InputError):
    """The body does not come."""


class WrongHost(InputError):
    """The request was meant for another server."""


class ForeignOrigin(InputError):
    """The request comes from a page of another site."""


class RangeUnsatisfiable(InputError):
    """The range begins beyond the end of the file."""

    def __init__(self, size: int) -> None:
        super().__init__(
            f"the file has {size} bytes, and the range begins after them",
            field="Range",
            remedy="Ask for bytes that it has",
        )
        self.size = size


_STATUS: tuple[tuple[type[InputError], int], ...] = (
    (errors.NotFound, 404),
    (errors.InUse, 409),
    (errors.TooLarge, 413),
    (QueueFull, 429),
    (TooManyRequests, 429),
    (TooManyLinks, 429),
    (errors.StoreFull, 507),
    (QuotaReached, 507),
    (errors.StoreUnavailable, 503),
    (KeyNeeded, 401),
    (BodyUnreadable, 400),
    (WrongMediaType, 415),
    (TooSlow, 408),
    (WrongHost, 421),
    (ForeignOrigin, 403),
    (RangeUnsatisfiable, 416),
    (ExampleFailed, 500),
    (InputError, 422),
)
"""The first that fits counts."""


def answer_problem(error: InputError, status: int | None = None) -> JSONResponse:
    """An error as the answer to a request."""
    name = type(error).__name__
    code = status or next(status for kind, status in _STATUS if isinstance(error, kind))
    if isinstance(error, errors.StoreUnavailable):  # where it lies on this machine is no client's business
        error = errors.StoreUnavailable(error.problem, remedy=error.remedy)
    document = Problem(
        type=f"urn:scaling-service:{name}",
        title=HTTPStatus(code).phrase,
        status=code,
        detail=str(error),
        problem=error.problem,
        file=error.file,
        field=error.field,
        remedy=error.remedy,
    )
    headers = {"Cache-Control": "no-store"}
    if code in RETRY_S:
        wait_s = error.wait_s if isinstance(error, TooManyRequests) else RETRY_S[code]
        headers["Retry-After"] = str(max(1, round(wait_s + 0.5)))
    if isinstance(error, RangeUnsatisfiable):
        headers["Content-Range"] = f"bytes */{error.size}"
    if code == HTTPStatus.UNAUTHORIZED:
        headers["WWW-Authenticate"] = "Bearer"
    return JSONResponse(document.model_dump(mode="json"), code, headers, MEDIA_TYPE)


Responses = dict[int | str, dict[str, Any]]  # of a route, by status


def describe_refusals(*statuses: int) -> Responses:
    """The problems that a route can answer with, for the OpenAPI document."""
    always = (401, 403, 421, 422, 429, 500, 503)
    content = {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}}
    return {
        code: {"description": HTTPStatus(code).phrase, "content": content}
        for code in sorted({*statuses, *always})
    }


def install(app: fastapi.FastAPI) -> None:
    """Let every error leave as a problem document."""

    async def answer_refused(_request: fastapi.Request, error: Exception) -> JSONResponse:
        assert isinstance(error, InputError)
        return answer_problem(error)

    async def answer_invalid(_request: fastapi.Request, error: Exception) -> JSONResponse:
        assert isinstance(error, RequestValidationError)
        first = error.errors()[0]
        where, said = ".".join(str(part) for part in first["loc"][1:]), str(first["msg"])
        return answer_problem(RequestInvalid(said, field=where, remedy="Correct it; /docs shows examples"))

    async def answer_no_route(request: fastapi.Request, error: Exception) -> JSONResponse:
        assert isinstance(error, HTTPException)
        phrase = HTTPStatus(error.status_code).phrase
        answer = answer_problem(
            InputError(phrase.lower(), remedy="/docs shows what there is"), error.status_code
        )
        if error.status_code == HTTPStatus.METHOD_NOT_ALLOWED:
            answer.headers["Allow"] = ", ".join(sorted(list_allowed_methods(request.app, request.scope)))
        return answer

    app.add_exception_handler(InputError, answer_refused)
    app.add_exception_handler(RequestValidationError, answer_invalid)
    app.add_exception_handler(HTTPException, answer_no_route)


def list_allowed_methods(app: fastapi.FastAPI, scope: Scope) -> set[str]:
    """All methods that some route answers at the path of a request."""
    return {
        method
        for method in _METHODS
        if any(route.matches({**scope, "method": method})[0] is Match.FULL for route in app.routes)
    }
