"""What a client sends, a JSON document with bounds or the chunks of a file; threads for what it writes."""

from __future__ import annotations

import asyncio
import json
import time
import typing
from collections import abc
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import pydantic
from fastapi import Request

from scaling_service.documents.reading import MAX_BYTES
from scaling_service.service.http import problems
from scaling_service.service.jobs.submission import RequestInvalid
from scaling_service.service.store.errors import TooLarge

P = typing.ParamSpec("P")
T = typing.TypeVar("T")
Model = typing.TypeVar("Model", bound=pydantic.BaseModel)

SILENCE_S = 60.0
"""Without a byte for so long, a client is taken for gone. Chosen: longer than networks pause."""

DOCUMENT_S = 60.0  # within which a document must have come. Chosen: 1 MB at 0.2 Mbit/s.

CHUNK_BYTES = 1 << 20
"""Handed on at once. Chosen: few hand-overs to threads, and little memory for each upload."""

_WRITERS = ThreadPoolExecutor(8, thread_name_prefix="writer")
"""Apart from the threads that only look, so that a queue of writers holds up no reader. Eight: chosen, for
SQLite writes one at a time anyway, and a few uploads keep a disk busy."""


async def in_writer_thread(call: abc.Callable[P, T], *args: P.args, **options: P.kwargs) -> T:
    """Make a call that writes to the store, in one of the threads for that."""
    return await asyncio.get_running_loop().run_in_executor(_WRITERS, partial(call, *args, **options))


async def read_model(model: type[Model], request: Request, remedy: str) -> Model:
    """The body as a document of a model, or RequestInvalid with this remedy."""
    content = await read_json(request)
    try:
        return model.model_validate(content)
    except pydantic.ValidationError as error:
        raise RequestInvalid.of(error, remedy) from None


async def read_json(request: Request) -> dict[str, typing.Any]:
    """The body as a JSON object."""
    media_type = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if media_type != "application/json":
        raise problems.WrongMediaType(
            f"the body is '{media_type[:60]}', not JSON",
            field="Content-Type",
            remedy="Send JSON with `Content-Type: application/json`",
        )
    content = bytearray()
    async for chunk in read_chunks(request, DOCUMENT_S):
        content += chunk
        if len(content) > MAX_BYTES:
            raise TooLarge(
                f"the document is larger than {MAX_BYTES / 1e6:g} MB",
                remedy="Upload recordings as files, and name them in the document",
            )
    try:
        found = json.loads(content.decode("utf-8"), parse_constant=_refuse_constant)
        json.dumps(found, ensure_ascii=False).encode("utf-8")  # halves of characters cannot be kept
    except (ValueError, RecursionError) as error:  # decoding errors are ValueErrors
        said = error.msg if isinstance(error, json.JSONDecodeError) else "it is nested too deeply or no text"
        raise problems.BodyUnreadable(f"the body is not valid JSON: {said}", remedy="Correct it") from None
    if not isinstance(found, dict):
        raise problems.BodyUnreadable("the body is not a JSON object", remedy='Send `{"key": value, …}`')
    return found


def _refuse_constant(text: str) -> float:
    raise json.JSONDecodeError(f"{text} is no number in JSON", text, 0)


async def read_chunks(request: Request, longest_s: float) -> abc.AsyncIterator[bytes]:
    """The body in pieces of about a megabyte; TooSlow where it does not come within that time, or stops."""
    stream = request.stream().__aiter__()
    waiting = bytearray()
    end = time.monotonic() + longest_s
    while True:
        left_s = end - time.monotonic()
        try:
            piece = await asyncio.wait_for(stream.__anext__(), min(SILENCE_S, left_s))
        except StopAsyncIteration:
            break
        except TimeoutError:
            said = f"nothing came for {SILENCE_S:g} s" if left_s > SILENCE_S else f"it took {longest_s:g} s"
            raise problems.TooSlow(said, remedy="Try again, over a faster connection") from None
        waiting += piece
        if len(waiting) >= CHUNK_BYTES:
            yield bytes(waiting)
            waiting.clear()
    if waiting:
        yield bytes(waiting)
