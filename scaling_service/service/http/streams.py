"""Requests that last: uploads, downloads and followed jobs, bounded in number for each owner, and in time."""

from __future__ import annotations

import asyncio
from collections import Counter, abc
from contextlib import contextmanager
from typing import Any

import fastapi
from fastapi.responses import StreamingResponse
from starlette import types
from starlette.requests import ClientDisconnect

from scaling_service.service.http.callers import Owner
from scaling_service.service.http.problems import TooManyRequests
from scaling_service.service.jobs.settings import ServiceSettings

WAIT_S = 5.0  # chosen: until somebody who has too many open asks again


class Streams:
    """How many each owner has open; of the server's one thread, so that nothing is to be locked."""

    def __init__(self, settings: ServiceSettings) -> None:
        self.most, self.longest_s = settings.limit_streams, settings.limit_stream_s
        self._open: Counter[str] = Counter()

    @contextmanager
    def hold(self, owner: str) -> abc.Iterator[None]:
        """Count one more while it lasts; TooManyRequests where there are too many."""
        if self._open[owner] >= self.most:
            raise TooManyRequests(WAIT_S, f"{self.most} uploads, downloads and followed jobs are open")
        self._open[owner] += 1
        try:
            yield
        finally:
            self._open[owner] -= 1
            if not self._open[owner]:
                del self._open[owner]


async def hold_stream(request: fastapi.Request, owner: Owner) -> abc.AsyncIterator[None]:
    """Of a route that lasts; ends when the answer was sent or the client is gone (FastAPI 0.118)."""
    streams: Streams = request.app.state.streams
    with streams.hold(owner):
        yield


class BoundedResponse(StreamingResponse):
    """A stream that is cut short where the client takes too long to read it."""

    def __init__(self, content: Any, *, longest_s: float, **options: Any) -> None:
        super().__init__(content, **options)
        self._longest_s = longest_s

    async def __call__(self, scope: types.Scope, receive: types.Receive, send: types.Send) -> None:
        """Send it, in so much time at most."""
        try:
            async with asyncio.timeout(self._longest_s):
                await super().__call__(scope, receive, send)
        except TimeoutError:
            raise ClientDisconnect from None
