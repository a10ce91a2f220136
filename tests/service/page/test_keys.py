"""API keys on: the page loads without one, asks for it, and forgets it with the tab."""

from __future__ import annotations

import zipfile
from pathlib import Path

from scaling_service.client import Client
from scaling_service.service.store import keys
from scaling_service.service.store.store import Store
from tests.cli.serving import served
from tests.service.page.conftest import Visit
from tests.service.page.visitor import Visitor
from tests.service.page.walker import put_walker


def new_key(folder: Path) -> str:
    store = Store.open(folder)
    try:
        return keys.create(store.database, "lab")[1]
    finally:
        store.close()


def takes_away(visitor: Visitor, key: str, lab: Path, folder: Path) -> None:
    """Files and the report are fetched by the browser itself, which sends no key."""
    with Client(visitor.url, key) as client:
        walker = put_walker(client, "S01", lab, folder)
        job = client.wait(client.ask("comparisons", subject=walker, methods=["MB"]))
    visitor.go(f"jobs/{job.id}/files")
    with visitor.page.expect_download() as coming:
        visitor.page.get_by_role("button", name="Everything as one zip").click()
    with zipfile.ZipFile(coming.value.path()) as archive:
        assert "comparison.json" in archive.namelist()
    with visitor.page.expect_popup() as opened:
        visitor.press("The report")
    opened.value.get_by_role("link", name="Verdict").wait_for()
    assert key not in opened.value.url


def test_a_key_is_asked_for_and_kept_in_the_tab(visit: Visit, example: Path, tmp_path: Path) -> None:
    key = new_key(tmp_path / "data")
    with served(tmp_path / "data") as url:
        visitor = visit(url)
        visitor.go("jobs")
        visitor.sees("This service asks for an API key")
        visitor.page.get_by_label("Key", exact=True).fill("wrong")
        visitor.press("Use it")
        visitor.sees("The service does not know this key")
        visitor.page.get_by_label("Key", exact=True).fill(key)
        visitor.press("Use it")
        visitor.sees("None yet.")
        kept = visitor.page.evaluate("() => [Object.values(sessionStorage), Object.values(localStorage)]")
        assert kept == [[key], []]
        visitor.page.reload()
        visitor.sees("None yet.")

        takes_away(visitor, key, example / "lab", tmp_path / "files")

        other = visit(url)  # another tab
        other.go("jobs")
        other.sees("This service asks for an API key")
