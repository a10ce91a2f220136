"""A service over HTTP whose processes are killed with signal 9 at random moments."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from scaling_service.client import Client
from scaling_service.documents.jobs import State
from tests.cli.serving import start
from tests.service.jobs.services import children_of

WARM_S = 10.0
"""s: after so long without a process that computes, nothing is left to do."""

SERVER = [sys.executable, "-m", "tests.service.http.tiny_server"]


class Tormented:
    """Its server, its runner, its fork server and the processes that compute; each is killed as often."""

    def __init__(self, folder: Path, seed: int, command: list[str]) -> None:
        self._folder, self._draw, self._command = folder, random.Random(seed), command
        self.killed = Counter[str]()
        self.process, self.url = start(folder, command=command)

    def kill_one(self, within_s: tuple[float, float]) -> None:
        """While something is computed, kill a random process after a random time."""
        patience = time.monotonic() + WARM_S
        while "child" not in self._processes() and time.monotonic() < patience:
            time.sleep(0.05)
        time.sleep(self._draw.uniform(*within_s))
        self.kill(self._draw.choice(sorted(self._processes())))

    def kill(self, what: str) -> None:
        """Kill a process of one kind; the server is started again."""
        victim = self._draw.choice(self._processes().get(what, [0]))
        if not victim:  # it ended by itself
            return
        self.killed[what] += 1
        with suppress(ProcessLookupError):
            os.kill(victim, signal.SIGKILL)
        if what == "server":
            gone(self.process)
            self.process, self.url = start(self._folder, command=self._command)

    def _processes(self) -> dict[str, list[int]]:
        runners = children_of(self.process.pid)
        servers = [found for runner in runners for found in children_of(runner)]
        children = [found for server in servers for found in children_of(server)]
        kinds = {"server": [self.process.pid], "runner": runners, "fork server": servers, "child": children}
        return {what: found for what, found in kinds.items() if found}


@contextmanager
def tormented(folder: Path, seed: int, command: list[str] | None = None) -> Iterator[Tormented]:
    """Such a service; it ends tidily."""
    made = Tormented(folder, seed, command or SERVER)
    try:
        yield made
        made.process.terminate()
        assert made.process.wait(30) == 0
    finally:
        gone(made.process)


def gone(process: subprocess.Popen[str]) -> None:
    """See a process off."""
    process.kill()
    process.wait()
    assert process.stdout is not None
    process.stdout.close()


def finished(client: Client, **chosen: str) -> dict[str, tuple[object, ...]]:
    """Every job that is done, with what tells one computation from another."""
    return {
        job.id: (job.attempt, job.finished_at, client.result(job).get("pid"))
        for job in client.jobs(state=State.DONE.value, **chosen)
    }
