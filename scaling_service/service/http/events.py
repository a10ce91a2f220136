"""A job's progress as server-sent events (WHATWG HTML, section 9.2)."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Any

from scaling_service.documents.service import JobDocument
from scaling_service.service.store.errors import NotFound, StoreUnavailable

MEDIA_TYPE = "text/event-stream"

EVENT: dict[str, Any] = {
    "type": "object",
    "properties": {
        "id": {"type": "string", "description": "The job's revision."},
        "event": {"enum": ["job", "gone"]},
        "data": {"type": "string", "description": "The job as JSON."},
    },
    "required": ["event", "data"],
}
"""One event, for the document of all routes."""

LOOK_S = 0.25
"""Between two looks at the job. Chosen: faster than a person reads, a short query each."""

QUIET_S = 15.0
"""A comment is sent after so long without news. Chosen: well under the minute of usual proxies."""


async def follow(
    first: JobDocument, look: Callable[[], Awaitable[JobDocument]], seen: int, stopping: asyncio.Event
) -> AsyncIterator[str]:
    """The events of a job, until it is over or the server stops.

    Parameters
    ----------
    first : JobDocument
        As it is now.
    look : callable
        Asks for it again.
    seen : int
        Revision up to which the client knows it.
    stopping : asyncio.Event

    Yields
    ------
    str
        ``id`` is the revision, ``event`` is ``job``, ``data`` is the job. The job's deletion is the event
        ``gone``.
    """
    document, told_at = first, time.monotonic()
    while True:
        if document.revision > seen:
            seen, told_at = document.revision, time.monotonic()
            yield _event("job", document.model_dump_json(), document.revision)
        elif time.monotonic() - told_at > QUIET_S:
            told_at = time.monotonic()
            yield ": still here\n\n"
        if document.state.is_over or await _stopped(stopping):
            return
        try:
            document = await look()
        except NotFound:
            yield _event("gone", "{}")
            return
        except StoreUnavailable:
            continue  # the client keeps what it knows; the store comes back by itself


async def _stopped(stopping: asyncio.Event) -> bool:
    """Wait for the next look; whether the server stops meanwhile."""
    try:
        await asyncio.wait_for(stopping.wait(), LOOK_S)
    except TimeoutError:
        return False
    return True


def _event(name: str, data: str, number: int | None = None) -> str:
    identity = "" if number is None else f"id: {number}\n"
    return f"{identity}event: {name}\ndata: {data}\n\n"
