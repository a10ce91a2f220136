"""Around every request: its log line, its measurements, and the headers that keep browsers careful."""

from __future__ import annotations

import logging
import time
from typing import Any

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram
from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

log = logging.getLogger(__name__)

HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=()",
    "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'",
}
"""Of every answer that does not choose its own (OWASP Secure Headers Project; REST Security Cheat Sheet)."""

_TLS = {"Strict-Transport-Security": "max-age=31536000"}
_BUCKETS_S = (0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 5.0, 30.0)


class Watching:
    """Middleware around the whole application.

    Parameters
    ----------
    app : ASGIApp
    registry : CollectorRegistry
        Where the figures are collected.
    """

    def __init__(self, app: ASGIApp, registry: CollectorRegistry) -> None:
        self._app = app
        self._requests = Counter(
            "scaling_service_requests", "Requests answered.", ("method", "route", "status"), registry=registry
        )
        self._seconds = Histogram(
            "scaling_service_request_seconds",
            "Until the answer begins.",
            ("route",),
            buckets=_BUCKETS_S,
            registry=registry,
        )
        self._open = Gauge("scaling_service_requests_open", "Requests under way.", registry=registry)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, and look at its answer."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        begun = time.perf_counter()
        told: dict[str, Any] = {"status": 500, "seconds": None}

        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start":
                told["status"], told["seconds"] = message["status"], time.perf_counter() - begun
                _add_headers(MutableHeaders(scope=message), scope["scheme"])
            await send(message)

        self._open.inc()
        try:
            await self._app(scope, receive, sending)
        finally:
            self._open.dec()
            self._note(scope, told["status"], told["seconds"], time.perf_counter() - begun)

    def _note(self, scope: Scope, status: int, first_s: float | None, whole_s: float) -> None:
        """Count it, and write one line without anything of a patient: routes, never paths."""
        route = getattr(scope.get("route"), "path", "none")
        method = scope["method"] if route != "none" else "none"  # a client's own words are endless
        self._requests.labels(method, route, str(status)).inc()
        self._seconds.labels(route).observe(whole_s if first_s is None else first_s)
        log.info(
            "request",
            extra={
                "method": method,
                "route": route,
                "status": status,
                "wall_s": round(whole_s, 4),
                "key": scope.get("caller"),
            },
        )


def _add_headers(headers: MutableHeaders, scheme: str) -> None:
    for name, value in (HEADERS | (_TLS if scheme == "https" else {})).items():
        headers.setdefault(name, value)
