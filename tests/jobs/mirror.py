"""A server of raw files on this machine, laid out as public repositories, and a catalogue of its own."""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from unittest.mock import patch
from urllib.parse import unquote

from scaling_service.capabilities.datasets.catalogue import Dataset

COMMIT = "c0ffee" + 34 * "0"

MODEL = b"""<?xml version="1.0" encoding="UTF-8"?>
<OpenSimDocument Version="40000"><Model name="imaged"><MarkerSet><objects>
<Marker name="RASI"><socket_parent_frame>/bodyset/pelvis</socket_parent_frame>
<location>-0.114189 -0.12625 -0.127356</location></Marker>
<Marker name="RKNE"><socket_parent_frame>/bodyset/femur_r</socket_parent_frame>
<location>-0.12116 -0.01875 -0.58264</location></Marker>
</objects></MarkerSet></Model></OpenSimDocument>
"""


@dataclass
class Mirror:
    """What is served, what was asked for, and what goes wrong."""

    content: dict[str, bytes]
    asked: list[str] = field(default_factory=list)
    status: dict[str, int] = field(default_factory=dict)
    instead: dict[str, bytes] = field(default_factory=dict)
    cut: set[str] = field(default_factory=set)
    silent: set[str] = field(default_factory=set)
    url: str = ""

    def wants(self) -> list[str]:
        """The files asked for since the last call, without repository and commit."""
        asked, self.asked = self.asked, []
        return [path.split("/", 4)[4] for path in asked]


@contextmanager
def serve(content: Mapping[str, bytes]) -> Iterator[Mirror]:
    """Serve files by ``owner/name/commit/path`` until the block ends."""
    mirror = Mirror({f"/{path}": data for path, data in content.items()})

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            mirror.asked.append(self.path)
            path = unquote(self.path)
            short = path.rpartition("/")[2]
            if short in mirror.silent:
                time.sleep(0.5)
            status = mirror.status.get(short, 200 if path in mirror.content else 404)
            body = mirror.instead.get(short, mirror.content.get(path, b"")) if status == 200 else b"no"
            with suppress(ConnectionError):  # who asked may have gone
                self.send_response(status)
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                self.wfile.write(body[: len(body) // 2] if short in mirror.cut else body)

        def log_message(self, *_: object) -> None:
            pass

    # A proxy of the machine that tests would not find this server.
    direct = patch.dict(os.environ, {"NO_PROXY": "127.0.0.1", "no_proxy": "127.0.0.1"})
    with direct, ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        mirror.url = f"http://127.0.0.1:{server.server_address[1]}"
        try:
            yield mirror
        finally:
            server.shutdown()
            thread.join()


def made_up(files: Mapping[str, tuple[str, bytes]], **changes: object) -> Dataset:
    """A dataset of these files: name to path in the repository and content."""
    entries = [
        {"path": path, "as": name, "bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
        for name, (path, data) in files.items()
    ]
    document: dict[str, object] = {
        "title": "A made-up person",
        "use": "tests",
        "about": "Nobody was recorded.",
        "licence": {"name": "CC BY-NC 4.0", "non_commercial": True, "note": "Ask first."},
        "cite": ["Nobody (2000) Nothing."],
        "repository": "owner/name.of-it",
        "commit": COMMIT,
        "files": entries,
        "next": ["compare {folder}/subject.yaml --methods MB --out {folder}_results"],
    }
    return Dataset.model_validate(document | changes)


def laid_out(dataset: Dataset, files: Mapping[str, tuple[str, bytes]]) -> dict[str, bytes]:
    """The same files as a server of raw files holds them."""
    return {f"{dataset.repository}/{dataset.commit}/{path}": data for path, data in files.values()}
