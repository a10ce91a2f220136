"""ETag and If-None-Match (RFC 9110, sections 8.8.3 and 13.1.2)."""

from __future__ import annotations

from fastapi import Request, Response


def tag(value: object) -> str:
    """An entity tag.

    Examples
    --------
    >>> tag(7)
    '"7"'
    """
    return f'"{value}"'


def is_known(request: Request, current: str) -> bool:
    """Whether the client has this version already."""
    given = request.headers.get("if-none-match", "")
    known = {one.strip().removeprefix("W/") for one in given.split(",")}
    return "*" in known or current in known


def headers(current: str) -> dict[str, str]:
    """What goes with a version: keep it, but ask whether it is still the one."""
    return {"ETag": current, "Cache-Control": "private, no-cache"}


def unchanged(current: str) -> Response:
    """The answer to who has this version."""
    return Response(status_code=304, headers=headers(current))
