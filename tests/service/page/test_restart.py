"""The service goes away while a job runs, and comes back: the page says so and goes on by itself."""

from __future__ import annotations

import os
import signal
import subprocess
from pathlib import Path
from typing import Any

import pytest
import requests

from scaling_service.client import Client
from tests.cli.serving import free_port, start
from tests.service.page.conftest import Visit
from tests.service.page.visitor import Visitor


@pytest.mark.costly  # waits for two fresh starts
def test_the_page_recovers_by_itself(visit: Visit, example: Path, tmp_path: Path) -> None:
    (tmp_path / "settings.yaml").write_text("lease_s: 4\n", encoding="utf-8")  # soon taken for dead
    options = ("--port", str(free_port()), "--settings", str(tmp_path / "settings.yaml"))
    process, url = start(tmp_path / "data", *options)
    try:
        visitor = visit(url)
        begins_a_job(visitor, example / "lab")
        kill(process)
        visitor.sees("The service does not answer")
        process, _ = start(tmp_path / "data", *options)
        visitor.sees("How far to trust")
        assert visitor.page.get_by_text("The service does not answer").count() == 0
        with Client(url) as client:
            jobs = [job for job in client.jobs() if job.kind == "scaling"]
        assert [(job.state, job.attempt) for job in jobs] == [("done", 2)]
    finally:
        kill(process)


@pytest.mark.costly
def test_any_request_may_be_lost(visit: Visit, url: str) -> None:
    """A part of the page, a document or an array: it is asked for again, and nothing is told as a defect."""
    requests.post(f"{url}/v1/examples", timeout=30).raise_for_status()
    with Client(url) as client:
        job = client.wait(client.ask("comparisons", subject="example", methods=["MB"]))
    views = {"": "Load the example", f"jobs/{job.id}": "How far to trust"}
    visitor = visit(url)
    for place, text in views.items():
        lost, asked = 0, [""]
        while lost < len(asked):  # the next one each time, until there are no more
            visitor.page.unroute_all()
            visitor.go("nowhere")
            visitor.page.reload()  # without the parts that are there
            visitor.sees("There is nothing here")
            asked = lose(visitor, lost)
            visitor.page.evaluate("(place) => { location.hash = place; }", f"#/{place}")
            visitor.sees(text, 20_000)
            visitor.settles()
            visitor.met_no_defect()
            lost += 1
        assert lost > 1, place


def lose(visitor: Visitor, lost: int) -> list[str]:
    """Break the connection at one request, counted from now; the list grows with what is asked for."""
    asked: list[str] = []

    def answer(route: Any) -> None:
        asked.append(route.request.url)
        if len(asked) == lost + 1:
            route.abort("connectionreset")
        else:
            route.continue_()

    visitor.page.route("**/*", answer)
    return asked


def begins_a_job(visitor: Visitor, lab: Path) -> None:
    with Client(visitor.url) as client:
        client.put_subject_file(lab / "subject.json")
    visitor.go("subjects/example/run")
    visitor.sees("Scale by several methods and compare them")  # after the files were looked at
    boxes = visitor.page.locator(".methods input")
    boxes.first.wait_for()
    for box in boxes.all()[1:]:  # one method will do: reading alone takes long enough
        box.uncheck()
    visitor.press("Compare")
    visitor.sees("reading the recordings")


def kill(process: subprocess.Popen[str]) -> None:
    """With all that it started, as when the power fails."""
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert process.stdout is not None
    process.stdout.close()
