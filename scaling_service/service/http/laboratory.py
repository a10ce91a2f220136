"""Routes of what a laboratory has: the names that are used, its labels of markers, an example to try."""

from __future__ import annotations

import json
from functools import cache
from http import HTTPStatus
from typing import Annotated, Any

import fastapi

from scaling_service.capabilities.discovery.result import QuantityDocument
from scaling_service.documents import service as contracts
from scaling_service.service.http import bodies, callers
from scaling_service.service.http.documentation import describe_json_body
from scaling_service.service.http.problems import describe_refusals
from scaling_service.service.http.subjects import as_datetime
from scaling_service.service.jobs.example import MOST, Examples
from scaling_service.service.store.tables import WrittenRow

router = fastapi.APIRouter(prefix="/v1", tags=["subjects"])

DOCUMENTS = (contracts.MarkerMap,)  # what a map of labels follows

EXAMPLE: dict[str, Any] = {"labels": {"RKN": "RLFE", "LKN": "LLFE"}}

_FEET = {"calcn_r", "calcn_l"}  # segments that the ground's forces act on

Persons = Annotated[int, fastapi.Query(ge=1, le=MOST, description="How many; more than one make a cohort.")]


@router.post(
    "/examples",
    status_code=HTTPStatus.CREATED,
    responses=describe_refusals(409, 413, 507)
    | {200: {"model": contracts.ExampleList, "description": "They were there"}},
)
async def put_examples(
    request: fastapi.Request, response: fastapi.Response, owner: callers.Owner, persons: Persons = 1
) -> contracts.ExampleList:
    """Put the built-in example among the caller's subjects.

    It is a virtual person with recordings of standing, hip and knee movements and walking, with bones and
    image markers. In the recordings two things are hidden for a discovery to find. It takes seconds.
    """
    examples: Examples = request.app.state.examples
    names, new = await bodies.in_writer_thread(examples.put, owner, persons)
    response.status_code = HTTPStatus.CREATED if new else HTTPStatus.OK
    return contracts.ExampleList(subjects=names)


@router.get("/vocabulary", responses=describe_refusals())
def get_vocabulary(owner: callers.Owner) -> contracts.Vocabulary:  # noqa: ARG001 (a key is needed where the service has keys)
    """List the built-in models with their markers, the methods, and the bones that can be given."""
    return list_vocabulary()


@router.get("/marker-map", responses=describe_refusals())
def get_marker_map(owner: callers.Owner, service: callers.ServiceDep) -> contracts.MarkerMapDocument:
    """Look at the laboratory's marker map: which label is which marker. It is empty until one is given."""
    return _make_document(service.marker_map(owner))


@router.put(
    "/marker-map",
    responses=describe_refusals(400, 408, 413, 415, 507),
    openapi_extra=describe_json_body(EXAMPLE, contracts.MarkerMap),
)
async def put_marker_map(
    request: fastapi.Request, owner: callers.Owner, service: callers.ServiceDep
) -> contracts.MarkerMapDocument:
    """Keep the laboratory's marker map, in place of the one before.

    It is one for each owner of keys. Give its `labels` with a request for a proof, and they are proposed.
    """
    remedy = "Give texts of 1 to 200 letters, label first, under `labels`"
    given = await bodies.read_model(contracts.MarkerMap, request, remedy)
    return _make_document(await bodies.in_writer_thread(service.put_marker_map, owner, given.labels))


def _make_document(row: WrittenRow | None) -> contracts.MarkerMapDocument:
    if row is None:
        return contracts.MarkerMapDocument(labels={}, updated_at=None)
    return contracts.MarkerMapDocument(
        labels=json.loads(row.document), updated_at=as_datetime(row.updated_us)
    )


@cache
def list_vocabulary() -> contracts.Vocabulary:
    """All names that come with the product."""
    # What computes is loaded by the first who asks: a service starts without it.
    from scaling_service.bones.whole import BONES
    from scaling_service.capabilities.discovery.words import describe_effect
    from scaling_service.capabilities.scaling.clinical_gait import list_gait_angles
    from scaling_service.capabilities.scaling.methods.table import METHODS
    from scaling_service.model import builtin
    from scaling_service.virtual import example

    hidden_in_example = []
    for one in (example.SLIDING, example.SWAPPED):
        trials = () if one.trial is None else (one.trial,)
        sizes = {name: QuantityDocument(value=value, sd=None) for name, value in one.parameters.items()}
        hidden_in_example.append(describe_effect(one.kind, one.where, one.driver, trials, sizes))
    models = []
    for name in builtin.BUILTIN_NAMES:
        model = builtin.load_builtin(name)
        models.append(
            contracts.ModelWord(
                name=model.name,
                segments=list(model.segment_names),
                markers=[
                    contracts.MarkerWord(name=m.name, segment=m.segment, anatomical=m.anatomical)
                    for m in model.markers
                    if m.weight > 0.0
                ],
                coordinates=[
                    contracts.CoordinateWord(name=c.name, unit="deg" if c.kind == "rotation" else "m")
                    for c in model.coordinates
                ],
                feet=set(model.segment_names) >= _FEET,
            )
        )
    return contracts.Vocabulary(
        models=models,
        methods=[
            contracts.MethodWord(name=name, meaning=m.title, starts_from=m.needs, needs_images=m.needs_images)
            for name, m in METHODS.items()
        ],
        bones=list(BONES),
        gait_angles=list_gait_angles(),
        hidden_in_example=hidden_in_example,
    )
