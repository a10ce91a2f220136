"""The document of all routes (OpenAPI 3.1), for programs and, as a page without scripts, for people."""

from __future__ import annotations

import functools
import json
import re
from collections import abc
from html import escape
from pathlib import Path
from string import Template
from typing import Any

import fastapi
from fastapi.openapi.utils import get_openapi
from fastapi.responses import HTMLResponse
from markdown_it import MarkdownIt
from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaMode, models_json_schema

from scaling_service.service.jobs.kinds import Kind

router = fastapi.APIRouter(include_in_schema=False)

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
RESULT = {"$ref": _REFERENCE.format(model="JobResult")}
"""The schema of what a job finds: one of the kinds' results."""


def _make_reference(name: str) -> dict[str, str]:
    return {"$ref": _REFERENCE.format(model=name)}


def describe_json_body(example: dict[str, Any], *models: type[BaseModel]) -> dict[str, Any]:
    """The part of a route's description that tells of its body, which the route reads itself.

    The example runs as it stands; the body follows one of the models, which :func:`install` is given, too.
    """
    choices = [_make_reference(model.__name__) for model in models]
    schema = choices[0] if len(choices) == 1 else {"anyOf": choices}
    content = {"schema": schema, "examples": {"example": {"value": example}}}
    return {"requestBody": {"required": True, "content": {"application/json": content}}}


class _Schema(GenerateJsonSchema):
    """What the service sends has every field, also those with a default."""

    def field_is_required(self, field: Any, total: bool) -> bool:
        return self.mode == "serialization" or super().field_is_required(field, total)


def install(
    app: fastapi.FastAPI,
    kinds: abc.Mapping[str, Kind],
    bodies: abc.Iterable[type[BaseModel]],
    answers: abc.Iterable[type[BaseModel]],
) -> None:
    """Have the application describe itself, once.

    What is asked of the kinds of jobs and what they find is described, and the models of bodies and answers
    that no route's signature tells of.
    """
    made = functools.partial(_make_document, app, kinds, tuple(bodies), tuple(answers))
    app.openapi = functools.cache(made)  # type: ignore[method-assign]  # FastAPI's own way to replace its document


def _make_document(
    app: fastapi.FastAPI,
    kinds: abc.Mapping[str, Kind],
    bodies: abc.Iterable[type[BaseModel]],
    answers: abc.Iterable[type[BaseModel]],
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
    # Schemas by name; what has one name must be one thing.
    known = components.get("schemas", {})
    added = more["$defs"]
    for twice in known.keys() & added.keys():
        if known[twice].get("properties", {}).keys() != added[twice].get("properties", {}).keys():
            raise ValueError(f"two models are called {twice}")
    components["schemas"] = known | added
    names = sorted(model.__name__ for model in results)
    components["schemas"]["JobResult"] = {"anyOf": [_make_reference(name) for name in names]} if names else {}
    components["securitySchemes"] = _SECURITY
    for name in ("HTTPValidationError", "ValidationError"):  # problems take their place
        components["schemas"].pop(name, None)
    for path, operations in found["paths"].items():
        if path.startswith("/v1/"):
            for operation in operations.values():
                operation["security"] = _ANYWHERE
    return found


@router.get("/docs", response_class=HTMLResponse)
async def docs(request: fastapi.Request) -> HTMLResponse:
    """Show all routes."""
    content = render(request.app.openapi(), str(request.base_url).rstrip("/"))
    return HTMLResponse(content, headers={"Content-Security-Policy": _POLICY})


def render(document: abc.Mapping[str, Any], server: str) -> str:
    """The page of an OpenAPI document; its examples go to the server."""
    content = MarkdownIt("commonmark").render(describe(document, server))
    page = Template(Path(__file__).with_name("docs.html").read_text(encoding="utf-8"))
    return page.substitute(title=escape(document["info"]["title"]), content=content)


def describe(document: abc.Mapping[str, Any], server: str) -> str:
    """Describe every route of an OpenAPI document in Markdown, each with a command that can be pasted."""
    routes: list[str] = []
    for tag, title in _TITLES.items():
        routes.append(f"## {title}")
        for path, operations in document["paths"].items():
            for method, operation in operations.items():
                if tag in operation.get("tags", ()):
                    routes.append(f"### {method.upper()} {path}")
                    routes.append(re.sub(r"\n{3,}", "\n\n", operation.get("description", "").strip()))
                    routes.append(_list_fields(operation, document["components"]["schemas"]))
                    routes.append(
                        f"```sh\n{_write_curl_command(path, method.upper(), operation, server)}\n```"
                    )
                    routes.append(_list_answers(operation["responses"]))
    return "\n\n".join(
        [
            "# The HTTP interface",
            document["info"]["description"],
            "`/openapi.json` is the same for programs. Where the service has keys, add "
            "`-H 'Authorization: Bearer KEY'` to every command.",
            *routes,
        ]
    )


def _list_fields(operation: abc.Mapping[str, Any], schemas: abc.Mapping[str, Any]) -> str:
    """What is given in the address and the body, and what it means."""
    fields = {p["name"]: p.get("description", "") for p in operation.get("parameters", ())}
    body = operation.get("requestBody", {}).get("content", {}).get("application/json")
    if body is not None:
        named = body["schema"].get("$ref") or body["schema"]["anyOf"][0]["$ref"]
        properties = schemas[named.rpartition("/")[2]]["properties"]
        meanings = {}
        for name, field in properties.items():
            # What a field means: its own words, else those of what it holds.
            held = schemas.get(field.get("$ref", "").rpartition("/")[2], {})
            meanings[name] = str(field.get("description") or held.get("description", ""))
        fields |= meanings
    return "\n".join(f"- `{name}`{f': {said}' if said else ''}" for name, said in fields.items())


def _list_answers(answers: abc.Mapping[str, abc.Mapping[str, Any]]) -> str:
    """What comes back: each answer in words, and the codes of problems."""
    said = {
        code: answer["description"].replace("Successful Response", "") for code, answer in answers.items()
    }
    good = [f"{code} ({said[code]})" if said[code] else code for code in sorted(answers) if code < "400"]
    problems = [code for code in sorted(answers) if code >= "400"]
    return f"Answers: {', '.join(good)}." + (f" Problems: {', '.join(problems)}." if problems else "")


def _write_curl_command(path: str, method: str, operation: abc.Mapping[str, Any], server: str) -> str:
    """The request as a curl command."""
    address = server + path.replace("{subject}", "S01").replace("{job}", "JOB").replace("{name}", "walk.trc")
    content = operation.get("requestBody", {}).get("content", {})
    if "application/json" in content:
        example = next(iter(content["application/json"]["examples"].values()))["value"]
        return f"curl --json '{json.dumps(example, indent=1)}' {address}"
    if content:
        return f"curl --upload-file walk.trc {address}"
    return f"curl {address}" if method == "GET" else f"curl --request {method} {address}"
