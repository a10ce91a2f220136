"""What can be asked for, as the table of kinds has it."""

from __future__ import annotations

import json
import pickle
from typing import Any, get_args

import pytest
from pydantic import ValidationError

from scaling_service.capabilities.cohort.job import BatchRequest
from scaling_service.capabilities.scaling.job import LinearRequest, OptimisedRequest, ScalingRequest
from scaling_service.capabilities.scaling.methods.optimised import Optimised
from scaling_service.capabilities.scaling.methods.posterior import JointPosterior
from scaling_service.capabilities.scaling.methods.table import METHODS
from scaling_service.service.jobs.kinds import KINDS


def test_every_method_can_be_asked_for_where_it_belongs() -> None:
    linear = set(get_args(LinearRequest.model_fields["method"].annotation))
    optimised = set(OptimisedRequest.model_json_schema()["properties"]["method"]["enum"])
    assert optimised == {n for n, method in METHODS.items() if isinstance(method, Optimised | JointPosterior)}
    assert linear == METHODS.keys() - optimised


@pytest.mark.parametrize("kind", KINDS)
def test_every_row_has_a_function_a_route_and_a_result_and_travels(kind: str) -> None:
    row = KINDS[kind]
    assert row.result is not None
    wholes = [other.parts.kind for other in KINDS.values() if other.parts is not None]
    assert bool(row.route) != (kind in wholes)
    assert pickle.loads(pickle.dumps(row)) == row


def test_a_batch_comes_back_from_json_as_it_went() -> None:
    asked = BatchRequest.model_validate({"subjects": ["S01", "S02"], "groups": {"S01": {"sex": "F"}}})
    travelled = json.loads(json.dumps(asked.model_dump(mode="json")))
    assert travelled["subjects"] == ["S01", "S02"]
    assert BatchRequest.model_validate_json(json.dumps(travelled)) == asked


@pytest.mark.parametrize(
    "request_",
    [
        {"subjects": []},
        {"subjects": ["S01", "s01"]},
        {"subjects": ["../S01"]},
        {"subjects": ["S01"], "groups": {"S01": {"subject": "x"}}},
        {"subjects": ["S01"], "methods": []},
        {"subjects": ["S01"], "batch_subjects": ["S01"]},
    ],
)
def test_batches_that_make_no_sense(request_: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        BatchRequest.model_validate(request_)


@pytest.mark.parametrize(
    "settings",
    [
        {"odd": 1},
        {"calibration": {"odd": 1}},
        {"calibration": {"n_frames": 0}},
        {"calibration": {"n_frames": 10**400}},
        {"calibration": {"n_frames": -1}},
        {"processing": {"cutoff_hz": 1e300}},
    ],
)
def test_settings_that_make_no_sense(settings: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        ScalingRequest.model_validate({"subject": "S01", "settings": settings})
