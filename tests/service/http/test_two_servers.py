"""A cohort on a Dask cluster and PostgreSQL, with two servers of which one is killed: nothing is lost."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
import requests

from scaling_service.client import Client
from scaling_service.documents.jobs import State
from scaling_service.service.jobs import health
from tests.cli.serving import ENVIRONMENT, free_port, served, start
from tests.service.http.served import serving, settings_in
from tests.service.http.test_batches import cohort, more_than, scaled
from tests.service.http.test_numbers import untimed
from tests.service.jobs.services import until
from tests.service.store.postgres import server

PEOPLE = 4


@contextmanager
def dask(*words: str, log: Path) -> Iterator[None]:
    """A program of Dask's that ends with the block."""
    program = shutil.which("dask", path=str(Path(sys.executable).parent))
    assert program is not None
    with log.open("wb") as file:
        process = subprocess.Popen(
            [program, *words], env=ENVIRONMENT, stdout=file, stderr=file, cwd=log.parent
        )
    try:
        yield
    finally:
        process.terminate()
        process.wait(30)


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[str]:
    """A scheduler with two workers: its address."""
    pytest.importorskip("distributed", reason="Dask is not installed")
    address = f"tcp://127.0.0.1:{free_port()}"
    with ExitStack() as stack:
        words = ("--host", "127.0.0.1", "--port", address.rpartition(":")[2], "--no-dashboard")
        stack.enter_context(dask("scheduler", *words, log=tmp_path / "scheduler.log"))
        asked = [sys.executable, "-m", health.__name__, address]
        until(lambda: subprocess.run(asked, check=False).returncode == 0)
        for number in range(2):
            more = ("--nthreads", "6", "--no-nanny", "--no-dashboard", "--local-directory", str(tmp_path))
            stack.enter_context(dask("worker", address, *more, log=tmp_path / f"worker_{number}.log"))
        yield address


@pytest.mark.costly
def test_a_cohort_on_two_servers_of_which_one_is_killed(
    cluster: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "files").mkdir()
    with serving(settings_in(tmp_path / "quiet")) as quiet:
        alone = scaled(quiet, tmp_path / "files")
    chosen = {
        "DATABASE_URL": server().new_database(),
        "DASK_ADDRESS": cluster,
        "WORKERS": "1",
        "LEASE_S": "5",
    }
    for name, value in chosen.items():
        monkeypatch.setitem(ENVIRONMENT, f"SCALING_SERVICE_{name}", value)
    data = tmp_path / "data"
    process, first = start(data)
    with served(data) as second:
        with Client(first) as client:
            batch = client.ask(
                "batches", subjects=cohort(client, tmp_path / "files", PEOPLE), methods=["MB"]
            ).id
            link = requests.post(
                f"{first}/v1/links", json={"path": "/v1/subjects/P00/files/walk.trc"}, timeout=30
            ).json()
            more_than(0, client)
        process.kill()
        process.wait(30)
        assert process.stdout is not None
        process.stdout.close()
        with Client(second, patience_s=60.0) as client:
            assert client.wait(batch, 120.0).state is State.DONE
            assert json.dumps(untimed(client.result(batch))) == json.dumps(untimed(alone))
            members = list(client.jobs(kind="batch-member"))
        assert len(members) == PEOPLE
        written = (tmp_path / "files" / "walk.trc").read_bytes()
        assert requests.get(second + link["path"], timeout=30).content == written
