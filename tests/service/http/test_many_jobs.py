"""A hundred thousand jobs in the store do not slow down what is asked over HTTP."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import pytest
import requests

from tests.service.http.served import Served, serving, settings_in
from tests.service.jobs.tiny import TINY
from tests.service.store.fixtures import database_url
from tests.service.store.rows import add_job, add_many

__all__ = ["database_url"]

NUMBER = 100_000
LIMIT_S = 0.020  # s: what a person and a polling client are promised
TIMES = 41


def times_ms(served: Served, paths: dict[str, str]) -> dict[str, tuple[float, float]]:
    """Median and the largest but one of the times of requests on a connection that stays open."""
    found = {}
    with requests.Session() as session:
        for name, path in paths.items():
            taken = []
            for _ in range(TIMES):
                begun = time.perf_counter()
                assert session.get(served.url + path, timeout=30).status_code == 200
                taken.append(time.perf_counter() - begun)
            taken.sort()
            found[name] = 1e3 * taken[TIMES // 2], 1e3 * taken[-2]
    return found


@pytest.mark.benchmark
def test_status_and_lists(tmp_path: Path, database_url: str | None) -> None:
    with serving(settings_in(tmp_path, database_url=database_url), TINY) as served:
        store = served.service.store
        names = add_many(store, "local", NUMBER)
        add_job(store, "local", "{}", subjects=("S01",))
        cursor = served.call("GET", "/v1/jobs?limit=500").json()["next"]
        for _ in range(20):
            cursor = served.call("GET", f"/v1/jobs?limit=500&cursor={cursor}").json()["next"]
        found = times_ms(
            served,
            {
                "status": f"/v1/jobs/{names[NUMBER // 2]}",
                "first page": "/v1/jobs",
                "deep page": f"/v1/jobs?cursor={cursor}",
                "page of a state": "/v1/jobs?state=failed",
                "page of a kind": "/v1/jobs?kind=landmarks",
                "page of a subject": "/v1/jobs?subject=S01",
                "subjects": "/v1/subjects",
                "health": "/health",
            },
        )
        which = "SQLite" if database_url is None else "PostgreSQL"
        sys.stdout.write(f"{which}, {NUMBER} jobs, load of the machine {os.getloadavg()[0]:.1f}\n")
        for name, (median, last) in found.items():
            sys.stdout.write(f"  {name}: median {median:.1f} ms, second largest of {TIMES} {last:.1f} ms\n")
        assert {name: median for name, (median, _) in found.items() if median > 1e3 * LIMIT_S} == {}
