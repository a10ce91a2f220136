"""The documents of results: they hold the contract's keys, survive JSON, and refuse what JSON lacks."""

from __future__ import annotations

import json
from typing import Any

import pytest
from pydantic import ValidationError

from scaling_service.documents.results import ComparisonDocument, MethodResult, ScalingDocument, TrialError

ERROR: dict[str, Any] = {
    "role": "evaluation",
    "mean": 6.5,
    "sd": 1.2,
    "rms": 7.1,
    "max": 15.0,
    "anatomical_mean": 5.0,
    "tracking_mean": None,
    "frames": 100,
    "per_marker": {"RASI": 5.1},
}
METHOD: dict[str, Any] = {
    "method": "MB_am",
    "kinematic_error_mm": {"Walking01": ERROR},
    "segment_lengths_mm": {"inter_hip": 173.5, "femur_r": 431.8, "shank_r": 415.7},
    "joint_centres_mm": {"hip_r": {"frame": "pelvis", "xyz": [0, 0, 0]}},
    "knee_axis_deg": {"r": {"x": 1.9, "y": -2.0}},
    "marker_shift_mm": {"RASI": 4.2},
    "scale_factors": {"pelvis": [1, 1, 1]},
    "parameters": [
        {
            "name": "axis.knee_r.x",
            "value": 0.0,
            "unit": "rad",
            "sd": None,
            "at_bound": False,
            "identifiable": True,
        }
    ],
    "cumulative_error_mm2": None,
    "iterations": 7,
    "wall_s": {"calibration": 0.1, "inverse_kinematics": 0.05},
    "warnings": [],
    "files": ["model.json"],
}
PROVENANCE: dict[str, Any] = {
    "code_version": "0.1.0",
    "subject": "S01",
    "settings": {"up": None},
    "input_hashes": {"S01.yaml": "0" * 64},
    "seed": 0,
    "markers_used": {"RLFE": ["RKNE"]},
    "repairs": {"Walking01": [{"what": "unit", "where": "X", "detail": "mm", "frames": 0}]},
}
CONTRACT = {
    "method",
    "kinematic_error_mm",
    "segment_lengths_mm",
    "joint_centres_mm",
    "knee_axis_deg",
    "marker_shift_mm",
    "parameters",
    "iterations",
    "wall_s",
    "warnings",
}


def test_scaling_document_holds_the_contract_and_the_provenance() -> None:
    written = json.loads(ScalingDocument(**PROVENANCE, **METHOD).model_dump_json())
    assert set(written) >= CONTRACT
    assert {"schema_version", "settings", "code_version", "input_hashes", "seed"} <= set(written)
    assert ScalingDocument(**written) == ScalingDocument(**PROVENANCE, **METHOD)


def test_comparison_document_holds_methods_by_name() -> None:
    document = ComparisonDocument(
        **PROVENANCE, methods={"MB_am": MethodResult(**METHOD)}, warnings=[], wall_s=1.0
    )
    written = json.loads(document.model_dump_json())
    assert written["methods"]["MB_am"]["kinematic_error_mm"]["Walking01"]["per_marker"] == {"RASI": 5.1}
    assert ComparisonDocument(**written) == document


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_what_json_has_no_number_for_is_refused(value: float) -> None:
    with pytest.raises(ValidationError, match="finite"):
        TrialError(**ERROR | {"mean": value})


def test_unknown_keys_are_refused() -> None:
    with pytest.raises(ValidationError, match="extra"):
        TrialError(**ERROR | {"median": 1.0})
