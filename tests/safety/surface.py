"""The public surface in a reduced form: options of commands, Python names, the HTTP interface."""

from __future__ import annotations

import importlib
import inspect
import io
import os
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import requests

import scaling_service
from tests.safety.running import ROOT
from tests.safety.serving import serve

PROGRAM = "scaling-service"
_WIDE = {"COLUMNS": "2000", "NO_COLOR": "1", "TERM": "dumb"}
"""A screen on which each option's help is one line."""


def read_commands() -> dict[str, Any]:
    """Every command's arguments and options: what they take, their defaults, whether they must be given."""
    found: dict[str, Any] = {}
    _read_command([], _load_program(), found)
    return found


def _load_program() -> Callable[[list[str]], int]:
    """The function that the package declares as its program."""
    scripts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["scripts"]
    module, _, name = scripts[PROGRAM].partition(":")
    program: Callable[[list[str]], int] = getattr(importlib.import_module(module), name)
    return program


def _read_command(words: list[str], program: Callable[[list[str]], int], found: dict[str, Any]) -> None:
    with _wide_screen(), redirect_stdout(io.StringIO()) as screen:
        assert program([*words, "--help"]) == 0
    boxes = list(_read_boxes(screen.getvalue()))
    rows = [row for title, row in boxes if title != "Commands"]
    found[" ".join([PROGRAM, *words])] = dict(sorted(map(_read_option, rows)))
    for command in (row.split()[0] for title, row in boxes if title == "Commands"):
        _read_command([*words, command], program, found)


@contextmanager
def _wide_screen() -> Iterator[None]:
    before = {name: os.environ.get(name) for name in _WIDE}
    os.environ.update(_WIDE)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _read_boxes(text: str) -> Iterator[tuple[str, str]]:
    """Every row of the help's boxes with its box's title."""
    title = ""
    for line in text.splitlines():
        if line.startswith("╭"):
            title = line.strip("╭─╮ ")
        elif line.startswith("│"):
            yield title, line.strip("│ ")


def _read_option(row: str) -> tuple[str, str]:
    """Its names, and what it takes with its default."""
    cells = re.split(r" {2,}", row.removeprefix("*").strip())
    names = [cell for cell in cells if cell.startswith("-")] or cells[:1]
    takes = next(cell for cell in cells if cell not in names)
    default = re.search(r"\[default: (.*?)\]", row)
    needed = ", required" if "[required]" in row else ""
    return " ".join(names), takes + (f", default {default[1]}" if default else "") + needed


def read_python() -> dict[str, Any]:
    """Every public name with its signature; of a class its public attributes, too."""
    return {name: _read_name(getattr(scaling_service, name)) for name in sorted(scaling_service.__all__)}


def _read_name(value: Any) -> Any:
    if not inspect.isclass(value):
        return _read_signature(value)
    if issubclass(value, Exception):
        return {"is": [base.__name__ for base in value.__mro__[1:]], "call": _read_signature(value)}
    members = {name: getattr(value, name, None) for name in _public_members(value)}
    return {
        "call": _read_signature(value),
        "members": {
            name: _read_signature(member) if callable(member) else "value"
            for name, member in sorted(members.items())
        },
    }


def _public_members(value: type) -> set[str]:
    fields = getattr(value, "__dataclass_fields__", {})
    return {name for name in [*dir(value), *fields] if not name.startswith("_")}


def _read_signature(value: Any) -> list[str]:
    """Each parameter with its default; types are left out, for they may be named anew."""
    parameters = inspect.signature(value).parameters.values()
    return [str(p.replace(annotation=inspect.Parameter.empty)) + _read_kind(p) for p in parameters]


def _read_kind(parameter: inspect.Parameter) -> str:
    return " (by name)" if parameter.kind is inspect.Parameter.KEYWORD_ONLY else ""


def read_http() -> dict[str, Any]:
    """Every route with its parameters, its request's and answers' properties, and those of all documents."""
    with TemporaryDirectory() as folder, serve(Path(folder)) as url:
        document = requests.get(f"{url}/openapi.json", timeout=30).json()
    routes = {
        f"{method.upper()} {path}": _read_operation(operation, document)
        for path, operations in sorted(document["paths"].items())
        for method, operation in sorted(operations.items())
    }
    # Results are documents of many kinds, so that no route names theirs.
    schemas = document["components"]["schemas"]
    return routes | {
        f"schema {name}": _expand(one, document, (name,)) for name, one in sorted(schemas.items())
    }


def _read_operation(operation: Mapping[str, Any], document: Mapping[str, Any]) -> dict[str, Any]:
    parameters = {
        f"{p['name']} in {p['in']}" + (", required" if p.get("required") else ""): _expand(
            p.get("schema", {}), document
        )
        for p in operation.get("parameters", ())
    }
    answers = {
        status: _expand_content(answer, document)
        for status, answer in sorted(operation["responses"].items())
        if status.startswith("2")
    }
    refusals = sorted(status for status in operation["responses"] if not status.startswith("2"))
    request = _expand_content(operation.get("requestBody", {}), document)
    return {"parameters": parameters, "request": request, "answers": answers, "refusals": refusals}


def _expand_content(holder: Mapping[str, Any], document: Mapping[str, Any]) -> dict[str, Any]:
    content = holder.get("content", {})
    return {kind: _expand(held.get("schema", {}), document) for kind, held in sorted(content.items())}


def _expand(schema: Any, document: Mapping[str, Any], within: tuple[str, ...] = ()) -> Any:
    """A schema as the names of its properties, nested; at the leaves their types, choices and defaults."""
    if not isinstance(schema, dict):
        return schema
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        if name in within:
            return "again"
        return _expand(document["components"]["schemas"][name], document, (*within, name))
    for key in ("anyOf", "oneOf"):
        if key in schema:
            some = [_expand(one, document, within) for one in schema[key]]
            return _with_default(" or ".join(some) if all(isinstance(s, str) for s in some) else some, schema)
    if "properties" in schema:
        needed = schema.get("required", ())
        return {
            name + (" (required)" if name in needed else ""): _expand(one, document, within)
            for name, one in sorted(schema["properties"].items())
        }
    if "items" in schema:
        return _with_default([_expand(schema["items"], document, within)], schema)
    if isinstance(schema.get("additionalProperties"), dict):
        return _with_default({"(any)": _expand(schema["additionalProperties"], document, within)}, schema)
    return _with_default(_leaf(schema), schema)


def _leaf(schema: Mapping[str, Any]) -> str:
    kind = str(schema.get("type", "any"))
    if "const" in schema:
        return f"{kind} {schema['const']}"
    if "enum" in schema:
        return f"{kind} {'|'.join(map(str, schema['enum']))}"
    return kind


def _with_default(found: Any, schema: Mapping[str, Any]) -> Any:
    if "default" not in schema:
        return found
    if isinstance(found, str):
        return f"{found}, default {schema['default']!r}"
    return {"of": found, "default": schema["default"]}


SURFACES: Mapping[str, Callable[[], Any]] = {
    "surface_commands": read_commands,
    "surface_python": read_python,
    "surface_http": read_http,
}
"""Snapshots' names, and what makes them."""
