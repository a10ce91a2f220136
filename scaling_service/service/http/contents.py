"""Stored files and archives, streamed: whatever their size, little of them is in memory."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable, Iterator, Sequence
from http import HTTPStatus
from pathlib import PurePosixPath
from typing import BinaryIO
from urllib.parse import quote

from fastapi import Request, Response
from fastapi.responses import StreamingResponse
from starlette.concurrency import run_in_threadpool

from scaling_service.service.http import conditional
from scaling_service.service.http.ranges import asked_for
from scaling_service.service.store.blobs import Blobs
from scaling_service.service.store.rows import FileRow

_CHUNK_BYTES = 1 << 18
"""Sent at once. Chosen: quick on any network, and little memory for each client."""

_MEDIA_TYPES = {
    ".json": "application/json",
    ".csv": "text/csv; charset=utf-8",
    ".html": "text/html; charset=utf-8",
    ".osim": "application/xml",
    ".mot": "text/plain; charset=utf-8",
    ".sto": "text/plain; charset=utf-8",
    ".trc": "text/plain; charset=utf-8",
    ".glb": "model/gltf-binary",
}
_OTHER = "application/octet-stream"
_APART = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline' blob:; "
    "style-src 'unsafe-inline'; img-src data: blob:"
)
"""Policy for stored pages: a report may draw itself, but reaches nothing of the service's."""

_EARLIEST = (1980, 1, 1, 0, 0, 0)
"""Of every entry of an archive: the first moment that the format knows, so that archives are reproducible."""


async def stored_file(request: Request, blobs: Blobs, file: FileRow) -> Response:
    """A stored file as an answer, or the stretch of it that is asked for.

    Raises
    ------
    ContentMissing
        It is not there, though it should be.
    RangeUnsatisfiable
        The stretch begins after its end.
    """
    current = conditional.tag(file.sha256)
    if conditional.is_known(request, current):
        return conditional.unchanged(current)
    same = request.headers.get("if-range", current) == current
    stretch = asked_for(request.headers.get("range") if same else None, file.size)
    opened = await run_in_threadpool(blobs.open, file.sha256)
    name = PurePosixPath(file.name).name
    headers = conditional.headers(current) | {
        "Accept-Ranges": "bytes",
        "Content-Length": str(file.size),
        "Content-Disposition": f"inline; filename*=UTF-8''{quote(name, safe='')}",
        "Content-Security-Policy": _APART,
    }
    media_type = _MEDIA_TYPES.get(PurePosixPath(name).suffix.lower(), _OTHER)
    if stretch is None:
        return StreamingResponse(_pieces(opened, file.size), headers=headers, media_type=media_type)
    opened.seek(stretch.first)
    headers |= {"Content-Length": str(stretch.length), "Content-Range": stretch.told}
    return StreamingResponse(_pieces(opened, stretch.length), HTTPStatus.PARTIAL_CONTENT, headers, media_type)


def _pieces(opened: BinaryIO, length: int) -> Iterator[bytes]:
    with opened:
        while length > 0 and (piece := opened.read(min(_CHUNK_BYTES, length))):
            length -= len(piece)
            yield piece


class _Sink(io.RawIOBase):
    """Takes what an archive writes, until it is sent."""

    def __init__(self) -> None:
        self._waiting = bytearray()

    def writable(self) -> bool:
        return True

    def write(self, content: object, /) -> int:
        piece = bytes(content)  # type: ignore[call-overload]
        self._waiting += piece
        return len(piece)

    def take(self) -> bytes:
        taken = bytes(self._waiting)
        self._waiting.clear()
        return taken


def archive(files: Sequence[FileRow], opened: Callable[[str], BinaryIO]) -> Iterator[bytes]:
    """A zip of files, piece by piece; the same files give the same bytes.

    Parameters
    ----------
    files : sequence of FileRow
    opened : callable
        Digest -> content.
    """
    sink = _Sink()
    with zipfile.ZipFile(sink, "w", zipfile.ZIP_DEFLATED) as packed:
        for file in files:
            entry = zipfile.ZipInfo(file.name, _EARLIEST)
            entry.compress_type, entry.file_size = zipfile.ZIP_DEFLATED, file.size
            with opened(file.sha256) as content, packed.open(entry, "w") as target:
                while piece := content.read(_CHUNK_BYTES):
                    target.write(piece)
                    yield sink.take()
    yield sink.take()
