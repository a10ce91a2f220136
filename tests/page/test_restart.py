"""The service goes away while a job runs, and comes back: the page says so and goes on by itself."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import requests

from scaling_service.client import Client
from tests.cli.serving import free_port, start
from tests.page.conftest import Visit


def test_the_page_recovers_by_itself(visit: Visit, tmp_path: Path) -> None:
    (tmp_path / "settings.yaml").write_text("lease_s: 4\n", encoding="utf-8")  # soon taken for dead
    options = ("--port", str(free_port()), "--settings", str(tmp_path / "settings.yaml"))
    process, url = start(tmp_path / "data", *options)
    assert requests.post(f"{url}/v1/examples", timeout=30).json() == {"subjects": ["example"]}
    visitor = visit(url)
    visitor.go("subjects/example/run")
    for method in ("MB_lam", "MB_am", "EB_am"):  # what is left takes long enough
        visitor.page.get_by_role("checkbox", name=method).uncheck()
    visitor.press("Compare")
    visitor.sees("reading the recordings")
    os.killpg(process.pid, signal.SIGKILL)  # with all that it started, as when the power fails
    process.wait()
    assert process.stdout is not None
    process.stdout.close()
    visitor.sees("The service does not answer")
    process, _ = start(tmp_path / "data", *options)
    try:
        visitor.sees("How far to trust")
        assert visitor.page.get_by_text("The service does not answer").count() == 0
        with Client(url) as client:
            jobs = [job for job in client.jobs() if job.kind == "scaling"]
        assert [(job.state, job.attempt) for job in jobs] == [("done", 2)]
        assert requests.get(f"{url}/ready", timeout=10).ok
    finally:
        process.terminate()
        process.stdout.close()
        process.wait(30)
