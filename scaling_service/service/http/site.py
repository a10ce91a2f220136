"""The web page as it was bundled when the package was built, and the guide as the package has it."""

from __future__ import annotations

import gzip
import hashlib
import re
from functools import lru_cache
from pathlib import Path, PurePath

import fastapi
from fastapi.responses import HTMLResponse, RedirectResponse

from scaling_service.guide.site import make_site
from scaling_service.service.http.contents import is_cached
from scaling_service.service.store.errors import NotFound

router = fastapi.APIRouter(include_in_schema=False)
guide = fastapi.APIRouter(prefix="/guide", include_in_schema=False)

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Content-Security-Policy of the page: its own scripts and styles only."""

FOREVER = "public, max-age=31536000, immutable"  # for files whose name holds a hash of their content

_NAME = re.compile(r"[\w.\-]{1,200}")
_MEDIA_TYPES = {
    ".html": ("text/html; charset=utf-8", True),
    ".js": ("text/javascript; charset=utf-8", True),
    ".css": ("text/css; charset=utf-8", True),
    ".svg": ("image/svg+xml", True),
    ".txt": ("text/plain; charset=utf-8", True),
    ".map": ("application/json", True),
    ".png": ("image/png", False),
    ".webp": ("image/webp", False),
    ".woff2": ("font/woff2", False),
}
"""Media type, and whether it is sent compressed: pictures and fonts are compressed in themselves."""

_BUNDLE = Path(__file__).parents[1] / "page" / "built"
_MOST_PARTS = 128  # kept in memory. Chosen: more than a page has.
_WITHOUT = Path(__file__).with_name("without.html")  # shown where the page was not built


@router.api_route("/", methods=["GET", "HEAD"], response_class=HTMLResponse)
def index(request: fastapi.Request) -> fastapi.Response:
    """Show the page, or say that there is none and where the routes are."""
    found = _send_file(
        request, "index.html", {"Cache-Control": "no-cache", "Content-Security-Policy": POLICY}
    )
    return found or HTMLResponse(_WITHOUT.read_bytes(), headers={"Cache-Control": "no-cache"})


@router.api_route("/assets/{name}", methods=["GET", "HEAD"])
def asset(name: str, request: fastapi.Request) -> fastapi.Response:
    """Send a script, style, font or picture of the page."""
    found = (
        _send_file(request, f"assets/{name}", {"Cache-Control": FOREVER}) if _NAME.fullmatch(name) else None
    )
    if found is None:
        raise NotFound(f"the page has no file '{name[:100]}'", field="name", remedy="Load / again")
    return found


@guide.get("")
def guide_front() -> fastapi.Response:
    """Send to where links between pages work."""
    return RedirectResponse("/guide/")


@guide.api_route("/", methods=["GET", "HEAD"])
@guide.api_route("/{name}", methods=["GET", "HEAD"])
def guide_page(request: fastapi.Request, name: str = "index.html") -> fastapi.Response:
    """Send a page, or what it draws with."""
    content = make_site().get(name)
    if content is None:
        raise NotFound(f"the guide has no page '{name[:100]}'", field="name", remedy="Begin at /guide/")
    return send(request, name, content, {"Cache-Control": "no-cache", "Content-Security-Policy": POLICY})


def _send_file(request: fastapi.Request, path: str, headers: dict[str, str]) -> fastapi.Response | None:
    """A file of the bundle as an answer; None where there is none."""
    file = _BUNDLE / path
    return send(request, path, file.read_bytes(), headers) if file.is_file() else None


def send(request: fastapi.Request, name: str, content: bytes, headers: dict[str, str]) -> fastapi.Response:
    """Answer with a file's content, compressed for who takes that, or 304 for who has it already."""
    media_type, packs = _MEDIA_TYPES.get(PurePath(name).suffix, ("application/octet-stream", False))
    packed = packs and _accepts_gzip(request)
    content, tag = _pack(content, packed)
    headers |= {"ETag": tag, "Vary": "Accept-Encoding"} | ({"Content-Encoding": "gzip"} if packed else {})
    if is_cached(request, tag):
        return fastapi.Response(status_code=304, headers=headers)
    return fastapi.Response(content, media_type=media_type, headers=headers)


def _accepts_gzip(request: fastapi.Request) -> bool:
    """Whether the client asks for gzip and does not give it the weight zero (RFC 9110, section 12.5.3)."""
    for one in request.headers.get("accept-encoding", "").lower().split(","):
        coding, _, weight = one.partition(";")
        if coding.strip() in ("gzip", "*"):
            return not re.fullmatch(r"\s*q=0(\.0*)?\s*", weight)
    return False


@lru_cache(maxsize=_MOST_PARTS)
def _pack(content: bytes, packed: bool) -> tuple[bytes, str]:
    """The content, compressed or not, and its entity tag."""
    tag = f'"{hashlib.sha256(content).hexdigest()[:32]}"'
    return (gzip.compress(content, 9, mtime=0) if packed else content), tag
