"""The document of all routes (OpenAPI 3.1), for programs and, as a page without scripts, for people."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping
from functools import cache, partial
from html import escape
from typing import Any

from fastapi import APIRouter, FastAPI, Request
from fastapi.openapi.utils import get_openapi
from fastapi.responses import HTMLResponse
from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaMode, models_json_schema

from scaling_service.service.jobs.kinds import Kind

router = APIRouter(include_in_schema=False)

_STYLE = """
:root { color-scheme: light dark; --line: color-mix(in srgb, currentColor 20%, transparent); }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
h2 { margin-top: 2.5rem; } details { border-top: 1px solid var(--line); padding: .5rem 0; }
summary { cursor: pointer; } code, pre { font: 14px/1.45 ui-monospace, monospace; }
pre { overflow-x: auto; border: 1px solid var(--line); border-radius: 6px; padding: .75rem; }
table { border-collapse: collapse; width: 100%; } td { padding: .2rem .8rem .2rem 0; vertical-align: top; }
.method { display: inline-block; width: 4.5rem; font-weight: 600; } .quiet { opacity: .7; }
"""
_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)

_TITLES = {
    "subjects": "Subjects and their files",
    "asking": "Asking for jobs",
    "jobs": "Jobs and what they made",
    "monitoring": "Monitoring",
}

_SECURITY = {"key": {"type": "http", "scheme": "bearer", "description": "An API key of the service."}}
_ANYWHERE: list[dict[str, list[str]]] = [{"key": []}, {}]
"""A key, or nothing: on the machine itself, while the service has no key."""


_REFERENCE = "#/components/schemas/{model}"


def _reference(name: str) -> dict[str, str]:
    return {"$ref": _REFERENCE.format(model=name)}


RESULT = _reference("JobResult")
"""The schema of what a job finds: one of the kinds' results."""


def json_body(example: dict[str, Any], *models: type[BaseModel]) -> dict[str, Any]:
    """The part of a route's description that tells of its body, which the route reads itself.

    The example runs as it stands; the body follows one of the models, which :func:`install` is told, too.
    """
    choices = [_reference(model.__name__) for model in models]
    schema = choices[0] if len(choices) == 1 else {"anyOf": choices}
    content = {"schema": schema, "examples": {"example": {"value": example}}}
    return {"requestBody": {"required": True, "content": {"application/json": content}}}


class _Schema(GenerateJsonSchema):
    """What the service sends has every field, also those with a default."""

    def field_is_required(self, field: Any, total: bool) -> bool:
        return self.mode == "serialization" or super().field_is_required(field, total)


def install(
    app: FastAPI,
    kinds: Mapping[str, Kind],
    bodies: Iterable[type[BaseModel]],
    answers: Iterable[type[BaseModel]],
) -> None:
    """Have the application describe itself, once.

    What is asked of the kinds of jobs and what they find is described, and the models of bodies and answers
    that no route's signature tells of.
    """
    made = partial(_make_document, app, kinds, tuple(bodies), tuple(answers))
    app.openapi = cache(made)  # type: ignore[method-assign]  # FastAPI's own way to replace its document


def _make_document(
    app: FastAPI,
    kinds: Mapping[str, Kind],
    bodies: Iterable[type[BaseModel]],
    answers: Iterable[type[BaseModel]],
) -> dict[str, Any]:
    asked = {*bodies, *(kind.request for kind in kinds.values() if kind.route is not None)}
    results = {kind.result for kind in kinds.values() if kind.result is not None}
    models: list[tuple[type[BaseModel], JsonSchemaMode]] = [(model, "validation") for model in asked]
    models += [(model, "serialization") for model in results.union(answers)]
    models.sort(key=lambda entry: entry[0].__name__)
    _, more = models_json_schema(models, ref_template=_REFERENCE, schema_generator=_Schema)
    found = get_openapi(
        title=app.title,
        version=app.version,
        description=app.description,
        routes=app.routes,
        tags=app.openapi_tags,
    )
    components = found.setdefault("components", {})
    components["schemas"] = _merge(components.get("schemas", {}), more["$defs"])
    names = sorted(model.__name__ for model in results)
    components["schemas"]["JobResult"] = {"anyOf": [_reference(name) for name in names]} if names else {}
    components["securitySchemes"] = _SECURITY
    for name in ("HTTPValidationError", "ValidationError"):  # problems take their place
        components["schemas"].pop(name, None)
    for path, operations in found["paths"].items():
        if path.startswith("/v1/"):
            for operation in operations.values():
                operation["security"] = _ANYWHERE
    return found


