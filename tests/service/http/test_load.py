"""Many clients and jobs at once, and uploads larger than the memory that they may take."""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from http.client import HTTPConnection
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
import requests

from scaling_service.client import Client
from scaling_service.documents.jobs import State
from tests.cli.serving import ENVIRONMENT, start
from tests.service.http.bare_server import bare_server
from tests.service.http.test_subjects import person
from tests.service.jobs.services import children_of

SERVER = [sys.executable, "-m", "tests.service.http.tiny_server"]


@contextmanager
def server(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[int, str]]:
    """Process and address of a service that is not slowed by limits on requests."""
    for name, value in (("RATE", "1e6"), ("BURST", "1000000")):
        monkeypatch.setitem(ENVIRONMENT, f"SCALING_SERVICE_REQUEST_{name}", value)
    process, url = start(folder, command=SERVER)
    try:
        yield process.pid, url
    finally:
        process.terminate()
        assert process.stdout is not None
        process.stdout.close()
        assert process.wait(30) == 0


class Crowd:
    """Clients that each ask for their jobs, then look at one twice a second until all are done.

    They look over bare connections: all are in one process, whose own time would count as the service's.
    """

    def __init__(self, url: str, n_clients: int, n_jobs: int, seconds: float) -> None:
        self.url, self.seconds = url, seconds
        self.numbers = np.array_split(np.arange(n_jobs), n_clients)
        self.times: list[float] = []
        self.troubles: list[BaseException] = []
        self.done: set[str] = set()

    def run(self) -> None:
        threads = [threading.Thread(target=self._one, args=(numbers,)) for numbers in self.numbers]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()

    def _one(self, numbers: np.ndarray) -> None:
        try:
            with Client(self.url, patience_s=0.0) as client:
                open_jobs = {client.ask("busy", number=int(k), seconds=self.seconds).id for k in numbers}
            with closing(HTTPConnection(urlsplit(self.url).netloc, timeout=30)) as connection:
                while open_jobs:
                    job = next(iter(open_jobs))
                    begun = time.perf_counter()
                    connection.request("GET", f"/v1/jobs/{job}")
                    state = State(json.load(connection.getresponse())["state"])
                    self.times.append(time.perf_counter() - begun)
                    if state.is_over:
                        assert state is State.DONE
                        open_jobs.discard(job)
                        self.done.add(job)
                    time.sleep(0.5)
        except BaseException as error:  # noqa: BLE001 (told by the test)
            self.troubles.append(error)


class Probe(threading.Thread):
    """Asks a bare server twenty times a second, from the same process as the crowd."""

    def __init__(self, url: str) -> None:
        super().__init__()
        self.url, self.times, self._over = url, list[float](), threading.Event()

    def run(self) -> None:
        with requests.Session() as session:
            while not self._over.wait(0.05):
                begun = time.perf_counter()
                assert session.get(self.url, timeout=30).status_code == 200
                self.times.append(time.perf_counter() - begun)

    def stop(self) -> None:
        self._over.set()
        self.join()


def reported(name: str, times: Sequence[float]) -> str:
    median, p99 = np.percentile(times, [50, 99])
    return (
        f"  {len(times)} {name}: median {1e3 * median:.1f} ms, p99 {1e3 * p99:.1f} ms, "
        f"largest {1e3 * max(times):.1f} ms\n"
    )


def crowded(url: str, n_clients: int, n_jobs: int, seconds: float) -> tuple[float, float]:
    """The 99th percentiles, s, of the time of a status request and of a bare server's answer meanwhile.

    All jobs are done and none is lost.
    """
    crowd = Crowd(url, n_clients, n_jobs, seconds)
    with bare_server() as bare:
        probe = Probe(bare)
        probe.start()
        begun = time.perf_counter()
        crowd.run()
        wall_s = time.perf_counter() - begun
        probe.stop()
    assert crowd.troubles == []
    assert len(crowd.done) == n_jobs
    with Client(url) as client:
        assert {job.id for job in client.jobs()} == crowd.done
    load = os.getloadavg()[0]
    sys.stdout.write(
        f"{n_jobs} jobs of {n_clients} clients in {wall_s:.0f} s, load of the machine {load:.1f}\n"
    )
    sys.stdout.write(
        reported("status requests", crowd.times) + reported("requests of a bare server", probe.times)
    )
    return float(np.percentile(crowd.times, 99)), float(np.percentile(probe.times, 99))


@pytest.mark.costly
def test_a_few_clients_and_jobs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with server(tmp_path / "data", monkeypatch) as (_, url):
        status, bare = crowded(url, n_clients=10, n_jobs=30, seconds=0.1)
    # Where other work leaves little of the machine, answers wait as a server's does that has nothing to do.
    assert status < max(1.0, 5.0 * bare)


@pytest.mark.benchmark
def test_fifty_clients_and_a_thousand_jobs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with server(tmp_path / "data", monkeypatch) as (_, url):
        assert crowded(url, n_clients=50, n_jobs=1000, seconds=0.1)[0] <= 0.1


def largest_memory_mb(process: int) -> float:
    """The most resident memory that a process has had, MB."""
    for line in Path(f"/proc/{process}/status").read_text().splitlines():
        if line.startswith("VmHWM"):
            return int(line.split()[1]) / 1e3
    raise AssertionError


@pytest.mark.parametrize(
    "size_mb", [pytest.param(60, marks=pytest.mark.costly), pytest.param(500, marks=pytest.mark.benchmark)]
)
def test_an_upload_takes_little_memory(size_mb: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "large.c3d"
    with file.open("wb") as content:
        for _ in range(size_mb):
            content.write(os.urandom(1_000_000))
    with server(tmp_path / "data", monkeypatch) as (process, url), Client(url) as client:
        client.put_subject(person("S01"))
        before = largest_memory_mb(process)
        begun = time.perf_counter()
        assert client.upload("S01", file).size == size_mb * 1_000_000
        wall_s = time.perf_counter() - begun
        after = largest_memory_mb(process)
        print(  # noqa: T201 (shown by -s)
            f"{size_mb} MB in {wall_s:.1f} s: the server had {before:.0f} MB before, {after:.0f} MB at most"
        )
        assert after < 300.0
        assert after - before < 40.0
        assert children_of(process)
