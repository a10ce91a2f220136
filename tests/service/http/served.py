"""A service over HTTP in a thread of the tests, on a port of its own."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import requests
import uvicorn

from scaling_service.client import Client
from scaling_service.service.http.app import create_app
from scaling_service.service.http.serving import configure_server
from scaling_service.service.jobs.kinds import KINDS, Kind
from scaling_service.service.jobs.service import Service, open_store
from scaling_service.service.jobs.settings import ServiceSettings
from scaling_service.service.store import keys


class Served:
    """What a test asks."""

    def __init__(self, service: Service, url: str) -> None:
        self.service, self.url = service, url

    def client(self, key: str | None = None) -> Client:
        return Client(self.url, key, patience_s=0.0)

    def key(self, owner: str) -> str:
        return keys.create(self.service.store.database, owner)[1]

    def call(self, method: str, path: str, key: str | None = None, **options: Any) -> requests.Response:
        headers = options.pop("headers", {}) | ({} if key is None else {"Authorization": f"Bearer {key}"})
        return requests.request(method, self.url + path, headers=headers, timeout=30, **options)


def settings_in(folder: Path, **chosen: Any) -> ServiceSettings:
    """Of a small service that is not slowed by its own limits."""
    usual = {"workers": 2, "lease_s": 20.0, "reserve_mb": 0, "request_rate": 1e6, "request_burst": 1_000_000}
    return ServiceSettings(**{"data_directory": folder / "data"} | usual | chosen)


@contextmanager
def serving(
    settings: ServiceSettings, kinds: Mapping[str, Kind] = KINDS, *, loopback: bool = True
) -> Iterator[Served]:
    """A service that answers; no runner is at work."""
    service = Service(open_store(settings), settings, kinds)
    server = uvicorn.Server(configure_server(create_app(service, loopback=loopback), settings))
    listener = socket.create_server(("127.0.0.1", 0), backlog=512)
    listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    thread = threading.Thread(target=server.run, args=([listener],))
    thread.start()
    try:
        while not server.started:
            assert thread.is_alive()
            time.sleep(0.01)
        yield Served(service, f"http://127.0.0.1:{listener.getsockname()[1]}")
    finally:
        server.should_exit = True
        thread.join(20)
        listener.close()
        service.close()
    assert not thread.is_alive()
