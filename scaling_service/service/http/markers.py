"""Routes of the labels that a laboratory gives to markers."""

from __future__ import annotations

import json
from typing import Any

from fastapi import APIRouter, Request
from pydantic import ValidationError

from scaling_service.documents.service import MarkerMap, MarkerMapDocument
from scaling_service.service.http.bodies import read_json
from scaling_service.service.http.callers import Desk, Owner
from scaling_service.service.http.openapi import json_body
from scaling_service.service.http.problems import described
from scaling_service.service.http.subjects import moment
from scaling_service.service.http.threads import writing
from scaling_service.service.jobs.submission import RequestInvalid
from scaling_service.service.store.rows import MarkerMapRow

router = APIRouter(prefix="/v1/marker-map", tags=["subjects"])

DOCUMENTS = (MarkerMap,)
"""What a map follows."""

EXAMPLE: dict[str, Any] = {"labels": {"RKN": "RLFE", "LKN": "LLFE"}}


@router.get("", responses=described())
def get_marker_map(owner: Owner, service: Desk) -> MarkerMapDocument:
    """Look at the laboratory's marker map: which label is which marker. It is empty until one is given."""
    return _document(service.marker_map(owner))


@router.put(
    "",
    response_model=MarkerMapDocument,
    responses=described(400, 408, 413, 415, 507),
    openapi_extra=json_body(EXAMPLE, MarkerMap),
)
async def put_marker_map(request: Request, owner: Owner, service: Desk) -> MarkerMapDocument:
    """Keep the laboratory's marker map, in place of the one before.

    It is one for each owner of keys. Give its `labels` with a request for a proof, and they are proposed.
    """
    content = await read_json(request)
    try:
        given = MarkerMap.model_validate(content)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise RequestInvalid(
            str(first["msg"]),
            field=".".join(str(part) for part in first["loc"]),
            remedy="Give texts of 1 to 200 letters, label first, under `labels`",
        ) from None
    return _document(await writing(service.put_marker_map, owner, given.labels))


def _document(row: MarkerMapRow | None) -> MarkerMapDocument:
    if row is None:
        return MarkerMapDocument(labels={}, updated_at=None)
    return MarkerMapDocument(labels=json.loads(row.document), updated_at=moment(row.updated_us))
