"""Several jobs at once: live, cancelled by a click, found again in the history and by their links."""

from __future__ import annotations

import requests

from tests.service.page.conftest import Visit
from tests.service.page.visitor import LONG_MS


def test_several_jobs_at_once(visit: Visit, url: str) -> None:
    requests.post(f"{url}/v1/examples?persons=2", timeout=30).raise_for_status()
    # The page does not offer it: these recordings have no forces, so it fails.
    requests.post(f"{url}/v1/dynamics", json={"subject": "example_2"}, timeout=30).raise_for_status()
    visitor = visit(url)
    visitor.go("subjects/example_2/run")
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
    visitor.go("jobs?subject=example_2&state=cancelled")
    visitor.sees("Jobs on example_2")
    page.locator(".jobs li").first.wait_for()
    assert page.locator(".jobs li").count() == 1
    page.goto(address)
    page.locator(".problem .remedy").wait_for()
