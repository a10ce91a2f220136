"""A body model as a plain document, and back, exactly: the content of ``model.json``.

The document mirrors the dataclasses of ``body`` field by field, so a
field added there travels without a change here. Fields that stand at their default are left out.
Infinite bounds are the strings ``"inf"`` and ``"-inf"``, for JSON has no such number.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from functools import cache
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from scaling_service.core.errors import InputError, ModelRefused
from scaling_service.model.body import BodyModel, Law, Segment

SCHEMA_VERSION = 1
"""Raised when a document written before can no longer be read by the code after."""

_INFINITE = {"inf": math.inf, "-inf": -math.inf}
_UNIT_TOLERANCE = 1e-9  # chosen: about a hundred roundings of a double above a normalised axis


def to_document(model: BodyModel) -> dict[str, Any]:
    """A model as dictionaries, lists, strings, numbers and booleans.

    Returns
    -------
    dict
        Accepted by ``json.dumps(..., allow_nan=False)``; m, rad, kg and kg m2 throughout.

    Raises
    ------
    ValueError
        If the model holds a NaN.

    Examples
    --------
    >>> from scaling_service.model.body import BodyModel, Segment
    >>> model = BodyModel("ball", (Segment("ball", "ground", "free", (), mass=0.4),), ())
    >>> to_document(model)["segments"]
    [{'name': 'ball', 'parent': 'ground', 'joint_name': 'free', 'joints': [], 'mass': 0.4}]
    >>> from_document(to_document(model)) == model
    True
    """
    content = _encode(model)
    assert isinstance(content, dict)
    return {"schema_version": SCHEMA_VERSION, **content}


def from_document(document: Mapping[str, Any], *, file: str | Path | None = None) -> BodyModel:
    """The model that a document describes.

    Parameters
    ----------
    document : mapping
        As :func:`to_document` makes it. Unknown keys are errors.
    file : str or Path, optional
        Named in errors.

    Raises
    ------
    InputError
        A key that is unknown or missing, or a value of the wrong kind; its path is the field.
    ModelRefused
        The model is no tree, or a law or marker names something that is not in it.
    """
    at = _Place(str(file) if file is not None else None)
    content = at.mapping(document)
    version = content.pop("schema_version", None)
    if version != SCHEMA_VERSION:
        raise at.key("schema_version").error(
            f"model document of version {version!r}, this program reads {SCHEMA_VERSION}",
            "Write the model again with the present program",
        )
    model = _decode_object(BodyModel, content, at)
    assert isinstance(model, BodyModel)
    _check_names(model, at)
    return model


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
        return _encode_number(value)
    if value is None or isinstance(value, str | bool):
        return value
    raise TypeError(f"a body model holds no {type(value).__name__}")


def _encode_number(value: float) -> float | str:
    if math.isnan(value):
        raise ValueError("a body model holds no NaN")
    number = float(value)
    return ("inf" if number > 0 else "-inf") if math.isinf(number) else number


def _is_default(item: Field[Any], value: object) -> bool:
    # repr tells -0.0 from 0.0, which == does not
    return item.default is not MISSING and value == item.default and repr(value) == repr(item.default)


@dataclass(frozen=True, slots=True)
class _Place:
    """Where in the document a value stands, for errors."""

    file: str | None
    path: str = ""

    def key(self, name: str) -> _Place:
        return _Place(self.file, f"{self.path}.{name}" if self.path else name)

    def item(self, number: int) -> _Place:
        return _Place(self.file, f"{self.path}[{number}]")

    def error(self, problem: str, remedy: str) -> InputError:
        return InputError(problem, file=self.file, field=self.path or None, remedy=remedy)

    def wrong(self, value: object, wanted: str) -> InputError:
        return self.error(f"{value!r} is not {wanted}", f"Give {wanted}")

    def mapping(self, value: object) -> dict[str, Any]:
        if not isinstance(value, Mapping):
            raise self.wrong(value, "a mapping of keys to values")
        return dict(value)

    def sequence(self, value: object) -> list[Any]:
        if not isinstance(value, list | tuple):
            raise self.wrong(value, "a list")
        return list(value)


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def _decode_object(kind: type, value: object, at: _Place) -> object:
    content = at.mapping(value)
    known = {f.name: f for f in fields(kind)}
    for name in content:
        if name not in known:
            raise at.key(str(name)).error("unknown key", f"Keys here are {', '.join(known)}")
    for name, item in known.items():
        if name not in content and item.default is MISSING:
            raise at.key(name).error("missing key", "Add it")
    hints = _hints(kind)
    return kind(**{name: _decode(hints[name], v, at.key(name)) for name, v in content.items()})


def _decode(hint: Any, value: object, at: _Place) -> object:
    origin, inner = get_origin(hint), get_args(hint)
    if origin is tuple:
        return _decode_tuple(inner, value, at)
    if origin in (Union, UnionType):
        (other,) = (a for a in inner if a is not NoneType)
        return None if value is None else _decode(other, value, at)
    if origin is Literal:
        if value not in inner:
            raise at.wrong(value, f"one of {', '.join(map(str, inner))}")
        return value
    if is_dataclass(hint) and isinstance(hint, type):
        return _decode_object(hint, value, at)
    if hint is float:
        return _decode_number(value, at)
    if not isinstance(value, hint):
        raise at.wrong(value, {str: "a text", bool: "true or false"}[hint])
    return value


def _decode_tuple(inner: tuple[Any, ...], value: object, at: _Place) -> tuple[object, ...]:
    items = at.sequence(value)
    kinds = [inner[0]] * len(items) if inner[-1] is Ellipsis else list(inner)
    if len(items) != len(kinds):
        raise at.wrong(value, f"a list of {len(kinds)}")
    return tuple(_decode(k, v, at.item(n)) for n, (k, v) in enumerate(zip(kinds, items, strict=True)))


def _decode_number(value: object, at: _Place) -> float:
    if isinstance(value, str) and value in _INFINITE:
        return _INFINITE[value]
    if isinstance(value, bool) or not isinstance(value, int | float) or not _is_finite(value):
        raise at.wrong(value, "a number")
    return float(value)


def _is_finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number beyond what a double holds
        return False


def _check_names(model: BodyModel, at: _Place) -> None:
    """Every coordinate, parameter and segment that is named must exist, every axis be a unit vector."""
    coordinates, parameters = set(model.coordinate_names), {p.name for p in model.parameters}

    def check(law: Law, where: str) -> None:
        for term in law.terms:
            _must_exist(term.coordinate, coordinates, "coordinate", where, at)
            _must_exist(term.parameter, parameters, "parameter", where, at)

    for segment in model.segments:
        _check_joints(segment, set(model.segment_names), at)
        for joint in segment.joints:
            check(joint.law, segment.joint_name)
    for marker in model.markers:
        for law in marker.laws:
            check(law, marker.name)
    for coupler in model.couplers:
        check(coupler.law, coupler.dependent)
        _must_exist(coupler.independent, coordinates, "coordinate", coupler.dependent, at)


def _check_joints(segment: Segment, segments: set[str], at: _Place) -> None:
    for joint in segment.joints:
        _must_exist(joint.scales_with, segments, "segment", segment.joint_name, at)
        if abs(math.hypot(*joint.axis) - 1.0) > _UNIT_TOLERANCE:
            raise ModelRefused(
                f"the axis {joint.axis} is not of length 1",
                file=at.file,
                field=segment.joint_name,
                remedy="Divide the axis by its length",
            )


def _must_exist(name: str | None, known: set[str], what: str, where: str, at: _Place) -> None:
    if name is not None and name not in known:
        raise ModelRefused(
            f"{what} '{name}' is not in the model", file=at.file, field=where, remedy=f"Declare the {what}"
        )
