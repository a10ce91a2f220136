"""Connections on which a request is begun and never sent do not keep others out."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from scaling_service.service.http import serving as server
from tests.service.http.served import Served, serving, settings_in


@pytest.fixture
def impatient(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Served]:
    """A service that takes twenty connections, and waits half a second for the head of a request."""
    monkeypatch.setattr(server, "HEAD_S", 0.5)
    monkeypatch.setattr(server, "limit_connections", lambda: 20)
    with serving(settings_in(tmp_path)) as served:
        yield served


@pytest.mark.parametrize(
    "begun",
    [
        b"",
        b"GET /ready HTTP/1.1\r\nHost: localhost\r\n",
        b"GET /ready HTTP/1.1\r\nHost: localhost\r\n\r\nGET /ready",  # after an answer
    ],
)
def test_half_open_connections_are_closed(impatient: Served, begun: bytes) -> None:
    host, port = impatient.url.removeprefix("http://").split(":")
    with ExitStack() as stack:
        opened = [stack.enter_context(socket.create_connection((host, int(port)))) for _ in range(40)]
        for connection in opened:
            connection.sendall(begun)
        time.sleep(1.5)
        assert impatient.call("GET", "/ready").status_code == 200
        for connection in opened:
            connection.settimeout(5.0)
            while connection.recv(65536):  # until it is closed
                pass


def test_a_body_may_take_longer_than_the_head(impatient: Served) -> None:
    host, port = impatient.url.removeprefix("http://").split(":")
    with socket.create_connection((host, int(port)), timeout=10) as connection:
        head = "POST /v1/subjects HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
        connection.sendall(f"{head}Content-Length: 2\r\nConnection: close\r\n\r\n".encode())
        time.sleep(1.0)
        connection.sendall(b"{}")
        assert b"422" in connection.recv(65536).splitlines()[0]
