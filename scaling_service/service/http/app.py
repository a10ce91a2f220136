"""All of it as one ASGI application."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from fastapi import FastAPI
from prometheus_client import CollectorRegistry

from scaling_service.service.http import (
    asking,
    examples,
    jobs,
    links,
    markers,
    monitoring,
    openapi,
    page,
    problems,
    site,
    subjects,
    words,
)
from scaling_service.service.http.callers import Callers
from scaling_service.service.http.monitoring import JobCounts, Recent
from scaling_service.service.http.shield import Shield
from scaling_service.service.http.watching import Watching
from scaling_service.service.jobs.example import Examples
from scaling_service.service.jobs.identity import code_version
from scaling_service.service.jobs.service import Service

_DESCRIPTION = """Scales multibody body models to persons from motion capture, and says how far to trust the
result.

Give a subject's document, upload the files that it names, ask for a job, follow it, fetch its result and
files. The same request for the same files finds the same job. Errors are problem documents (RFC 9457)."""


def create_app(service: Service, *, loopback: bool) -> FastAPI:
    """The application of a service.

    Parameters
    ----------
    service : Service
        Its table of kinds gives the routes that ask for jobs.
    loopback : bool
        Whether only this machine reaches the service. Elsewhere every request needs a key.
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
    app.state.examples = Examples(service)
    app.state.recent = Recent(service)
    app.state.registry = CollectorRegistry()
    app.state.registry.register(JobCounts(service))
    for router in (
        subjects.router,
        examples.router,
        words.router,
        markers.router,
        asking.routes(service.kinds),
        jobs.router,
        links.router,
        monitoring.router,
        page.router,
        site.router,
    ):
        app.include_router(router)
    problems.install(app)
    openapi.install(
        app, {*subjects.DOCUMENTS, *markers.DOCUMENTS, *links.DOCUMENTS, *asking.models(service.kinds)}
    )
    app.add_middleware(Shield)
    app.add_middleware(Watching, registry=app.state.registry)
    return app


@asynccontextmanager
async def _lifespan(app: FastAPI) -> AsyncIterator[None]:
    app.state.stopping = asyncio.Event()
    yield
