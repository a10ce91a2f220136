"""A cohort: a folder is dropped, its members are compared, tables sort and filter."""

from __future__ import annotations

import json
from pathlib import Path

from scaling_service.files.trc import read_trc, write_trc
from tests.service.page.conftest import Visit
from tests.service.page.walker import FILES


def cohort_folder(lab: Path, folder: Path) -> Path:
    """Two persons with a subject file each, one larger than the other, and a table that adds a group."""
    for number, size in enumerate((1.0, 1.05), start=1):
        place = folder / f"P{number}"
        place.mkdir(parents=True)
        for name in FILES:
            trial = read_trc(lab / name)
            write_trc(place / name, trial.with_markers(size * trial.markers))
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


def test_a_folder_becomes_a_cohort(visit: Visit, url: str, example: Path, tmp_path: Path) -> None:
    folder = cohort_folder(example / "lab", tmp_path / "cohort")
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
    visitor.follow("All on one page")
    visitor.sees("Kinematic error: differences of pairs of methods")
    tables = page.get_by_role("region").evaluate_all("all => all.map((one) => one.ariaLabel)")
    assert len(set(tables)) == len(tables)  # each is found by its name
    visitor.follow("Take away")
    visitor.sees("Everything as one zip")
    names = page.locator("tbody th").all_inner_texts()
    assert {"cohort.json", "errors.csv", "report.html"} <= set(names)
