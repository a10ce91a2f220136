"""A cohort: a folder is dropped, its members are compared, tables sort and filter."""

from __future__ import annotations

import json
from pathlib import Path

import requests

from scaling_service.client import Client
from tests.service.page.conftest import Visit
from tests.service.page.walker import fetch


def cohort_folder(url: str, folder: Path) -> Path:
    """Two persons with a subject file each, and a table that adds a group."""
    requests.post(f"{url}/v1/examples?persons=2", timeout=30).raise_for_status()
    for number, example in enumerate(("example", "example_2"), start=1):
        place = folder / f"P{number}"
        with Client(url) as client:
            fetch(client, place, example)
        document = {
            "subject": {"id": f"P{number}", "height_m": 1.7, "mass_kg": 60.0},
            "model": "lower_limb_14dof",
            "trials": {"static": "static.trc", "evaluation": ["gait_1.trc"]},
        }
        (place / "subject.yaml").write_text(json.dumps(document), encoding="utf-8")  # JSON is YAML
    (folder / "cohort.csv").write_text(
        "subject,shoes\nP1/subject.yaml,on\nP2/subject.yaml,off\n", encoding="utf-8"
    )
    return folder


def test_a_folder_becomes_a_cohort(visit: Visit, url: str, tmp_path: Path) -> None:
    folder = cohort_folder(url, tmp_path / "cohort")
    visitor = visit(url)
    page = visitor.page
    visitor.go()
    page.get_by_label("Choose a folder").set_input_files(str(folder))
    visitor.sees("2 subjects brought in.")
    for method in ("MB_lam", "MB_am", "EB", "EB_am", "MAP"):
        page.get_by_role("checkbox", name=method, exact=True).uncheck()
    visitor.press("Compare the cohort")
    visitor.sees("How every subject ended")
    heads = page.locator("tbody th")
    assert heads.all_inner_texts() == ["P1", "P2"]
    page.get_by_role("columnheader", name="shoes").get_by_role("button").click()
    assert heads.all_inner_texts() == ["P2", "P1"]
    page.get_by_label("Filter: How every subject ended").fill("on")
    assert "P1" in heads.all_inner_texts()
    visitor.follow("P1")
    visitor.sees("How far to trust")
    visitor.follow("Sizes")
    visitor.sees("Segment lengths, mm")
    visitor.follow("All subjects")
    visitor.sees("How every subject ended")
    visitor.follow("Errors")
    visitor.sees("Kinematic error, held out")
    visitor.follow("Take away")
    visitor.sees("Everything as one zip")
    names = page.locator("tbody th").all_inner_texts()
    assert {"cohort.json", "errors.csv", "report.html"} <= set(names)
