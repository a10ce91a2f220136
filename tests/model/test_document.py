"""The model document: exact round trip, strict reading."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scaling_service.core.errors import InputError, ModelRefused
from scaling_service.model.body import (
    BodyModel,
    Coordinate,
    Coupler,
    Joint,
    Law,
    Marker,
    Parameter,
    Segment,
    Shape,
    Term,
)
from scaling_service.model.builtin import BUILTIN_NAMES, load_builtin
from scaling_service.model.document import from_document, to_document

finite = st.floats(allow_nan=False, allow_infinity=False)


def through_json(document: dict[str, Any]) -> dict[str, Any]:
    return json.loads(json.dumps(document, allow_nan=False))


def rich_model() -> BodyModel:
    """A model that uses every field away from its default."""
    shape = Shape((0.0, 0.5, 2.0), ((1.0, 0.1, 0.3), (-0.2, 0.7)))
    law = Law((Term(0.25), Term(-1.5, parameter="k", coordinate="knee", shape=shape)))
    glide = Joint("translation", (0.6, 0.0, 0.8), law, scales_with="thigh")
    turn = Joint("rotation", (0.0, 0.0, -1.0), Law.of("knee", 0.5, -0.1))
    thigh = Segment(
        name="thigh",
        parent="ground",
        joint_name="hip",
        joints=(turn,),
        mass=8.1,
        com=(0.1, -0.2, 0.3),
        inertia=(1.0, 2.0, 3.0, -0.1, 0.2, 0.3),
    )
    shank = Segment(name="shank", parent="thigh", joint_name="knee", joints=(glide, turn))
    return BodyModel(
        name="rich",
        segments=(thigh, shank),
        coordinates=(
            Coordinate(
                name="knee", kind="rotation", default=0.1, lower=-2.0, upper=0.3, clamped=True, locked=True
            ),
            Coordinate(name="slide", kind="translation"),
        ),
        markers=(
            Marker(
                name="M",
                segment="shank",
                laws=(law, Law(), Law.constant(1 / 3)),
                weight=2.5,
                anatomical=False,
                follows_size=False,
            ),
        ),
        parameters=(
            Parameter(
                name="k",
                value=1.0,
                unit="1",
                lower=-math.inf,
                upper=math.inf,
                group="length",
                target="thigh",
                prior_sd=0.1,
            ),
        ),
        couplers=(Coupler("slide", "knee", Law.of("knee", 3.0)),),
        source="made up",
    )


@pytest.mark.parametrize("model", [rich_model(), *map(load_builtin, BUILTIN_NAMES)], ids=lambda m: m.name)
def test_round_trip_is_exact(model: BodyModel) -> None:
    assert from_document(through_json(to_document(model))) == model


def test_a_dependent_coordinate_is_no_coordinate_of_the_model() -> None:
    """It stands under the couplers only, as models read from OpenSim have it."""
    ball = BodyModel(
        name="ball",
        segments=(Segment(name="ball", parent="ground", joint_name="free", joints=()),),
        coordinates=(Coordinate(name="knee"),),
    )
    model = replace(ball, couplers=(Coupler("patella", "knee", Law.of("knee", 0.5)),))
    assert from_document(to_document(model)) == model


@given(finite, finite, st.booleans())
def test_every_number_survives(gain: float, lower: float, unbounded: bool) -> None:
    bound = -math.inf if unbounded else lower
    model = BodyModel(
        name="m",
        segments=(
            Segment(
                name="s",
                parent="ground",
                joint_name="j",
                joints=(Joint("rotation", (0.0, 0.0, 1.0), Law((Term(gain),))),),
            ),
        ),
        coordinates=(Coordinate(name="q", default=-0.0, lower=bound),),
        parameters=(
            Parameter(
                name="p", value=gain, unit="m", lower=bound, upper=math.inf, group="length", target="s"
            ),
        ),
    )
    back = from_document(through_json(to_document(model)))
    assert back == model
    assert repr(back) == repr(model)  # tells -0.0 from 0.0


def test_defaults_are_left_out() -> None:
    document = to_document(
        BodyModel(
            name="m",
            segments=(Segment(name="s", parent="ground", joint_name="j", joints=()),),
            coordinates=(Coordinate(name="q"),),
        )
    )
    assert document["coordinates"] == [{"name": "q"}]
    assert "markers" not in document


def test_nan_is_not_written() -> None:
    with pytest.raises(ValueError, match="NaN"):
        to_document(
            BodyModel(
                name="m",
                segments=(Segment(name="s", parent="ground", joint_name="j", joints=(), mass=math.nan),),
                coordinates=(),
            )
        )


def _set(document: dict[str, Any], path: list[Any], value: Any) -> dict[str, Any]:
    place = document
    for step in path[:-1]:
        place = place[step]
    place[path[-1]] = value
    return document


@pytest.mark.parametrize(
    ("path", "value", "field"),
    [
        (["colour"], "red", "colour"),
        (["segments", 1, "weight"], 1.0, "segments[1].weight"),
        (["segments", 0, "mass"], "heavy", "segments[0].mass"),
        (["segments", 0, "mass"], True, "segments[0].mass"),
        (["segments", 0, "com"], [0.0, 1.0], "segments[0].com"),
        (["segments", 1, "joints", 0, "kind"], "screw", "segments[1].joints[0].kind"),
        (
            ["segments", 1, "joints", 0, "law", "terms", 0, "gain"],
            None,
            "segments[1].joints[0].law.terms[0].gain",
        ),
        (["coordinates", 0, "locked"], 1, "coordinates[0].locked"),
        (["markers"], {"M": 1}, "markers"),
        (["schema_version"], 99, "schema_version"),
    ],
)
def test_wrong_content_is_named(path: list[Any], value: Any, field: str) -> None:
    document = _set(through_json(to_document(rich_model())), path, value)
    with pytest.raises(InputError) as caught:
        from_document(document)
    assert caught.value.field == field
    assert caught.value.remedy


def test_missing_key_is_named() -> None:
    document = through_json(to_document(rich_model()))
    del document["segments"][1]["parent"]
    with pytest.raises(InputError, match="missing key") as caught:
        from_document(document)
    assert caught.value.field == "segments[1].parent"


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        (["segments", 1, "joints", 0, "law", "terms", 1, "coordinate"], "elbow", "coordinate 'elbow'"),
        (["segments", 1, "joints", 0, "law", "terms", 1, "parameter"], "nope", "parameter 'nope'"),
        (["segments", 1, "joints", 0, "scales_with"], "foot", "segment 'foot'"),
        (["segments", 1, "joints", 0, "axis"], [1.0, 1.0, 0.0], "length 1"),
        (["markers", 0, "segment"], "foot", "no segment"),
        (["couplers", 0, "independent"], "ankle", "coordinate 'ankle'"),
    ],
)
def test_names_must_exist(path: list[Any], value: Any, said: str) -> None:
    with pytest.raises(ModelRefused, match=said):
        from_document(_set(through_json(to_document(rich_model())), path, value))
