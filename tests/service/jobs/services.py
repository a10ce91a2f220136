"""A service with a runner in a thread, or in processes that can be killed."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from scaling_service.documents.jobs import State
from scaling_service.service.jobs.attempts import MakeExecutor
from scaling_service.service.jobs.runner import Runner
from scaling_service.service.jobs.service import Service, open_store
from scaling_service.service.jobs.settings import ServiceSettings
from scaling_service.service.store.tables import JobRow
from tests.service.jobs.tiny import TINY

ROOT = Path(__file__).resolve().parents[3]


@contextmanager
def tiny_service(settings: ServiceSettings) -> Iterator[Service]:
    """A service whose jobs are tiny; nothing runs yet."""
    service = Service(open_store(settings), settings, TINY)
    yield service
    service.close()


@contextmanager
def running(service: Service, make_executor: MakeExecutor | None = None) -> Iterator[Runner]:
    """A runner at work in a thread."""
    runner = Runner(service.store, service.settings, kinds=service.kinds, make_executor=make_executor)
    thread = threading.Thread(target=runner.run)
    thread.start()
    try:
        yield runner
    finally:
        runner.stop()
        thread.join(30)
        assert not thread.is_alive()


def until(what: Callable[[], Any], within_s: float = 30.0) -> None:
    """Wait until something holds."""
    end = time.monotonic() + within_s
    while not what():
        assert time.monotonic() < end, "it took too long"
        time.sleep(0.02)


def ended(service: Service, owner: str, job: str, within_s: float = 30.0) -> JobRow:
    """The job once it is over."""
    until(lambda: service.job(owner, job).state.is_over, within_s)
    return service.job(owner, job)


def all_done(service: Service) -> bool:
    """Whether nothing waits or runs."""
    counts = service.counts()
    return not any(counts[state] for state in State if not state.is_over)


RUNNING = """
import sys
from scaling_service.service.jobs.process import log_as_json
from scaling_service.service.jobs.runner import Runner
from scaling_service.service.jobs.service import open_store
from scaling_service.service.jobs.settings import ServiceSettings
from tests.service.jobs.tiny import TINY, warm_little
warm_little()
settings = ServiceSettings.model_validate_json(sys.argv[1])
Runner(open_store(settings), settings, kinds=TINY).run()
"""


def runner_process(settings: ServiceSettings) -> subprocess.Popen[bytes]:
    """A runner in a process of its own, in a session of its own."""
    return subprocess.Popen(
        [sys.executable, "-c", RUNNING, settings.with_secrets()],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        start_new_session=True,
    )


def children_of(process: int) -> list[int]:
    """The processes that one started, as the kernel lists them."""
    found: list[int] = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            with suppress(FileNotFoundError, ProcessLookupError):
                if int((entry / "stat").read_text().rpartition(")")[2].split()[1]) == process:
                    found.append(int(entry.name))
    return found
