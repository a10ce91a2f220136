"""A disk that is full, fails or is gone, a database that is locked or away, while the service is up.

Each is told in a problem document, nothing is corrupt, and all goes on by itself.
"""

from __future__ import annotations

import shutil
import sqlite3
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest
import requests

from scaling_service.documents.jobs import State
from scaling_service.service.store import database
from tests.service.http.served import Served, serving, settings_in
from tests.service.http.test_subjects import person
from tests.service.jobs.services import all_done, running, until
from tests.service.jobs.tiny import TINY
from tests.service.store.disks import failing_disk, small_disk
from tests.service.store.postgres import Server, require

PROBLEM = "application/problem+json"


def ask(served: Served, number: int, seconds: float = 0.0) -> requests.Response:
    return served.call("POST", "/v1/tiny", json={"number": number, "seconds": seconds})


def asked(served: Served, count: int, seconds: float = 0.3) -> list[str]:
    return [str(ask(served, k, seconds).json()["id"]) for k in range(count)]


def check_reported(answer: requests.Response, status: int, words: str, folder: Path) -> None:
    """A clear word, when to come back, and nothing about this machine."""
    assert (answer.status_code, answer.headers["Content-Type"]) == (status, PROBLEM), answer.text
    assert words in answer.json()["problem"]
    assert answer.json()["remedy"]
    assert int(answer.headers["Retry-After"]) >= 1
    assert str(folder) not in answer.text


def check_all_done(served: Served, jobs: list[str], most_losses: int = 0) -> None:
    """Every job is done, was hardly ever lost, and has its result; the database is sound."""
    until(lambda: all_done(served.service))
    for k, job in enumerate(jobs):
        row = served.service.job("local", job)
        assert row.state is State.DONE, row.failure
        assert row.losses <= most_losses
        assert served.call("GET", f"/v1/jobs/{job}/result").json()["square"] == k**2
        assert served.call("GET", f"/v1/jobs/{job}/files/square.txt").text == str(k**2)
    if served.service.store.database.is_sqlite:
        assert served.service.store.database.run_apart("PRAGMA integrity_check") == ["ok"]


def upload(served: Served, content: bytes) -> requests.Response:
    return served.call("PUT", "/v1/subjects/S01/files/walk.trc", data=content)


def seconds_to_read(served: Served, job: str) -> float:
    begun = time.perf_counter()
    assert served.call("GET", f"/v1/jobs/{job}").status_code == 200
    return time.perf_counter() - begun


def recovers(act: Callable[[], requests.Response], within_s: float = 10.0) -> requests.Response:
    """The first answer that is no outage."""
    end = time.monotonic() + within_s
    while (answer := act()).status_code in (503, 507) and time.monotonic() < end:
        time.sleep(0.1)
    return answer


