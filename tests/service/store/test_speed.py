"""Many jobs do not slow anything down."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from scaling_service.documents.jobs import State
from scaling_service.service.store import jobs
from scaling_service.service.store.store import Store
from tests.service.store.postgres import server
from tests.service.store.rows import add_job, add_many

FEW, MANY, PROMISED = 1_000, 10_000, 100_000
LIMIT_S = 0.020  # s: what a person and a polling client are promised, on a machine that does nothing else
SLOWER = 3.0
"""As often the time with few jobs: looking at each job would make it ten."""


def questions(store: Store, number: int) -> dict[str, Callable[[], object]]:
    """What people and the service's own parts ask, in a store filled with so many jobs."""
    names = add_many(store, "lab", number)
    add_job(store, "lab", "{}", subjects=("S01",))
    database = store.database
    middle = jobs.list_page(database, "lab", limit=500)
    for _ in range(number // 1000 - 1):
        middle = jobs.list_page(database, "lab", cursor=middle.following, limit=500)
    return {
        "status": lambda: jobs.get(database, "lab", names[number // 2]),
        "first page": lambda: jobs.list_page(database, "lab"),
        "deep page": lambda: jobs.list_page(database, "lab", cursor=middle.following),
        "page of a state": lambda: jobs.list_page(database, "lab", state=State.FAILED),
        "page of a kind": lambda: jobs.list_page(database, "lab", kind="landmarks"),
        "page of a subject": lambda: jobs.list_page(database, "lab", subject="S01"),
        "page of a stranger": lambda: jobs.list_page(database, "stranger"),
        "anything queued": lambda: jobs.has_queued(database),
        "held": lambda: jobs.list_held(database, "someone"),
    }


def time_s(ask: Callable[[], object]) -> float:
    begun = time.perf_counter()
    ask()
    return time.perf_counter() - begun


def median_s(ask: Callable[[], object]) -> float:
    """The median of the times of eleven calls after a first."""
    return sorted([time_s(ask) for _ in range(12)][1:])[5]


def test_status_and_lists_are_as_quick_as_with_few_jobs(
    store: Store, database_url: str | None, tmp_path: Path
) -> None:
    # Asked in turns, the quickest of many: whatever else the machine does disturbs both alike, or neither.
    small = Store.open(tmp_path / "small", None if database_url is None else server().new_database())
    few, many = questions(small, FEW), questions(store, MANY)
    slower = {}
    for name in many:
        times = [(time_s(few[name]), time_s(many[name])) for _ in range(40)]
        quickest, taken = (min(column) for column in zip(*times, strict=True))
        sys.stdout.write(f"{name}: {1e3 * quickest:.2f} ms with few, {1e3 * taken:.2f} ms with many\n")
        slower[name] = taken / quickest
    small.close()
    assert {name: factor for name, factor in slower.items() if factor > SLOWER} == {}


@pytest.mark.benchmark
def test_status_lists_choosing_and_counting_keep_what_is_promised(store: Store) -> None:
    times = {name: median_s(ask) for name, ask in questions(store, PROMISED).items()}
    add_many(store, "crowd", PROMISED, state=State.QUEUED.value)
    with store.write() as connection:
        times["next queued"] = median_s(lambda: jobs.lock_next(connection))
        times["10,000 waiting"] = median_s(lambda: jobs.has_queued_at_least(connection, "crowd", 10_000))
    for name, taken in times.items():
        sys.stdout.write(f"{name}: {1e3 * taken:.2f} ms\n")
    assert {name: taken for name, taken in times.items() if taken > LIMIT_S} == {}
    sys.stdout.write(f"counts: {1e3 * median_s(lambda: jobs.count_by_state(store.database)):.1f} ms\n")
