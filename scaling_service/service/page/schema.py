"""Makes the page's TypeScript types from the OpenAPI document: ``python schema.py`` writes them.

They are committed, for Node bundles the page where the service is not installed; a test makes them anew.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

TARGET = Path(__file__).with_name("src") / "api" / "schema.ts"
_HEAD = "/** What travels between service and page, made from the OpenAPI document by schema.py. */\n"
_PLAIN = {"integer": "number", "number": "number", "string": "string", "boolean": "boolean", "null": "null"}


def write_typescript(document: Mapping[str, Any]) -> str:
    """An exported type for each schema of an OpenAPI document, and where each kind of job is asked for."""
    schemas = document["components"]["schemas"]
    routes = {
        operation["operationId"]: path.removeprefix("/v1/")
        for path, operations in document["paths"].items()
        for operation in operations.values()
        if "asking" in operation.get("tags", ())
    }
    kinds = f"export const ROUTES: Record<string, string> = {json.dumps(routes, indent=2)};"
    types = (
        f"\nexport interface {name} {{\n{_write_fields(schemas[name])}}}\n"
        if "properties" in schemas[name]
        else f"\nexport type {name} = {_write_type(schemas[name])};\n"
        for name in sorted(schemas)
    )
    return "\n".join((_HEAD, "/** Kind of job to its route. */", kinds, "")) + "".join(types)


def _write_fields(schema: Mapping[str, Any]) -> str:
    always = schema.get("required", ())
    return "".join(
        f"  {name}{'' if name in always else '?'}: {_write_type(field)};\n"
        for name, field in schema["properties"].items()
    )


def _write_type(schema: Mapping[str, Any]) -> str:
    match schema:
        case {"$ref": str(place)}:
            return place.rpartition("/")[2]
        case {"anyOf": choices}:
            return " | ".join(dict.fromkeys(map(_write_type, choices)))
        case {"const": value}:
            return json.dumps(value)
        case {"enum": values}:
            return " | ".join(map(json.dumps, values))
        case {"type": "array", "prefixItems": items}:
            return f"[{', '.join(map(_write_type, items))}]"
        case {"type": "array", "items": item}:
            return f"Array<{_write_type(item)}>"
        case {"type": "object", "additionalProperties": dict(value)}:
            return f"Record<string, {_write_type(value)}>"
        case {"type": "object", "patternProperties": dict(values)}:
            return f"Record<string, {' | '.join(map(_write_type, values.values()))}>"
        case {"type": "object"}:
            return "Record<string, unknown>"
        case {"type": str(kind)}:
            return _PLAIN[kind]
    return "unknown"


def make_openapi() -> dict[str, Any]:
    """The OpenAPI document of a service without anything in it."""
    from scaling_service.service.http.app import create_app
    from scaling_service.service.jobs.service import Service
    from scaling_service.service.jobs.settings import ServiceSettings

    with tempfile.TemporaryDirectory() as folder:
        settings = ServiceSettings(data_directory=Path(folder) / "data")
        with closing(Service.open(settings)) as service:
            return create_app(service, loopback=True).openapi()


if __name__ == "__main__":
    TARGET.write_text(write_typescript(make_openapi()), encoding="utf-8")
