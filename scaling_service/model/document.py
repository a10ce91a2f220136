"""A body model as a plain document, and back, exactly: the content of ``model.json``.

The document mirrors the dataclasses of ``body`` field by field, so a
field added there travels without a change here. Fields that stand at their default are left out.
Infinite bounds are the strings ``"inf"`` and ``"-inf"``, for JSON has no such number.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

from scaling_service.core import errors
from scaling_service.model import body

if TYPE_CHECKING:
    from pydantic import TypeAdapter

SCHEMA_VERSION = 1
"""Raised when a document written before can no longer be read by the code after."""

_INFINITE = {"inf": math.inf, "-inf": -math.inf}
_UNIT_TOLERANCE = 1e-9  # chosen: about a hundred roundings of a double above a normalised axis


def to_document(model: body.BodyModel) -> dict[str, Any]:
    """A model as dictionaries, lists, strings, numbers and booleans.

    Accepted by ``json.dumps(..., allow_nan=False)``; m, rad, kg and kg m2 throughout.
    Raises ValueError: if the model holds a NaN.

    Examples
    --------
    >>> from scaling_service.model.body import BodyModel, Segment
    >>> ball = Segment(name="ball", parent="ground", joint_name="free", joints=(), mass=0.4)
    >>> model = BodyModel(name="ball", segments=(ball,), coordinates=())
    >>> to_document(model)["segments"]
    [{'name': 'ball', 'parent': 'ground', 'joint_name': 'free', 'joints': [], 'mass': 0.4}]
    >>> from_document(to_document(model)) == model
    True
    """
    content = _encode(model)
    assert isinstance(content, dict)
    return {"schema_version": SCHEMA_VERSION, **content}


def from_document(document: Mapping[str, Any]) -> body.BodyModel:
    """The model that a document describes.

    ``document``: as :func:`to_document` makes it. Unknown keys are errors.
    Raises InputError: a key that is unknown or missing, or a value of the wrong kind; its path is the field.
    Raises ModelRefused: the model is no tree, or a law or marker names something that is not in it.
    """
    if not isinstance(document, Mapping):
        raise errors.InputError("it is not a mapping of keys to values", remedy="Give a model document")
    content = dict(document)
    version = content.pop("schema_version", None)
    if version != SCHEMA_VERSION:
        raise errors.InputError(
            f"model document of version {version!r}, this program reads {SCHEMA_VERSION}",
            field="schema_version",
            remedy="Write the model again with the present program",
        )
    from pydantic import ValidationError

    try:
        (model,) = make_reader().validate_json(json.dumps([_convert_numbers(content)]))
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        kind, place = first["type"], list(first["loc"][1:])
        if kind == "missing" and isinstance(place[-1], int):
            kind, place = "too few", place[:-1]
        problem, remedy = {
            "missing": ("missing key", "Add it"),
            "unexpected_keyword_argument": ("unknown key", "Remove it or correct its spelling"),
            "too few": ("the list is too short", "Add what is missing"),
        }.get(kind, (f"{first['input']!r} does not fit: {first['msg'].lower()}", "Correct the value"))
        path = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in place).lstrip(".")
        raise errors.InputError(problem, field=path or None, remedy=remedy) from None
    _check_names(model)
    return model


@cache
def make_reader() -> TypeAdapter[tuple[body.BodyModel]]:
    """What reads models: making it takes ten times as long as to read one."""
    from pydantic import ConfigDict, TypeAdapter

    # In a tuple, so that the configuration holds for the standard library's dataclasses within.
    return TypeAdapter(tuple[body.BodyModel], config=ConfigDict(extra="forbid", strict=True))


def _convert_numbers(value: Any) -> Any:
    """A document with infinite bounds as numbers, and numbers that JSON does not have as words."""
    if isinstance(value, Mapping):
        return {str(key): _convert_numbers(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_convert_numbers(item) for item in value]
    if isinstance(value, str):
        return _INFINITE.get(value, value)
    return value if not isinstance(value, float) or math.isfinite(value) else str(value)


def _encode(value: object) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        return {
            f.name: _encode(getattr(value, f.name))
            for f in fields(value)
            if not _is_default(f, getattr(value, f.name))
        }
    if isinstance(value, tuple):
        return [_encode(item) for item in value]
    if isinstance(value, float | int) and not isinstance(value, bool):
        if math.isnan(value):
            raise ValueError("a body model holds no NaN")
        number = float(value)
        return ("inf" if number > 0 else "-inf") if math.isinf(number) else number
    if value is None or isinstance(value, str | bool):
        return value
    raise TypeError(f"a body model holds no {type(value).__name__}")


def _is_default(item: Field[Any], value: object) -> bool:
    # repr tells -0.0 from 0.0, which == does not
    return item.default is not MISSING and value == item.default and repr(value) == repr(item.default)


def _check_names(model: body.BodyModel) -> None:
    """Every coordinate, parameter and segment that is named must exist, every axis be a unit vector."""
    known = {
        "coordinate": set(model.coordinate_names),
        "parameter": {p.name for p in model.parameters},
        "segment": set(model.segment_names),
    }

    def require(what: str, name: str | None, where: str) -> None:
        if name is not None and name not in known[what]:
            problem, remedy = f"{what} '{name}' is not in the model", f"Declare the {what}"
            raise errors.ModelRefused(problem, field=where, remedy=remedy)

    laws = [(joint.law, segment.joint_name) for segment, joint in model.joints()]
    for segment, joint in model.joints():
        require("segment", joint.scales_with, segment.joint_name)
        if abs(math.hypot(*joint.axis) - 1.0) > _UNIT_TOLERANCE:
            raise errors.ModelRefused(
                f"the axis {joint.axis} is not of length 1",
                field=segment.joint_name,
                remedy="Divide the axis by its length",
            )
    laws += [(law, marker.name) for marker in model.markers for law in marker.laws]
    for coupler in model.couplers:
        laws.append((coupler.law, coupler.dependent))
        require("coordinate", coupler.independent, coupler.dependent)
    for constraint in model.constraints:
        of_ends = (law for end in constraint.ends for law in end.laws)
        laws += [(law, constraint.name) for law in (constraint.law, *of_ends)]
    for name, _ in model.departures:
        require("coordinate", name, "departures")
    for expected in model.expectations:
        require("coordinate", expected.coordinate, "expectations")
        laws.append((expected.law, expected.coordinate))
    for law, where in laws:
        for term in law.terms:
            for name in term.coordinates:
                require("coordinate", name, where)
            require("parameter", term.parameter, where)
