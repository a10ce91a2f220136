"""The server killed at random moments: no job is lost, and none has two results."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import pytest
import requests

from scaling_service.client import Client
from scaling_service.documents.jobs import State
from tests.cli.serving import ENVIRONMENT, start
from tests.service.http.tormented import SERVER, finished, tormented
from tests.service.store.postgres import server


@pytest.fixture(params=["sqlite", "postgresql"])
def database(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """The database of the servers that are started."""
    if request.param == "postgresql":
        monkeypatch.setitem(ENVIRONMENT, "SCALING_SERVICE_DATABASE_URL", server().new_database())
    return str(request.param)


def killed_often(folder: Path, n_jobs: int, n_kills: int, seconds: float) -> str:
    """Ask for jobs, and kill one process after another; then all must end. What was seen, for a report."""
    results: dict[str, tuple[object, ...]] = {}
    begun = time.monotonic()
    with tormented(folder, seed=3) as service:
        with Client(service.url) as client:
            asked = [client.ask("tiny", number=k, seconds=seconds).id for k in range(n_jobs)]
        for _ in range(n_kills):
            service.kill_one((0.0, 2 * seconds))
            with Client(service.url) as client:
                results |= {job: how for job, how in finished(client).items() if job not in results}
        with Client(service.url, patience_s=60.0) as client:
            jobs = [client.wait(job, 120.0) for job in asked]
            assert {job.id for job in client.jobs()} == set(asked)
            for k, job in enumerate(asked):
                assert client.result(job)["square"] == k**2
            after = finished(client)
            assert {job: after[job] for job in results} == results  # none has a second result
    return (
        f"{n_jobs} jobs, killed {dict(service.killed)}: {len(results)} done before the last kill, "
        f"{sum(job.attempt for job in jobs) - n_jobs} attempts lost; {time.monotonic() - begun:.0f} s\n"
    )


@pytest.mark.costly  # waits for two fresh starts
def test_killed_during_a_few_jobs(tmp_path: Path) -> None:
    killed_often(tmp_path / "data", n_jobs=8, n_kills=2, seconds=0.3)


@pytest.mark.benchmark
def test_killed_50_times_during_100_jobs(tmp_path: Path, database: str) -> None:
    sys.stdout.write(f"{database}: {killed_often(tmp_path / 'data', 100, 50, 0.8)}")


def test_a_database_that_is_away_is_reported_and_comes_back(tmp_path: Path) -> None:
    process, url = start(tmp_path / "data", command=SERVER)
    try:
        with Client(url) as client:
            done = client.wait(client.ask("tiny", number=4), 30.0)
            (tmp_path / "data").rename(tmp_path / "away")
            time.sleep(1.1)  # longer than a check is kept
            answer = requests.get(f"{url}/ready", timeout=30)
            assert (answer.status_code, answer.headers["Content-Type"]) == (503, "application/problem+json")
            assert str(tmp_path) not in answer.text
            assert requests.get(f"{url}/health", timeout=30).status_code == 200
            (tmp_path / "away").rename(tmp_path / "data")
            assert requests.get(f"{url}/ready", timeout=30).status_code == 200
            assert client.result(done)["square"] == 16
            assert client.wait(client.ask("tiny", number=5), 30.0).state is State.DONE
    finally:
        process.terminate()
        assert process.stdout is not None
        process.stdout.close()
        assert process.wait(30) == 0
