"""Leases under many runners: each job has one holder, and a stale one keeps nothing."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections import Counter

import pytest
from sqlalchemy import update

from scaling_service.documents.jobs import Failure, State
from scaling_service.service.jobs.ledger import AttemptOutput, Ledger, QueueFull
from scaling_service.service.jobs.machine import Event
from scaling_service.service.store import jobs
from scaling_service.service.store.blobs import prepare
from scaling_service.service.store.jobs import NewJob
from scaling_service.service.store.store import Store
from scaling_service.service.store.tables import JobRow
from scaling_service.service.store.tables import jobs as table

WHY = Failure(kind="Test", problem="it was so")


def new(number: int, owner: str = "lab") -> NewJob:
    return NewJob(
        id=f"{owner}-{number:04}",
        owner=owner,
        kind="tiny",
        code_version="1",
        specification="{}",
        subjects=(),
        inputs=(),
    )


def ledger_of(store: Store, lease_s: float = 60.0) -> Ledger:
    return Ledger(store, most_losses=3, lease_s=lease_s)


@pytest.fixture
def ledger(store: Store) -> Ledger:
    return ledger_of(store)


def ask(ledger: Ledger, number: int, owner: str = "lab", most: int = 1000) -> tuple[JobRow, bool]:
    return ledger.ask(lambda _connection: new(number, owner), most)


def made(store: Store, text: str) -> AttemptOutput:
    scratch = store.blobs.uploads / f"made-{text}"
    scratch.write_text(text)
    return AttemptOutput(f'"{text}"', (("out.txt", prepare(scratch)),))


def outdate(store: Store, job: str) -> None:
    with store.write() as connection:
        connection.execute(update(table).where(table.c.id == job).values(lease_until_us=0))


def test_the_same_request_finds_the_same_job(ledger: Ledger) -> None:
    first, queued = ask(ledger, 1)
    again, queued_again = ask(ledger, 1)
    assert (queued, queued_again) == (True, False)
    assert first == again
    assert ledger.lease("a", "host") is not None
    assert ledger.lease("a", "host") is None


def test_many_who_ask_at_once_get_one_job(store: Store) -> None:
    ledger = ledger_of(store)
    found, barrier = list[bool](), threading.Barrier(8)

    def go() -> None:
        barrier.wait()
        found.append(ask(ledger, 1)[1])

    threads = [threading.Thread(target=go) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(found) == 7 * [False] + [True]


def test_a_failed_or_cancelled_job_is_queued_again_when_it_is_asked_for(ledger: Ledger) -> None:
    ask(ledger, 1)
    held = ledger.lease("a", "host")
    assert held is not None
    assert ledger.settle(held, Event.FAIL, WHY, "{}") is State.FAILED
    failed = jobs.get(ledger.store.database, "lab", held.id)
    assert failed.failure == WHY
    again, queued = ask(ledger, 1)
    assert queued
    assert (again.state, again.failure, again.finished_us, again.attempt) == (State.QUEUED, None, None, 1)
    assert ledger.cancel("lab", held.id).state is State.CANCELLED
    assert ask(ledger, 1)[1]


def test_a_stale_attempt_cannot_commit(store: Store) -> None:
    ledger = ledger_of(store)
    ask(ledger, 1)
    first = ledger.lease("a", "host")
    assert first is not None
    outdate(store, first.id)
    assert ledger.take_back() == [first.id]
    second = ledger.lease("a", "host")  # the very same worker: only the attempt tells them apart
    assert second is not None
    assert ledger.finish(first, made(store, "stale"), "{}") is None
    assert ledger.settle(first, Event.FAIL, WHY, "{}") is None
    assert ledger.finish(second, made(store, "good"), "{}") is State.DONE
    assert ledger.finish(second, made(store, "twice"), "{}") is None
    assert jobs.read_documents(store.database, "lab", first.id)[1] == '"good"'
    (file,) = jobs.list_files(store.database, "lab", first.id)
    assert store.blobs.path(file.sha256).read_text() == "good"


def test_a_result_is_kept_whole_or_not_at_all(store: Store) -> None:
    ledger = ledger_of(store)
    ask(ledger, 1)
    held = ledger.lease("a", "host")
    assert held is not None
    lost = made(store, "lost")
    lost.files[0][1].scratch.unlink()
    with pytest.raises(Exception, match="not there"):
        ledger.finish(held, lost, "{}")
    assert jobs.get(store.database, "lab", held.id).state is State.RUNNING
    assert jobs.list_files(store.database, "lab", held.id) == []
    assert ledger.finish(held, made(store, "lost"), "{}") is State.DONE


def test_a_worker_that_renews_keeps_its_jobs(store: Store) -> None:
    ledger = ledger_of(store)
    for k in range(2):
        ask(ledger, k)
    held = ledger.lease("a", "host")
    other = ledger.lease("b", "host")
    assert held is not None
    assert other is not None
    for job in (held.id, other.id):
        outdate(store, job)
    jobs.renew(store.database, "a", 60.0)
    assert ledger.take_back() == [other.id]
    assert set(jobs.list_held(store.database, "a")) == {held.id}
    assert ledger.take_back(dead=["a"]) == [held.id]


def test_a_job_that_loses_its_workers_fails_at_last_and_waits_behind_the_others(store: Store) -> None:
    ledger = ledger_of(store)
    ask(ledger, 1)
    for k in range(3):
        held = ledger.lease("a", "host")
        assert held is not None
        assert held.id == "lab-0001"
        if k == 0:
            ask(ledger, 2)
        assert ledger.settle(held, Event.LOSE, WHY, "{}") is (State.FAILED if k == 2 else State.QUEUED)
        if k == 0:
            following = ledger.lease("a", "host")
            assert following is not None
            assert following.id == "lab-0002"


def test_cancelling(store: Store) -> None:
    ledger = ledger_of(store)
    ask(ledger, 1)
    held = ledger.lease("a", "host")
    assert held is not None
    assert ledger.cancel("lab", held.id).state is State.CANCELLING
    assert ledger.cancel("lab", held.id).state is State.CANCELLING
    assert ledger.finish(held, made(store, "late"), "{}") is State.CANCELLED
    assert jobs.read_documents(store.database, "lab", held.id)[1] is None
    assert ledger.cancel("lab", held.id).state is State.CANCELLED


def test_owners_take_turns(store: Store) -> None:
    ledger = ledger_of(store)
    for k in range(6):
        ask(ledger, k, "greedy")
    for k in range(2):
        ask(ledger, k, "modest")
    order = [row.owner for _ in range(8) if (row := ledger.lease("a", "host")) is not None]
    assert order[:4].count("modest") == 2
    assert order[4:] == 4 * ["greedy"]


def test_a_queue_has_an_end(store: Store) -> None:
    ledger = ledger_of(store)
    for k in range(3):
        ask(ledger, k, most=3)
    with pytest.raises(QueueFull, match="3 jobs"):
        ask(ledger, 3, most=3)
    assert ask(ledger, 0, most=3)[1] is False  # what is there already is found
    assert ask(ledger, 3, "other", most=3)[1]


LEASING = """
import sys
from pathlib import Path
from scaling_service.service.jobs.ledger import Ledger
from scaling_service.service.store.store import Store
store = Store.open(Path(sys.argv[1]), sys.argv[2] or None)
ledger = Ledger(store, 3, 60.0)
while (row := ledger.lease(sys.argv[3], "host")) is not None:
    print(row.id)
store.close()
"""


def test_runners_in_many_processes_and_threads_never_lease_one_job_twice(
    store: Store, database_url: str | None
) -> None:
    ledger = ledger_of(store)
    for k in range(60):
        ask(ledger, k)
    arguments = [sys.executable, "-c", LEASING, str(store.blobs.folder), database_url or ""]
    processes = [subprocess.Popen([*arguments, f"p{k}"], stdout=subprocess.PIPE, text=True) for k in range(2)]
    leased = list[str]()

    def lease(name: str) -> None:
        while (row := ledger.lease(name, "host")) is not None:
            leased.append(row.id)

    threads = [threading.Thread(target=lease, args=(f"t{k}",)) for k in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for process in processes:
        leased += process.communicate(timeout=60)[0].split()
        assert process.returncode == 0
    assert Counter(leased) == Counter(f"lab-{k:04}" for k in range(60))
