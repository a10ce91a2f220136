"""Names from files are shown as they are, and never read as HTML."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import requests

from scaling_service.client import Client
from scaling_service.files.trc import write_trc
from scaling_service.model.trial import Trial
from tests.service.page.conftest import Visit
from tests.service.page.node import WEB
from tests.service.page.walker import put_walker

LABELS = (
    "<img src=x onerror=window.hacked=1>",
    '"><script>window.hacked=1</script>',
    "<svg/onload=window.hacked=1>",
    "{a|b}${window.hacked=1}",
    "javascript:window.hacked=1",
    "__proto__",
    "=HYPERLINK(1)",
)


def test_names_are_not_html(visit: Visit, url: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    markers = rng.normal(size=(50, len(LABELS), 3))
    markers[10:20, 0] = np.nan
    write_trc(
        tmp_path / "walk.trc",
        Trial(name="walk", times=np.arange(50) / 100, labels=LABELS, markers=markers, rate_hz=100.0),
    )
    visitor = visit(url)
    visitor.go()
    visitor.drops(tmp_path / "walk.trc")
    visitor.press("Check them")
    visitor.press("3 Laboratory")
    visitor.sees("Gaps in walk")
    shown = visitor.page.locator(".timeline .row button").all_inner_texts()
    assert sorted(shown) == sorted(LABELS)
    assert visitor.page.evaluate("() => window.hacked") is None
    assert visitor.page.locator("main img, main script, main svg[onload]").count() == 0
    visitor.press("2 Markers")
    visitor.page.get_by_text("Further labels (", exact=False).click()
    table = visitor.downloads("Save as CSV: Further labels").read_text(encoding="utf-8")
    assert "'=HYPERLINK(1)" in table  # a spreadsheet must not run it


def test_names_in_results_are_not_html(visit: Visit, url: str, example: Path, tmp_path: Path) -> None:
    """A label becomes the name of a tracking marker, and goes through figures, tables and saved drawings."""
    hostile = "<mark>RTHI&lt;"  # OpenSim takes no spaces and slashes in names
    with Client(url) as client:
        walker = put_walker(client, "hostile", example / "lab", tmp_path, hostile)
        job = client.wait(client.ask("comparisons", subject=walker, methods=["MB"]))
    visitor = visit(url)
    visitor.go(f"jobs/{job.id}/errors")
    visitor.sees("MB in gait_1: mean distance of each marker")
    drawing = visitor.saves("SVG", "MB in gait_1: mean distance of each marker")
    texts = {text.text for text in ElementTree.parse(drawing).iter("{http://www.w3.org/2000/svg}text")}
    assert any((text or "").startswith("<mark>RTHI&") for text in texts)
    assert hostile in visitor.page.locator("tbody th").all_inner_texts()
    visitor.page.locator("figure .plot").hover(position={"x": 200, "y": 30})
    visitor.follow("In space")
    visitor.page.locator(".cursor").wait_for(state="attached")
    visitor.page.locator("figure .plot").hover(position={"x": 200, "y": 240})
    assert visitor.page.locator("mark").count() == 0


def test_the_policy_allows_only_own_scripts(url: str) -> None:
    answer = requests.get(url, timeout=30)
    policy = dict(part.strip().split(" ", 1) for part in answer.headers["Content-Security-Policy"].split(";"))
    assert policy["default-src"] == "'none'"
    assert policy["script-src"] == "'self'"
    assert "unsafe" not in answer.headers["Content-Security-Policy"]


def test_the_sources_never_write_html() -> None:
    ways = (
        "innerHTML",
        "outerHTML",
        "insertAdjacentHTML",
        "document.write",
        "eval(",
        "new Function",
        "DOMParser",
    )
    found = {
        (file.name, way)
        for file in (WEB / "src").rglob("*.ts")
        for way in ways
        if way in file.read_text(encoding="utf-8")
    }
    assert found == set()
