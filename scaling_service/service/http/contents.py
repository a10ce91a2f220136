"""Stored files and archives, streamed: whatever their size, little of them is in memory. Links to them.

What a client has already is known by its ETag (RFC 9110, sections 8.8.3 and 13.1.2); of a long file it may
ask for one range (section 14). A browser follows a link without a key: until it ends a ticket replaces it.
"""

from __future__ import annotations

import re
import zipfile
from collections import abc
from datetime import UTC, datetime
from http import HTTPStatus
from pathlib import PurePosixPath
from typing import IO, Any, BinaryIO, cast
from urllib.parse import quote, unquote

import fastapi

from scaling_service.documents import service as contracts
from scaling_service.service.http import bodies, callers, problems
from scaling_service.service.http.documentation import describe_json_body
from scaling_service.service.http.streams import BoundedResponse
from scaling_service.service.jobs.submission import RequestInvalid
from scaling_service.service.store.blobs import Blobs
from scaling_service.service.store.tables import FileRow

router = fastapi.APIRouter(prefix="/v1/links", tags=["jobs"])

DOCUMENTS = (contracts.LinkRequest,)
EXAMPLE: dict[str, Any] = {"path": f"/v1/jobs/{'0' * 64}/files.zip"}

_FILE = re.compile(r"/v1/(jobs/[0-9a-f]{64}/(files\.zip|files/.+)|subjects/[^/]+/files/[^/]+)")
_RANGE = re.compile(r"bytes=(\d{0,18})-(\d{0,18})")

_CHUNK_BYTES = 1 << 18  # sent at once. Chosen: quick on any network, and little memory for each client.

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
_APART = (
    "sandbox allow-scripts allow-downloads; default-src 'none'; script-src 'unsafe-inline' blob:; "
    "style-src 'unsafe-inline'; img-src data: blob:"
)
"""Policy for stored pages: a report may draw and save itself, but reaches nothing of the service's."""

_EARLIEST = (1980, 1, 1, 0, 0, 0)
"""Of every entry of an archive: the first moment that the format knows, so that archives are reproducible."""


def is_cached(request: fastapi.Request, tag: str) -> bool:
    """Whether the client has the version of this entity tag already."""
    given = request.headers.get("if-none-match", "")
    known = {one.strip().removeprefix("W/") for one in given.split(",")}
    return "*" in known or tag in known


def make_cache_headers(version: object) -> dict[str, str]:
    """What goes with a version: keep it, but ask whether it is still the one."""
    return {"ETag": f'"{version}"', "Cache-Control": "private, no-cache"}


def answer_unless_cached(
    request: fastapi.Request, version: object, answer: abc.Callable[[dict[str, str]], fastapi.Response]
) -> fastapi.Response:
    """The answer, made with its headers, or 304 for a client that has this version."""
    headers = make_cache_headers(version)
    if is_cached(request, headers["ETag"]):
        return fastapi.Response(status_code=304, headers=headers)
    return answer(headers)


def describe_file_responses(schema: dict[str, str]) -> problems.Responses:
    """What a route that sends a stored file answers, for the OpenAPI document."""
    return problems.describe_refusals(404, 416) | {
        200: {"description": "The file", "content": {"*/*": {"schema": schema}}},
        206: {"description": "The range", "content": {"*/*": {"schema": schema}}},
        304: {"description": "Unchanged"},
    }


def send_stored_file(request: fastapi.Request, blobs: Blobs, file: FileRow) -> fastapi.Response:
    """A stored file as an answer, or the range of it that is asked for."""
    headers = make_cache_headers(file.sha256)
    if is_cached(request, headers["ETag"]):
        return fastapi.Response(status_code=304, headers=headers)
    same = request.headers.get("if-range", headers["ETag"]) == headers["ETag"]
    part = parse_range(request.headers.get("range") if same else None, file.size)
    opened = blobs.open(file.sha256)
    name = PurePosixPath(file.name).name
    sent = range(file.size) if part is None else part
    headers |= {
        "Accept-Ranges": "bytes",
        "Content-Length": str(len(sent)),
        "Content-Disposition": f"inline; filename*=UTF-8''{quote(name, safe='')}",
        "Content-Security-Policy": _APART,
    }
    if part is not None:
        headers["Content-Range"] = f"bytes {part[0]}-{part[-1]}/{file.size}"
    media_type = _MEDIA_TYPES.get(PurePosixPath(name).suffix.lower(), "application/octet-stream")
    status = HTTPStatus.OK if part is None else HTTPStatus.PARTIAL_CONTENT
    return BoundedResponse(
        _read_pieces(opened, sent),
        longest_s=request.app.state.streams.longest_s,
        status_code=status,
        headers=headers,
        media_type=media_type,
    )


