"""Uploads, downloads and followed jobs that never end: bounded in number for each owner, and in time."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path

import pytest
import requests

from scaling_service.documents.jobs import State
from tests.service.http.served import Served, serving, settings_in
from tests.service.http.test_subjects import person
from tests.service.jobs.services import ended, running, until
from tests.service.jobs.tiny import TINY

MOST, LONGEST_S = 4, 1.5


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Served]:
    """A service that lets each owner have four streams, of a second and a half."""
    settings = settings_in(tmp_path, limit_streams=MOST, limit_stream_s=LONGEST_S)
    with serving(settings, TINY) as made:
        yield made


def connect(served: Served) -> socket.socket:
    host, port = served.url.removeprefix("http://").split(":")
    return socket.create_connection((host, int(port)), timeout=10)


def begin_upload(served: Served, key: str) -> socket.socket:
    """An upload of a million bytes, of which none has come."""
    connection = connect(served)
    head = f"PUT /v1/subjects/S01/files/a.trc HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {key}\r\n"
    connection.sendall(f"{head}Content-Length: 1000000\r\n\r\n".encode())
    return connection


def drip(connection: socket.socket, seconds: float) -> bytes:
    """A byte now and then, as long as the service takes them; its answer."""
    connection.settimeout(0.1)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        connection.sendall(b"x")
        try:
            return connection.recv(65536)
        except TimeoutError:
            pass
    return b""


def test_an_upload_has_a_whole_time(served: Served) -> None:
    """However often a byte comes."""
    key = served.key("lab")
    served.call("POST", "/v1/subjects", key, json=person("S01"))
    with begin_upload(served, key) as connection:
        begun = time.monotonic()
        assert b" 408 " in drip(connection, 10 * LONGEST_S).splitlines()[0]
        assert time.monotonic() - begun < 3 * LONGEST_S
    uploads = served.service.settings.data_directory / "scratch" / "uploads"
    until(lambda: not list(uploads.iterdir()), within_s=5.0)


def test_streams_of_an_owner_are_bounded_and_others_are_not_kept_out(served: Served) -> None:
    lab, other = served.key("lab"), served.key("other")
    for key in (lab, other):
        served.call("POST", "/v1/subjects", key, json=person("S01"))
    put = "/v1/subjects/S01/files/b.trc"
    with ExitStack() as stack:
        for _ in range(MOST):
            stack.enter_context(begin_upload(served, lab))
        time.sleep(0.5)
        refused = served.call("PUT", put, lab, data=b"x")
        assert (refused.status_code, refused.headers["Retry-After"]) == (429, "6")
        assert "4 uploads, downloads and followed jobs are open" in refused.json()["problem"]
        assert served.call("GET", "/v1/subjects", lab).status_code == 200
        assert served.call("PUT", put, other, data=b"x").status_code == 200
    until(lambda: served.call("PUT", put, lab, data=b"x").status_code == 200, within_s=5.0)


def test_what_was_followed_or_fetched_no_longer_counts(served: Served) -> None:
    with running(served.service):
        job = served.call("POST", "/v1/tiny", json={"number": 3}).json()["id"]
        assert ended(served.service, "local", job).state is State.DONE
        for _ in range(3 * MOST):
            assert served.call("GET", f"/v1/jobs/{job}/files/square.txt").text == "9"
            assert served.call("GET", f"/v1/jobs/{job}/files.zip").status_code == 200
            assert "done" in served.call("GET", f"/v1/jobs/{job}/events").text


def test_followed_jobs_count_as_long_as_they_are_followed(tmp_path: Path) -> None:
    with serving(settings_in(tmp_path, limit_streams=MOST), TINY) as served, ExitStack() as stack:
        job = served.call("POST", "/v1/tiny", json={"number": 1}).json()["id"]
        events = f"/v1/jobs/{job}/events"
        for _ in range(MOST):
            followed = stack.enter_context(requests.get(served.url + events, stream=True, timeout=10))
            lines = stack.enter_context(closing(followed.iter_lines()))
            assert next(lines).startswith(b"id:")
        assert served.call("GET", events).status_code == 429
        assert served.call("GET", f"/v1/jobs/{job}").status_code == 200
        stack.pop_all().close()  # who goes away no longer counts
        with running(served.service):
            until(lambda: served.call("GET", events).status_code == 200, within_s=10.0)


def test_a_followed_job_is_asked_for_again(served: Served) -> None:
    """The stream ends in time, and the client goes on from the last event."""
    job = served.call("POST", "/v1/tiny", json={"seconds": 4.0}).json()["id"]
    begun = time.monotonic()
    assert requests.get(f"{served.url}/v1/jobs/{job}/events", timeout=10).text.count("event: job") >= 1
    assert LONGEST_S - 0.2 < time.monotonic() - begun < 3 * LONGEST_S
    with running(served.service):
        assert served.client().wait(job).state is State.DONE


def test_a_download_that_is_not_read_is_cut_off(served: Served) -> None:
    served.call("POST", "/v1/subjects", json=person("S01"))
    path = "/v1/subjects/S01/files/long.trc"
    assert served.call("PUT", path, data=b"x" * 50_000_000).status_code == 200
    with connect(served) as connection:
        connection.sendall(f"GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
        time.sleep(2 * LONGEST_S)
        came = 0
        while piece := connection.recv(1 << 20):
            came += len(piece)
    assert 0 < came < 50_000_000
