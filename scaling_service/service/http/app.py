"""All of it as one ASGI application."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from anyio.to_thread import current_default_thread_limiter
from fastapi import FastAPI
from prometheus_client import CollectorRegistry

from scaling_service.capabilities.consistent.result import WrenchScene
from scaling_service.capabilities.dynamics.result import ResidualScene
from scaling_service.capabilities.playback.result import SceneDocument
from scaling_service.documents.results import MuscleScene
from scaling_service.documents.service import Problem
from scaling_service.service.http import (
    contents,
    documentation,
    jobs,
    laboratory,
    monitoring,
    problems,
    site,
    subjects,
)
from scaling_service.service.http.callers import Callers
from scaling_service.service.http.streams import Streams
from scaling_service.service.jobs.example import Examples
from scaling_service.service.jobs.service import Service
from scaling_service.service.jobs.submission import code_version

_DESCRIPTION = """Scales multibody body models to persons from motion capture, and says how far to trust the
result.

Give a subject's document, upload the files that it names, ask for a job, follow it, fetch its result and
files. The same request for the same files finds the same job. Errors are problem documents (RFC 9457)."""

READERS = 4
"""Threads that look into the store, beside those that write. Chosen: Python runs one at a time, so more only
hold each other up: with 50 clients and 1,000 jobs, 99 % of looks at a job took 36 to 59 ms with four (three
runs), 78 ms with forty, anyio's default (one run)."""


def create_app(service: Service, *, loopback: bool) -> FastAPI:
    """The application of a service, whose table of kinds gives the routes that ask for jobs.

    ``loopback`` says whether only this machine reaches the service. Elsewhere every request needs a key.
    """
    app = FastAPI(
        title="scaling-service",
        version=code_version(),
        description=_DESCRIPTION,
        docs_url=None,
        redoc_url=None,
        redirect_slashes=False,
        lifespan=_lifespan,
    )
    app.state.service = service
    app.state.callers = Callers(service, loopback=loopback)
    app.state.streams = Streams(service.settings)
    app.state.examples = Examples(service)
    app.state.recent = monitoring.Recent(service)
    app.state.registry = CollectorRegistry()
    app.state.registry.register(monitoring.JobCounts(service))
    for router in (
        subjects.router,
        laboratory.router,
        jobs.make_submission_routes(service.kinds),
        jobs.router,
        contents.router,
        monitoring.router,
        documentation.router,
        site.guide,
        site.router,
    ):
        app.include_router(router)
    problems.install(app)
    documentation.install(
        app,
        service.kinds,
        bodies=(*subjects.DOCUMENTS, *laboratory.DOCUMENTS, *contents.DOCUMENTS),
        answers=(Problem, SceneDocument, ResidualScene, WrenchScene, MuscleScene),
    )
    app.add_middleware(monitoring.RequestMonitor, registry=app.state.registry)
    return app


@asynccontextmanager
async def _lifespan(app: FastAPI) -> AsyncIterator[None]:
    app.state.stopping = asyncio.Event()
    current_default_thread_limiter().total_tokens = READERS
    yield