def parse_range(header: str | None, size: int) -> range | None:
    """The bytes that a ``Range`` header asks for, of so many; None for all of them.

    A header that cannot be understood, or asks for several ranges, is ignored.

    Examples
    --------
    >>> parse_range("bytes=0-99", 1000), parse_range("bytes=-10", 1000), parse_range(None, 1000)
    (range(0, 100), range(990, 1000), None)
    """
    found = _RANGE.fullmatch((header or "").strip())
    if found is None or found.group(1) == found.group(2) == "":
        return None
    begin, end = found.groups()
    if begin and end and int(end) < int(begin):
        return None
    if begin == "":
        wanted = range(max(size - int(end), 0), size)
    else:
        wanted = range(int(begin), min(int(end) + 1, size) if end else size)
    if not wanted:
        raise problems.RangeUnsatisfiable(size)
    return wanted


def _read_pieces(opened: BinaryIO, sent: range) -> abc.Iterator[bytes]:
    with opened:
        opened.seek(sent.start)
        left = len(sent)
        while left > 0 and (piece := opened.read(min(_CHUNK_BYTES, left))):
            left -= len(piece)
            yield piece


class _Pieces(list[bytes]):
    """Takes what an archive writes, until it is sent; it cannot seek, so that it is written in one pass."""

    def write(self, piece: bytes) -> int:
        self.append(bytes(piece))
        return len(piece)

    def flush(self) -> None:
        """Nothing is held back."""


def zip_files(files: abc.Sequence[FileRow], opened: abc.Callable[[str], BinaryIO]) -> abc.Iterator[bytes]:
    """A zip of files, whose contents are opened by digest, in pieces; the same files give the same bytes."""
    pieces = _Pieces()
    with zipfile.ZipFile(cast("IO[bytes]", pieces), "w") as packed:
        for file in files:
            entry = zipfile.ZipInfo(file.name, _EARLIEST)
            entry.compress_type, entry.file_size = zipfile.ZIP_DEFLATED, file.size
            with opened(file.sha256) as content, packed.open(entry, "w") as target:
                while piece := content.read(_CHUNK_BYTES):
                    target.write(piece)
                    yield b"".join(pieces)
                    pieces.clear()
    yield b"".join(pieces)


@router.post(
    "",
    status_code=HTTPStatus.CREATED,
    responses=problems.describe_refusals(400, 408, 413, 415, 507),
    openapi_extra=describe_json_body(EXAMPLE, contracts.LinkRequest),
)
async def make_link(
    request: fastapi.Request, owner: callers.Owner, service: callers.ServiceDep
) -> contracts.Link:
    """Make a link to a file that works without a key, for a minute or for as long as is said.

    Browsers send no key when they open a link or stream a download to the disk, and a colleague has none.
    Whoever has the link can fetch that file, and nothing else, until then.
    """
    asked = await bodies.read_model(
        contracts.LinkRequest, request, "Give `path`, and `lifetime_s` of up to 30 days"
    )
    wanted = unquote(asked.path)
    if not _FILE.fullmatch(wanted):
        raise RequestInvalid(
            "this is no path of a file",
            field="path",
            remedy="Give one of a job's links, such as /v1/jobs/ID/files.zip",
        )
    ticket, until_us = await bodies.in_writer_thread(service.make_link, owner, wanted, asked.lifetime_s)
    return contracts.Link(
        path=f"{quote(wanted)}?{callers.PARAMETER}={ticket}",
        until=datetime.fromtimestamp(until_us / 1e6, UTC),
    )


@router.delete("", status_code=HTTPStatus.NO_CONTENT, responses=problems.describe_refusals())
def end_links(owner: callers.Owner, service: callers.ServiceDep) -> None:
    """Let none of your links open anything any more. Revoking a key does so, too."""
    service.end_links(owner)
