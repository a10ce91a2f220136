"""The document of all routes (OpenAPI 3.1)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi
from pydantic import BaseModel
from pydantic.json_schema import models_json_schema

from scaling_service.documents.service import Problem

_SECURITY = {"key": {"type": "http", "scheme": "bearer", "description": "An API key of the service."}}
_ANYWHERE: list[dict[str, list[str]]] = [{"key": []}, {}]
"""A key, or nothing: on the machine itself, while the service has no key."""


def json_body(example: dict[str, Any], *models: type[BaseModel]) -> dict[str, Any]:
    """The part of a route's description that tells of its body, which the route reads itself.

    Parameters
    ----------
    example : dict
        Runs as it stands.
    *models : type
        The body follows one of them; they are named to :func:`install`, too.
    """
    choices = [{"$ref": f"#/components/schemas/{model.__name__}"} for model in models]
    schema = choices[0] if len(choices) == 1 else {"anyOf": choices}
    content = {"schema": schema, "examples": {"example": {"value": example}}}
    return {"requestBody": {"required": True, "content": {"application/json": content}}}


def install(app: FastAPI, models: Iterable[type[BaseModel]]) -> None:
    """Have the application describe itself, once.

    Parameters
    ----------
    app : FastAPI
    models : iterable of type
        What bodies and answers follow, beyond what the routes' signatures tell.
    """
    described: list[type[BaseModel]] = sorted({Problem, *models}, key=lambda model: model.__name__)

    def document() -> dict[str, Any]:
        if app.openapi_schema is None:
            app.openapi_schema = _made(app, described)
        return app.openapi_schema

    app.openapi = document  # type: ignore[method-assign]


def _made(app: FastAPI, models: Sequence[type[BaseModel]]) -> dict[str, Any]:
    found = get_openapi(
        title=app.title,
        version=app.version,
        description=app.description,
        routes=app.routes,
        tags=app.openapi_tags,
    )
    _, more = models_json_schema(
        [(model, "validation") for model in models], ref_template="#/components/schemas/{model}"
    )
    components = found.setdefault("components", {})
    components["schemas"] = _merged(components.get("schemas", {}), more["$defs"])
    components["securitySchemes"] = _SECURITY
    for name in ("HTTPValidationError", "ValidationError"):  # problems take their place
        components["schemas"].pop(name, None)
    for path, operations in found["paths"].items():
        if path.startswith("/v1/"):
            for operation in operations.values():
                operation["security"] = _ANYWHERE
    return found


def _merged(known: dict[str, Any], more: dict[str, Any]) -> dict[str, Any]:
    """Schemas by name; what has one name must be one thing."""
    for name in known.keys() & more.keys():
        if known[name].get("properties", {}).keys() != more[name].get("properties", {}).keys():
            raise ValueError(f"two models are called {name}")
    return known | more
