"""Killed with signal 9 at random moments, again and again: nothing is lost, nothing is double."""

from __future__ import annotations

import json
import os
import random
import signal
import sys
import time
from collections import Counter
from contextlib import suppress

import pytest

from scaling_service.documents.jobs import State
from scaling_service.service.jobs.service import Service
from scaling_service.service.jobs.settings import ServiceSettings
from scaling_service.service.store.jobs import list_holders
from tests.service.jobs.services import all_done, children_of, runner_process, tiny_service, until


def torment(settings: ServiceSettings, n_jobs: int, n_kills: int, job_s: float, seed: int) -> str:
    """Kill runners, fork servers and children while they work; what was seen, for a report."""
    draw, killed = random.Random(seed), Counter[str]()
    begun = time.monotonic()
    with tiny_service(settings) as service:
        jobs = [service.ask("lab", "tiny", {"number": k, "seconds": job_s})[0].id for k in range(n_jobs)]
        runner = runner_process(settings)
        try:
            for _ in range(n_kills):
                at_work(service, runner.pid)
                time.sleep(draw.uniform(0.0, 2 * job_s))
                victim, what = draw.choice(processes(runner.pid))
                killed[what] += 1
                with suppress(ProcessLookupError):
                    os.kill(victim, signal.SIGKILL)
                if victim == runner.pid:
                    runner.wait()
                    runner = runner_process(settings)
            left_to_do = sum(number for state, number in service.counts().items() if not state.is_over)
            until(lambda: all_done(service), within_s=120.0)
            check(service, jobs)
            losses = [service.job("lab", job).losses for job in jobs]
            service.store.tidy()
            left = list(service.store.blobs.work.iterdir())
        finally:
            runner.kill()
            runner.wait()
    assert left == []
    assert sum(losses) > 0, "no kill hit anything"
    lost = f"{sum(losses)} attempts lost (at most {max(losses)} of one job)"
    seconds = f"{time.monotonic() - begun:.0f} s"
    return f"{n_jobs} jobs, killed {dict(killed)}: {lost}; {left_to_do} left after it; done in {seconds}\n"


def at_work(service: Service, runner: int) -> None:
    """Wait until this very runner has a job running, or nothing is left to do."""
    database = service.store.database
    until(
        lambda: any(f"-{runner}-" in name for name in list_holders(database)) or all_done(service),
        within_s=60.0,
    )


def processes(runner: int) -> list[tuple[int, str]]:
    """The runner, its fork server and the children: each kind as likely as the others."""
    servers = children_of(runner)
    below = [child for server in servers for child in children_of(server)]
    kinds = {"runner": [runner], "fork server": servers, "child": below}
    most = max(map(len, kinds.values()))
    return [(number, kind) for kind, found in kinds.items() for number in (found * most)[:most]]


def check(service: Service, jobs: list[str]) -> None:
    """Every job is done and has the one result that is right, with its file."""
    for k, job in enumerate(jobs):
        row = service.job("lab", job)
        assert (row.state, row.failure) == (State.DONE, None)
        assert json.loads(service.result("lab", job) or "")["square"] == k**2
        (file,) = service.files("lab", job)
        assert service.store.blobs.path(file.sha256).read_text() == str(k**2)
    assert service.counts()[State.DONE] == len(jobs)


@pytest.mark.parametrize(
    "database_url", ["sqlite", pytest.param("postgresql", marks=pytest.mark.costly)], indirect=True
)
def test_nothing_is_lost_or_doubled_by_kill_9(settings: ServiceSettings) -> None:
    torment(settings, n_jobs=12, n_kills=4, job_s=0.2, seed=1)


@pytest.mark.benchmark
def test_fifty_kills_during_a_hundred_jobs(settings: ServiceSettings) -> None:
    sys.stdout.write(torment(settings, n_jobs=100, n_kills=50, job_s=0.5, seed=2))
