"""The store goes away in the middle of the work, and comes back: everything ends as it should."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from scaling_service.runner.service import Service
from scaling_service.runner.settings import ServiceSettings
from scaling_service.schemas.jobs import State
from scaling_service.store.errors import StoreUnavailable
from tests.runner.services import all_done, running, tiny_service, until
from tests.store.disks import small_disk
from tests.store.postgres import Server, require


def asked(service: Service, number: int) -> list[str]:
    return [service.ask("lab", "tiny", {"number": k, "seconds": 0.3})[0].id for k in range(number)]


def outage(tmp_path: Path, seconds: float) -> None:
    """PostgreSQL is killed while jobs run, and is back after so long."""
    require()
    server = Server()
    settings = ServiceSettings(
        data_directory=tmp_path, database_url=server.new_database(), workers=2, lease_s=2.0, reserve_mb=0
    )
    try:
        with tiny_service(settings) as service, running(service):
            jobs = asked(service, 8)
            until(lambda: service.counts()[State.DONE] >= 2)
            server.stop()
            with pytest.raises(StoreUnavailable, match="does not answer"):
                service.job("lab", jobs[0])
            time.sleep(seconds)
            server.start()
            until(lambda: all_done(service))
            assert service.counts()[State.DONE] == 8
            assert [service.job("lab", job).losses for job in jobs] == 8 * [0]
    finally:
        server.remove()


def test_a_database_that_is_gone_for_longer_than_a_lease_costs_no_job(tmp_path: Path) -> None:
    outage(tmp_path, 3.0)


@pytest.mark.benchmark
def test_a_database_that_is_gone_for_ten_seconds_costs_no_job(tmp_path: Path) -> None:
    outage(tmp_path, 10.0)


def test_a_disk_that_is_full_for_a_while_costs_no_job(tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk", 16) as disk:
        settings = ServiceSettings(data_directory=disk.folder / "data", workers=2, lease_s=2.0, reserve_mb=2)
        with tiny_service(settings) as service, running(service):
            jobs = asked(service, 8)
            until(lambda: service.counts()[State.DONE] >= 2)
            disk.fill()
            time.sleep(1.5)
            assert not all_done(service)
            with pytest.raises(StoreUnavailable, match="no room"):
                service.ask("lab", "tiny", {"number": 99})
            disk.empty()
            until(lambda: all_done(service))
            assert {service.job("lab", job).state for job in jobs} == {State.DONE}
            assert service.store.database.run_apart("PRAGMA integrity_check") == ["ok"]
            service.store.tidy()
            assert list(service.store.blobs.work.iterdir()) == []
