"""The guide, as it is written in the package."""

from __future__ import annotations

from fastapi import APIRouter, Request, Response
from fastapi.responses import RedirectResponse

from scaling_service.guide.site import make_site
from scaling_service.service.http.site import POLICY, send
from scaling_service.service.store.errors import NotFound

router = APIRouter(prefix="/guide", include_in_schema=False)


@router.get("")
def front() -> Response:
    """Send to where links between pages work."""
    return RedirectResponse("/guide/")


@router.api_route("/", methods=["GET", "HEAD"])
@router.api_route("/{name}", methods=["GET", "HEAD"])
def file(request: Request, name: str = "index.html") -> Response:
    """Send a page, or what it draws with."""
    content = make_site().get(name)
    if content is None:
        raise NotFound(f"the guide has no page '{name[:100]}'", field="name", remedy="Begin at /guide/")
    return send(request, name, content, {"Cache-Control": "no-cache", "Content-Security-Policy": POLICY})
