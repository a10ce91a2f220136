"""Several jobs at once: live, cancelled by a click, found again in the history and by their links."""

from __future__ import annotations

from pathlib import Path

import requests

from scaling_service.client import Client
from tests.service.page.conftest import Visit
from tests.service.page.visitor import LONG_MS
from tests.service.page.walker import put_walker


def test_several_jobs_at_once(visit: Visit, url: str, example: Path, tmp_path: Path) -> None:
    with Client(url) as client:
        put_walker(client, "busy", example / "lab", tmp_path)
        # The page does not offer it: these recordings have no forces, so it fails.
        client.ask("dynamics", subject="busy")
    visitor = visit(url)
    visitor.go("subjects/busy/run")
    visitor.sees("Scale by several methods and compare them")  # after the files were looked at
    visitor.press("Start: Find the missing effect")
    page = visitor.page
    search = page.get_by_role("listitem").filter(has_text="Search for the missing effect")
    forces = page.get_by_role("listitem").filter(has_text="Residual forces")
    search.get_by_text("running").or_(search.get_by_text("%")).first.wait_for()
    search.get_by_role("button", name="Cancel").click()
    search.locator(".state.cancelled").wait_for(timeout=LONG_MS)
    forces.locator(".state.failed").wait_for(timeout=LONG_MS)
    forces.get_by_role("link").click()
    page.locator(".problem .remedy").wait_for()
    address = page.url
    visitor.go("jobs?subject=busy&state=cancelled")
    visitor.sees("Jobs on busy")
    page.locator(".jobs li").first.wait_for()
    assert page.locator(".jobs li").count() == 1
    page.goto(address)
    page.locator(".problem .remedy").wait_for()


def test_a_cohort_tells_how_long_it_will_take(visit: Visit, url: str, walked: str) -> None:
    """It has not begun itself while its members are at work."""
    path = f"/v1/jobs/{walked}"
    times = {"created_at": "2026-01-01T10:00:00Z", "started_at": None, "updated_at": "2026-01-01T10:10:00Z"}
    job = requests.get(url + path, timeout=10).json() | times
    job |= {"state": "waiting", "progress": {"what": "5 of 10 ended", "share": 0.5}, "finished_at": None}
    visitor = visit(url)
    visitor.page.route(f"**{path}", lambda route: route.fulfill(json=job))
    visitor.page.route(f"**{path}/events", lambda _: None)
    visitor.go(f"jobs/{walked}")
    visitor.sees("about 10 min left")
