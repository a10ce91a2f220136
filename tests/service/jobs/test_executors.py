"""The same results whatever the executor: threads, processes, a Dask cluster."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import warnings
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from pathlib import Path

import pytest

from scaling_service.documents.jobs import State
from scaling_service.service.jobs.attempts import MakeExecutor, choose_executor
from scaling_service.service.jobs.service import Service
from scaling_service.service.jobs.settings import ServiceSettings
from scaling_service.service.store.errors import StoreUnavailable
from tests.service.jobs.services import ROOT, ended, running, tiny_service, until
from tests.service.jobs.tiny import warm_little

NUMBER = 6


@pytest.fixture
def settings(tmp_path: Path) -> ServiceSettings:
    return ServiceSettings(data_directory=tmp_path / "data", workers=2, lease_s=5.0, reserve_mb=0)


@pytest.fixture
def service(settings: ServiceSettings) -> Iterator[Service]:
    with tiny_service(settings) as made:
        yield made


def make_pool() -> ProcessPoolExecutor:
    return ProcessPoolExecutor(2, multiprocessing.get_context("spawn"), initializer=warm_little)


def works(service: Service, make_executor: MakeExecutor | None) -> None:
    """Jobs end with the right results; one is cancelled; one fails; one whose process is killed goes on."""
    service.put_subject("lab", {"subject": {"id": "S01"}})
    with service.upload("lab", "S01", "a.txt") as upload:
        upload.write(b"a")
        upload.keep()
    jobs = [
        service.ask("lab", "tiny", {"number": k, "subject": "S01", "files": ["a.txt"]})[0].id
        for k in range(NUMBER)
    ]
    with running(service, make_executor):
        for k, job in enumerate(jobs):
            assert ended(service, "lab", job).state is State.DONE
            result = json.loads(service.result("lab", job) or "")
            assert (result["square"], result["read"]["a.txt"]) == (k**2, "a")
        failing = service.ask("lab", "tiny", {"fails": True})[0].id
        assert ended(service, "lab", failing).state is State.FAILED
        long = service.ask("lab", "tiny", {"seconds": 60.0})[0].id
        until(lambda: service.job("lab", long).progress_what == "waiting" and service.job("lab", long).worker)
        service.cancel("lab", long)
        assert ended(service, "lab", long).state is State.CANCELLED


def test_threads(service: Service) -> None:
    works(service, None)


def test_processes(service: Service) -> None:
    works(service, make_pool)


def test_a_pool_that_broke_is_made_anew(service: Service) -> None:
    pools = list[Executor]()

    def make() -> Executor:
        pools.append(make_pool())
        return pools[-1]

    job = service.ask("lab", "tiny", {"number": 5, "seconds": 1.5})[0].id
    with running(service, make):
        until(lambda: service.job("lab", job).progress_share > 0)
        for process in list(pools[0]._processes):  # type: ignore[attr-defined]
            os.kill(process, signal.SIGKILL)
        row = ended(service, "lab", job)
    assert (row.state, row.losses) == (State.DONE, 1)
    assert len(pools) == 2


def test_dask(service: Service, settings: ServiceSettings, monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed", reason="Dask is not installed")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Dask's own
        with distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, processes=True
        ) as cluster:
            with distributed.Client(cluster) as client:
                client.run(warm_little)
            clustered = settings.model_copy(update={"dask_address": cluster.scheduler_address})
            works(service, choose_executor(clustered))


def test_a_scheduler_that_does_not_answer_is_reported(
    settings: ServiceSettings, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed", reason="Dask is not installed")
    monkeypatch.setattr("scaling_service.service.jobs.attempts._CONNECT_S", 0.5)
    make = choose_executor(settings.model_copy(update={"dask_address": "tcp://127.0.0.1:9"}))
    with pytest.raises(StoreUnavailable, match="scheduler does not answer"):
        make()
