"""The web page as it was bundled when the package was built: files of one folder, and nothing else."""

from __future__ import annotations

import gzip
import hashlib
import re
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from fastapi import APIRouter, Request, Response
from fastapi.responses import HTMLResponse

from scaling_service.service.http.contents import is_known
from scaling_service.service.store.errors import NotFound

router = APIRouter(include_in_schema=False)

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Content-Security-Policy of the page: its own scripts and styles only."""

FOREVER = "public, max-age=31536000, immutable"  # for files whose name holds a hash of their content

_NAME = re.compile(r"[\w.\-]{1,200}")
_MEDIA_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".woff2": "font/woff2",
    ".txt": "text/plain; charset=utf-8",
    ".map": "application/json",
}
_PACKED = {".html", ".js", ".css", ".svg", ".txt", ".map", ".json"}
"""Sent compressed: texts; pictures and fonts are compressed in themselves."""

_BUNDLE = Path(__file__).parents[1] / "page" / "built"
_MOST_PARTS = 64  # kept in memory. Chosen: more than a page has.
_WITHOUT = """<!doctype html><html lang="en"><meta charset="utf-8"><title>scaling-service</title>
<meta name="viewport" content="width=device-width"><h1>scaling-service</h1>
<p>The service runs. This installation was built without the web page; install the package again without
<code>SCALING_SERVICE_WITHOUT_PAGE</code> to have it.</p>
<p>Everything can be asked for over HTTP: <a href="/docs">routes and examples</a>.</p></html>"""


@dataclass(frozen=True, slots=True)
class Part:
    """One file of the page, also compressed by gzip where that is worth it; its tag changes with it."""

    content: bytes
    packed: bytes | None
    tag: str


@router.api_route("/", methods=["GET", "HEAD"], response_class=HTMLResponse)
def index(request: Request) -> Response:
    """Show the page, or say that there is none and where the routes are."""
    part = _part("index.html")
    if part is None:
        return HTMLResponse(_WITHOUT, headers={"Cache-Control": "no-cache"})
    return _answer(request, part, "index.html", "no-cache", {"Content-Security-Policy": POLICY})


@router.api_route("/assets/{name}", methods=["GET", "HEAD"])
def asset(name: str, request: Request) -> Response:
    """Send a script, style, font or picture of the page."""
    part = _part(f"assets/{name}") if _NAME.fullmatch(name) else None
    if part is None:
        raise NotFound(f"the page has no file '{name[:100]}'", field="name", remedy="Load / again")
    return _answer(request, part, name, FOREVER, {})


def _answer(request: Request, part: Part, name: str, keep: str, more: dict[str, str]) -> Response:
    headers = {"ETag": part.tag, "Cache-Control": keep, "Vary": "Accept-Encoding", **more}
    if is_known(request, part.tag):
        return Response(status_code=304, headers=headers)
    content = part.content
    if part.packed is not None and _takes_gzip(request):
        content, headers["Content-Encoding"] = part.packed, "gzip"
    suffix = name[name.rfind(".") :].lower()
    return Response(content, media_type=_MEDIA_TYPES.get(suffix, "application/octet-stream"), headers=headers)


def _takes_gzip(request: Request) -> bool:
    """Whether the client asks for gzip and does not give it the weight zero (RFC 9110, section 12.5.3)."""
    for one in request.headers.get("accept-encoding", "").lower().split(","):
        coding, _, weight = one.partition(";")
        if coding.strip() in ("gzip", "*"):
            return not re.fullmatch(r"\s*q=0(\.0*)?\s*", weight)
    return False


def _part(path: str) -> Part | None:
    """A file of the bundle; None where there is none."""
    file = _BUNDLE / path
    if not file.is_file():
        return None
    found = file.stat()
    return _read(file, found.st_mtime_ns, found.st_size)


@lru_cache(maxsize=_MOST_PARTS)
def _read(file: Path, _changed_ns: int, _size: int) -> Part:
    """The file as it is since it was changed last."""
    content = file.read_bytes()
    packed = gzip.compress(content, 9, mtime=0) if file.suffix in _PACKED else None
    return Part(content, packed, f'"{hashlib.sha256(content).hexdigest()[:32]}"')
