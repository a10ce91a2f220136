"""Whether the service lives and can work, its figures for Prometheus, and the log line of every request."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator
from typing import Any

import fastapi
import prometheus_client
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.registry import Collector
from starlette import types
from starlette.datastructures import MutableHeaders
from starlette.requests import ClientDisconnect

from scaling_service.core.errors import InputError
from scaling_service.service.http import callers, problems
from scaling_service.service.jobs.service import Service
from scaling_service.service.jobs.submission import code_version
from scaling_service.service.sandbox.child import code_places

log = logging.getLogger(__name__)
router = fastapi.APIRouter(tags=["monitoring"])

FRESH_S = 1.0  # a check or a count is not repeated sooner. Chosen: whoever asks often costs nothing.

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

_ANSWER: dict[int | str, dict[str, Any]] = {
    200: {"description": "It is", "content": {"application/json": {"schema": {"type": "object"}}}}
}

_DEFECT = InputError(
    "the program failed on this request",
    remedy="Report it; the service's log says where it happened",
)


@router.get("/health", responses=_ANSWER)
async def health() -> dict[str, str]:
    """Say whether the process answers; nothing else is looked at."""
    return {"status": "alive", "code_version": code_version()}


@router.get("/ready", responses=_ANSWER | problems.describe_refusals())
def ready(request: fastapi.Request) -> dict[str, str]:
    """Say whether database and disk answer, so that requests can be taken."""
    request.app.state.recent.check()
    return {"status": "ready"}


@router.get(
    "/metrics",
    response_class=fastapi.Response,
    responses=problems.describe_refusals()
    | {200: {"description": "Figures", "content": {"text/plain": {"schema": {"type": "string"}}}}},
)
def metrics(
    request: fastapi.Request, _owner: callers.Owner, _service: callers.ServiceDep
) -> fastapi.Response:
    """Give figures in Prometheus' text format."""
    registry: prometheus_client.CollectorRegistry = request.app.state.registry
    return fastapi.Response(
        prometheus_client.generate_latest(registry),
        headers={"Content-Type": prometheus_client.CONTENT_TYPE_LATEST},
    )


class Recent:
    """The store's state, looked at now and then however often it is asked for."""

    def __init__(self, service: Service) -> None:
        self._service, self._lock = service, threading.Lock()
        self._checked_at = float("-inf")

    def check(self) -> None:
        """See :meth:`Service.check`."""
        with self._lock:
            if time.monotonic() - self._checked_at > FRESH_S:
                self._service.check()
                self._checked_at = time.monotonic()


class JobCounts(Collector):
    """Jobs by state, counted when figures are asked for."""

    def __init__(self, service: Service) -> None:
        self._service = service

    def collect(self) -> Iterator[GaugeMetricFamily]:
        """The gauge."""
        family = GaugeMetricFamily("scaling_service_jobs", "Jobs by state.", labels=["state"])
        for state, count in self._service.counts().items():
            family.add_metric([state.value], count)
        yield family


class RequestMonitor:
    """Middleware around the whole application: headers, figures, the log, and what becomes of defects."""

    def __init__(self, app: types.ASGIApp, registry: prometheus_client.CollectorRegistry) -> None:
        self._app = app
        self._requests = prometheus_client.Counter(
            "scaling_service_requests", "Requests answered.", ("method", "route", "status"), registry=registry
        )
        self._seconds = prometheus_client.Histogram(
            "scaling_service_request_seconds",
            "Until the answer begins.",
            ("route",),
            buckets=_BUCKETS_S,
            registry=registry,
        )
        self._open = prometheus_client.Gauge(
            "scaling_service_requests_open", "Requests under way.", registry=registry
        )

    async def __call__(self, scope: types.Scope, receive: types.Receive, send: types.Send) -> None:
        """Pass a request on, and look at its answer.

        A defect ends as a problem document, and its place in the code in the log; after the answer began it
        ends the connection, so that the client notices.
        """
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        begun = time.perf_counter()
        status, first_s = 0, 0.0

        async def sending(message: types.Message) -> None:
            nonlocal status, first_s
            if message["type"] == "http.response.start":
                status, first_s = message["status"], time.perf_counter() - begun
                headers = MutableHeaders(scope=message)
                for name, value in (HEADERS | (_TLS if scope["scheme"] == "https" else {})).items():
                    headers.setdefault(name, value)
            await send(message)

        self._open.inc()
        try:
            await self._app(scope, receive, sending)
        except ClientDisconnect:
            pass
        except Exception as error:  # noqa: BLE001 (whatever it is, the client gets an answer)
            log.error("a request failed", extra={"error": type(error).__name__, "at": code_places(error)})
            if status:
                raise _CutShort from None
            await problems.answer_problem(_DEFECT, 500)(scope, receive, sending)
        finally:
            self._open.dec()
            whole_s = time.perf_counter() - begun
            self._note(scope, status or 500, first_s if status else whole_s, whole_s)

    def _note(self, scope: types.Scope, status: int, first_s: float, whole_s: float) -> None:
        """Count it, and write one line without anything of a patient: routes, never paths."""
        route = getattr(scope.get("route"), "path", "none")
        method = scope["method"] if route != "none" else "none"  # a client's own words are endless
        self._requests.labels(method, route, str(status)).inc()
        self._seconds.labels(route).observe(first_s)
        entry = {"method": method, "route": route, "status": status, "wall_s": round(whole_s, 4)}
        log.info("request", extra=entry | {"key": scope.get("caller")})


class _CutShort(Exception):
    """An answer could not be brought to its end."""
