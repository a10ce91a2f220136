"""The route that gives links to files for browsers, which send no key when they follow a link."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from http import HTTPStatus
from typing import Any
from urllib.parse import quote, unquote

from fastapi import APIRouter, Request
from pydantic import ValidationError

from scaling_service.documents.service import Link, LinkRequest
from scaling_service.service.http.bodies import read_json
from scaling_service.service.http.callers import Asked, Owner
from scaling_service.service.http.openapi import json_body
from scaling_service.service.http.problems import described
from scaling_service.service.http.tickets import PARAMETER
from scaling_service.service.jobs.submission import RequestInvalid

router = APIRouter(prefix="/v1/links", tags=["jobs"])

_FILE = re.compile(r"/v1/(jobs/[0-9a-f]{64}/(files\.zip|files/.+)|subjects/[^/]+/files/[^/]+)")


DOCUMENTS = (LinkRequest,)
EXAMPLE: dict[str, Any] = {"path": f"/v1/jobs/{'0' * 64}/files.zip"}


@router.post(
    "",
    status_code=HTTPStatus.CREATED,
    responses=described(400, 408, 413, 415),
    openapi_extra=json_body(EXAMPLE, LinkRequest),
)
async def make_link(request: Request, owner: Owner, callers: Asked) -> Link:
    """Make a link to a file that works for a minute without a key.

    Browsers send no key when they open a link or stream a download to the disk. Whoever has the link can
    fetch that file, and nothing else, until then.
    """
    try:
        wanted = unquote(LinkRequest.model_validate(await read_json(request)).path)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise RequestInvalid(
            str(first["msg"]), field=".".join(map(str, first["loc"])), remedy="Give `path` alone"
        ) from None
    if not _FILE.fullmatch(wanted):
        raise RequestInvalid(
            "this is no path of a file",
            field="path",
            remedy="Give one of a job's links, such as /v1/jobs/ID/files.zip",
        )
    ticket, until_s = callers.tickets.issue(owner, wanted)
    return Link(path=f"{quote(wanted)}?{PARAMETER}={ticket}", until=datetime.fromtimestamp(until_s, UTC))
