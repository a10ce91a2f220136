"""The server killed at random moments: no job is lost, and none has two results."""

from __future__ import annotations

import os
import random
import signal
import sys
import time
from pathlib import Path

import pytest
import requests

from scaling_service.client import Client
from scaling_service.schemas.jobs import State
from tests.cli.serving import start
from tests.runner.services import children_of

SERVER = [sys.executable, "-m", "tests.api.tiny_server"]


def killed_often(folder: Path, n_jobs: int, n_kills: int, seconds: float) -> None:
    """Ask for jobs, and kill the server, its runner or both until the last kill; then all must end."""
    rng = random.Random(3)
    process, url = start(folder, command=SERVER)
    with Client(url) as client:
        asked = [client.ask("tiny", number=k, seconds=seconds).id for k in range(n_jobs)]
    results: dict[str, object] = {}
    for _ in range(n_kills):
        time.sleep(rng.uniform(0.2, 1.2))
        runners = children_of(process.pid)
        if rng.random() < 0.3 and runners:
            os.kill(rng.choice(runners), signal.SIGKILL)  # the server starts another
            continue
        process.kill()
        process.wait()
        assert process.stdout is not None
        process.stdout.close()
        process, url = start(folder, command=SERVER)
        keep_results(url, results)
    with Client(url, patience_s=60.0) as client:
        for job in asked:
            assert client.wait(job, 120.0).state is State.DONE
        assert {job.id for job in client.jobs()} == set(asked)
        for k, job in enumerate(asked):
            assert client.result(job)["square"] == k**2
        assert {job: client.result(job)["pid"] for job in results} == results
    process.terminate()
    assert process.stdout is not None
    process.stdout.close()
    assert process.wait(30) == 0


def keep_results(url: str, results: dict[str, object]) -> None:
    """Note who made each result so far: a second result would tell of another process."""
    with Client(url) as client:
        for job in client.jobs(state="done"):
            results.setdefault(job.id, client.result(job)["pid"])


def test_killed_during_a_few_jobs(tmp_path: Path) -> None:
    killed_often(tmp_path / "data", n_jobs=12, n_kills=3, seconds=0.3)


@pytest.mark.benchmark
def test_killed_50_times_during_100_jobs(tmp_path: Path) -> None:
    killed_often(tmp_path / "data", n_jobs=100, n_kills=50, seconds=0.8)


def test_a_database_that_is_away_is_told_and_comes_back(tmp_path: Path) -> None:
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
