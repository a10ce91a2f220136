"""Whether the service lives and can work, and its figures for Prometheus."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from typing import Any

from fastapi import APIRouter, Request, Response
from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, generate_latest
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.registry import Collector

from scaling_service.service.http.callers import Desk, Owner
from scaling_service.service.http.problems import described
from scaling_service.service.jobs.identity import code_version
from scaling_service.service.jobs.service import Service

router = APIRouter(tags=["monitoring"])

FRESH_S = 1.0
"""A check or a count is not repeated sooner. Chosen: whoever asks often costs nothing."""

_ANSWER: dict[int | str, dict[str, Any]] = {
    200: {"description": "It is", "content": {"application/json": {"schema": {"type": "object"}}}}
}


@router.get("/health", responses=_ANSWER)
async def health() -> dict[str, str]:
    """Say whether the process answers; nothing else is looked at."""
    return {"status": "alive", "code_version": code_version()}


@router.get("/ready", responses=_ANSWER | described())
def ready(request: Request) -> dict[str, str]:
    """Say whether database and disk answer, so that requests can be taken."""
    request.app.state.recent.check()
    return {"status": "ready"}


@router.get(
    "/metrics",
    response_class=Response,
    responses=described()
    | {200: {"description": "Figures", "content": {"text/plain": {"schema": {"type": "string"}}}}},
)
def metrics(request: Request, _owner: Owner, _service: Desk) -> Response:
    """Give figures in Prometheus' text format."""
    registry: CollectorRegistry = request.app.state.registry
    return Response(generate_latest(registry), headers={"Content-Type": CONTENT_TYPE_LATEST})


class Recent:
    """The store's state, looked at now and then however often it is asked for.

    Parameters
    ----------
    service : Service
    """

    def __init__(self, service: Service) -> None:
        self._service, self._lock = service, threading.Lock()
        self._checked_at = float("-inf")
        self._found: dict[str, float] = {}

    def check(self) -> dict[str, float]:
        """See :meth:`Service.check`.

        Raises
        ------
        StoreUnavailable
        """
        with self._lock:
            if time.monotonic() - self._checked_at > FRESH_S:
                self._found = self._service.check()
                self._checked_at = time.monotonic()
            return self._found


class JobCounts(Collector):
    """Jobs by state, counted when figures are asked for.

    Parameters
    ----------
    service : Service
    """

    def __init__(self, service: Service) -> None:
        self._service = service

    def collect(self) -> Iterator[GaugeMetricFamily]:
        """The gauge."""
        family = GaugeMetricFamily("scaling_service_jobs", "Jobs by state.", labels=["state"])
        for state, count in self._service.counts().items():
            family.add_metric([state.value], count)
        yield family