def _merge(known: dict[str, Any], more: dict[str, Any]) -> dict[str, Any]:
    """Schemas by name; what has one name must be one thing."""
    for name in known.keys() & more.keys():
        if known[name].get("properties", {}).keys() != more[name].get("properties", {}).keys():
            raise ValueError(f"two models are called {name}")
    return known | more


@router.get("/docs", response_class=HTMLResponse)
async def docs(request: Request) -> HTMLResponse:
    """Show all routes."""
    content = render(request.app.openapi(), str(request.base_url).rstrip("/"))
    return HTMLResponse(content, headers={"Content-Security-Policy": _POLICY})


def render(document: Mapping[str, Any], server: str) -> str:
    """The page of an OpenAPI document; its examples go to the server."""
    body = "".join(_render_sections(document, server))
    title = escape(document["info"]["title"])
    about = "".join(f"<p>{escape(part)}</p>" for part in document["info"]["description"].split("\n\n"))
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title>'
        f'<meta name="viewport" content="width=device-width"><style>{_STYLE}</style>'
        f"<h1>{title}</h1>{about}"
        f'<p>As a document for programs: <a href="/openapi.json">openapi.json</a>. Where the service has '
        f"keys, add <code>-H 'Authorization: Bearer KEY'</code> to every command.</p>{body}</html>"
    )


def _render_sections(document: Mapping[str, Any], server: str) -> Iterator[str]:
    for tag, title in _TITLES.items():
        yield f"<h2>{title}</h2>"
        for path, operations in document["paths"].items():
            for method, operation in operations.items():
                if tag in operation.get("tags", ()):
                    fields = _render_table(_describe_fields(operation, document["components"]["schemas"]))
                    yield _render_operation(path, method.upper(), operation, server, fields)


def _render_operation(path: str, method: str, operation: Mapping[str, Any], server: str, fields: str) -> str:
    description = operation.get("description", "")
    paragraphs = "".join(f"<p>{_render_text(part)}</p>" for part in description.split("\n\n"))
    parameters = _render_table((p["name"], p.get("description", "")) for p in operation.get("parameters", ()))
    answers = _render_table(
        (code, answer["description"]) for code, answer in sorted(operation["responses"].items())
    )
    return (
        f'<details><summary><span class="method">{method}</span><code>{escape(path)}</code> '
        f'<span class="quiet">{_render_text(description.partition(".")[0])}</span></summary>{paragraphs}'
        f"{parameters}{fields}<pre>{escape(_curl_command(path, method, operation, server))}</pre>"
        f"{answers}</details>"
    )


def _describe_fields(operation: Mapping[str, Any], schemas: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """The fields of a body, and what they mean."""
    body = operation.get("requestBody", {}).get("content", {}).get("application/json")
    if body is not None:
        named = body["schema"].get("$ref") or body["schema"]["anyOf"][0]["$ref"]
        for name, field in schemas[named.rpartition("/")[2]]["properties"].items():
            yield name, field.get("description", "")


def _render_table(rows: Iterable[tuple[str, str]]) -> str:
    found = "".join(f"<tr><td><code>{escape(a)}</code><td>{_render_text(b)}" for a, b in rows)
    return f"<table>{found}</table>" if found else ""


def _render_text(text: str) -> str:
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(text, quote=False))


def _curl_command(path: str, method: str, operation: Mapping[str, Any], server: str) -> str:
    """The request as a curl command."""
    address = server + path.replace("{subject}", "S01").replace("{job}", "JOB").replace("{name}", "walk.trc")
    content = operation.get("requestBody", {}).get("content", {})
    if "application/json" in content:
        example = next(iter(content["application/json"]["examples"].values()))["value"]
        return f"curl --json '{json.dumps(example, indent=1)}' {address}"
    if content:
        return f"curl --upload-file walk.trc {address}"
    return f"curl {address}" if method == "GET" else f"curl --request {method} {address}"
