"""Jobs that are made of others: each part is computed once, whatever becomes of the others."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest

from scaling_service.documents.jobs import State
from scaling_service.service.jobs.ledger import QueueFull
from scaling_service.service.jobs.service import Service, open_store
from scaling_service.service.jobs.settings import ServiceSettings
from scaling_service.service.store import deletion, parts
from scaling_service.service.store.errors import InUse, NotFound
from scaling_service.service.store.tables import JobRow
from tests.service.jobs.services import ended, running, until
from tests.service.jobs.wholes import WHOLES


@pytest.fixture
def service(settings: ServiceSettings) -> Iterator[Service]:
    made = Service(open_store(settings), settings, WHOLES)
    yield made
    made.close()


def ask(service: Service, *numbers: int, owner: str = "lab", **more: object) -> str:
    return service.ask(owner, "whole", {"numbers": list(numbers), **more})[0].id


def members(service: Service, owner: str = "lab") -> dict[int, JobRow]:
    rows = service.jobs(owner, kind="part", limit=500).items
    return {json.loads(service.specification(owner, row.id))["request"]["number"]: row for row in rows}


def result(service: Service, job: str) -> Any:
    row = ended(service, "lab", job)
    assert row.state is State.DONE, row.failure
    return json.loads(service.result("lab", job) or "")


def test_parts_are_computed_and_put_together(service: Service) -> None:
    job = ask(service, 3, 1, 2, seconds=0.2)
    assert service.job("lab", job).state is State.WAITING
    shares = set[float]()

    def over() -> bool:
        row = service.job("lab", job)
        shares.add(row.progress_share)
        return row.state.is_over

    with running(service):
        until(over)
        found = result(service, job)
    assert found == {"sum": 14, "numbers": [3, 1, 2], "failed": []}
    assert len(shares) >= 4
    assert {row.name for row in service.files("lab", job)} == {
        "sum.txt",
        "1/square.txt",
        "2/square.txt",
        "3/square.txt",
    }
    assert service.file("lab", job, "2/square.txt")[1].read_text() == "4"


def test_one_failure_or_crash_stops_no_other(service: Service) -> None:
    job = ask(service, 1, 2, 3, 4, failing=[2], crashing=[3])
    with running(service):
        assert result(service, job) == {"sum": 17, "numbers": [1, 2, 3, 4], "failed": [2, 3]}
    failure = members(service)[2].failure
    assert failure is not None
    assert failure.kind == "MarkerMissing"


def test_what_another_batch_did_is_not_done_again(service: Service) -> None:
    first = ask(service, 1, 2)
    with running(service):
        result(service, first)
        before = members(service)
        assert result(service, ask(service, 2, 3))["sum"] == 13
    after = members(service)
    assert [after[k] for k in (1, 2)] == [before[k] for k in (1, 2)]
    with running(service):
        assert result(service, ask(service, 1, 3))["sum"] == 10  # nothing was left to wait for
    assert members(service) == after


def test_cancelling_stops_the_parts_that_nobody_else_needs(service: Service) -> None:
    first, second = ask(service, 1, 2, seconds=60.0), ask(service, 2, 3, seconds=60.0)
    with running(service):
        until(lambda: members(service)[1].state is State.RUNNING)
        assert service.cancel("lab", first).state is State.CANCELLED
        until(lambda: members(service)[1].state is State.CANCELLED, within_s=5.0)
        assert not members(service)[2].state.is_over
        service.cancel("lab", second)
        until(lambda: all(row.state is State.CANCELLED for row in members(service).values()), within_s=5.0)
    again = ask(service, 1, 2, seconds=60.0)
    assert (again, service.job("lab", again).state) == (first, State.WAITING)
    assert [members(service)[k].state for k in (1, 2, 3)] == [State.QUEUED, State.QUEUED, State.CANCELLED]


def test_a_cancelled_part_that_is_asked_for_again_before_it_stopped_is_computed(service: Service) -> None:
    first = ask(service, 1, seconds=1.0)
    with running(service):
        until(lambda: members(service)[1].state is State.RUNNING)
        service.cancel("lab", first)
        assert members(service)[1].state is State.CANCELLING
        ask(service, 1, seconds=1.0)
        assert result(service, first)["sum"] == 1


def test_a_part_goes_with_its_wholes_only(service: Service) -> None:
    first, second = ask(service, 1, 2), ask(service, 2, 3)
    part = members(service)[2].id
    for refused in (service.cancel, service.delete_job):
        with pytest.raises(InUse, match="part of another"):
            refused("lab", part)
    with running(service):
        result(service, first)
        result(service, second)
    deletion.expire(service.store.database, service.store.blobs, days=1.0)  # nothing is so old
    service.delete_job("lab", first)
    assert set(members(service)) == {2, 3}
    assert result(service, second)["sum"] == 13
    service.delete_job("lab", second)
    assert members(service) == {}
    assert list(service.store.blobs.list_stored()) == []


def test_what_a_kept_job_is_made_of_does_not_grow_old(service: Service) -> None:
    job = ask(service, 1)
    with running(service):
        result(service, job)
    database, blobs = service.store.database, service.store.blobs
    new = ask(service, 1, 2)
    assert deletion.expire(database, blobs, days=-1.0) == (1, 0)  # of all that is over, the first whole
    assert set(members(service)) == {1, 2}
    with running(service):
        assert result(service, new)["sum"] == 5
    assert deletion.expire(database, blobs, days=-1.0) == (3, 0)


def test_a_person_does_not_wait_for_a_batch(service: Service) -> None:
    ask(service, *range(20))
    alone = service.ask("lab", "tiny", {"number": 99})[0].id
    with service.store.write() as connection:
        assert parts.count_ended(connection, ask_id(service)) == (0, 20)
    with running(service):
        ended(service, "lab", alone)
    assert sum(row.state is State.QUEUED for row in members(service).values()) >= 15


def ask_id(service: Service) -> str:
    return service.jobs("lab", kind="whole").items[0].id


def test_parts_count_for_the_queue_and_cannot_be_asked_for(settings: ServiceSettings) -> None:
    small = settings.model_copy(update={"limit_queue": 5})
    service = Service(open_store(small), small, WHOLES)
    ask(service, 1, 2, 3)
    with pytest.raises(QueueFull):
        ask(service, 4, 5, 6)
    ask(service, 4, 5)
    with pytest.raises(NotFound):
        service.ask("lab", "part", {"number": 1})
    service.close()