def test_a_full_disk(tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk", 16) as disk:
        settings = settings_in(disk.folder, lease_s=5.0, reserve_mb=2)
        with serving(settings, TINY) as served, running(served.service):
            served.call("POST", "/v1/subjects", json=person("S01"))
            jobs = asked(served, 8)
            until(lambda: served.service.counts()[State.DONE] >= 2)
            disk.fill()
            check_reported(upload(served, b"x" * 300_000), 507, "no room", tmp_path)
            check_reported(ask(served, 99), 507, "no room", tmp_path)
            assert served.call("GET", f"/v1/jobs/{jobs[0]}").json()["state"] == "done"  # reading goes on
            assert served.call("GET", f"/v1/jobs/{jobs[0]}/files/square.txt").text == "0"
            disk.empty()
            assert recovers(lambda: upload(served, b"x" * 300_000)).status_code == 200
            check_all_done(served, jobs)


def test_a_job_that_waits_for_room_on_the_disk_says_so(tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk", 16) as disk:
        settings = settings_in(disk.folder, lease_s=1.0, reserve_mb=8)
        with serving(settings, TINY) as served, running(served.service):
            most = shutil.disk_usage(disk.folder).free - 4_000_000
            (disk.folder / "other").write_bytes(bytes(most))
            job = str(ask(served, 3).json()["id"])
            until(lambda: "no room" in served.service.job("local", job).progress_what)
            assert served.service.job("local", job).state is State.QUEUED
            (disk.folder / "other").unlink()
            until(lambda: all_done(served.service))
            assert served.service.job("local", job).state is State.DONE


def test_a_disk_that_fails_and_is_mounted_again(tmp_path: Path) -> None:
    with (
        failing_disk(tmp_path / "disk", 48) as disk,
        serving(settings_in(disk.folder, lease_s=1.0), TINY) as served,
        running(served.service),
    ):
        served.call("POST", "/v1/subjects", json=person("S01"))
        jobs = asked(served, 8)
        until(lambda: served.service.counts()[State.DONE] >= 2)
        disk.fail()
        check_reported(upload(served, b"x"), 503, "the data directory cannot be used", tmp_path)
        check_reported(ask(served, 99), 503, "the database cannot be used", tmp_path)
        assert served.call("GET", "/health").status_code == 200
        time.sleep(1.5)  # longer than a lease
        disk.repair()
        assert recovers(lambda: upload(served, b"x")).status_code == 200
        assert recovers(lambda: ask(served, 0, 0.3)).status_code in (200, 202)
        check_all_done(served, jobs, most_losses=1)  # those that were writing when it failed


def test_a_database_that_another_program_has_locked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(database, "BUSY_S", 0.5)  # s: the test does not wait for the usual ten
    settings = settings_in(tmp_path, lease_s=1.0)
    with serving(settings, TINY) as served, running(served.service):
        jobs = asked(served, 6)
        other = sqlite3.connect(settings.data_directory / "store.sqlite", isolation_level=None)
        other.execute("BEGIN IMMEDIATE")
        check_reported(ask(served, 99), 503, "SQLITE_BUSY", tmp_path)
        assert min(seconds_to_read(served, jobs[0]) for _ in range(5)) < 0.4  # who reads does not wait
        time.sleep(1.5)  # longer than a lease
        other.execute("ROLLBACK")
        other.close()
        assert recovers(lambda: ask(served, 0, 0.3)).status_code in (200, 202)
        check_all_done(served, jobs)


def gone(tmp_path: Path, seconds: float) -> None:
    """PostgreSQL is killed while jobs run and clients ask, and is back after so long."""
    require()
    database = Server()
    settings = settings_in(tmp_path, lease_s=1.0, database_url=database.new_database())
    try:
        with serving(settings, TINY) as served, running(served.service):
            jobs = asked(served, 8)
            until(lambda: served.service.counts()[State.DONE] >= 2)
            database.stop()
            for answer in (ask(served, 99), *(served.call("GET", f"/v1/jobs/{job}") for job in jobs)):
                check_reported(answer, 503, "the database does not answer", tmp_path)
            assert served.call("GET", "/health").status_code == 200
            patient, found = served.client(), list[object]()
            patient._patience_s = 60.0
            waiter = threading.Thread(target=lambda: found.append(patient.wait(jobs[-1]).state))
            waiter.start()  # a client that asks meanwhile gets its answer when the database is back
            time.sleep(seconds)
            database.start()
            assert recovers(lambda: ask(served, 0, 0.3)).status_code in (200, 202)
            check_all_done(served, jobs)
            waiter.join(30.0)
            assert found == [State.DONE]
    finally:
        database.remove()


@pytest.mark.costly
def test_a_database_that_is_gone_for_longer_than_a_lease(tmp_path: Path) -> None:
    gone(tmp_path, 1.5)


@pytest.mark.benchmark
def test_a_database_that_is_gone_for_ten_seconds(tmp_path: Path) -> None:
    gone(tmp_path, 10.0)


@pytest.mark.benchmark
def test_a_database_that_is_locked_for_ten_seconds(tmp_path: Path) -> None:
    settings = settings_in(tmp_path, lease_s=1.0)
    with serving(settings, TINY) as served, running(served.service):
        jobs = asked(served, 6)
        other = sqlite3.connect(settings.data_directory / "store.sqlite", isolation_level=None)
        other.execute("BEGIN IMMEDIATE")
        time.sleep(10.0)
        other.execute("ROLLBACK")
        other.close()
        assert recovers(lambda: ask(served, 0, 0.3)).status_code in (200, 202)
        check_all_done(served, jobs)
