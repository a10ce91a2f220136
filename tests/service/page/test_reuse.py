"""A model that a job made follows recordings again: one button beside its files."""

from __future__ import annotations

from pathlib import Path

import pytest

from scaling_service.client import Client
from tests.jobs.laboratory import document, laboratory
from tests.service.page.conftest import Visit
from tests.service.page.visitor import LONG_MS


@pytest.mark.costly  # what such a job gives is asked in test_motion_kind.py
def test_a_model_follows_a_new_recording(visit: Visit, url: str, tmp_path: Path) -> None:
    laboratory(tmp_path, **document(subject={"id": "again"}))
    with Client(url) as client:
        client.put_subject_file(tmp_path / "S01.yaml")
        job = client.wait(client.ask("scalings/linear", subject="again", method="MB"))
        error = client.result(job)["kinematic_error_mm"]["walk"]["mean"]
    (tmp_path / "another.trc").write_bytes((tmp_path / "walk.trc").read_bytes())
    visitor = visit(url)
    visitor.go(f"jobs/{job.id}/files")
    picker = visitor.page.get_by_label("recordings")
    picker.set_input_files([str(tmp_path / "walk.trc")])
    visitor.press("Follow")
    visitor.sees("The subject has a file of this name already.")
    picker.set_input_files([str(tmp_path / "another.trc")])
    visitor.press("Follow")
    row = visitor.page.get_by_role("row").filter(has_text="another")
    row.wait_for(timeout=LONG_MS)
    assert f"{error:.1f}" in row.inner_text()
    visitor.sees("Motion with a model used again: again")


def test_the_advised_model_stands_first(visit: Visit, url: str, tmp_path: Path) -> None:
    laboratory(tmp_path, **document(subject={"id": "advised"}))
    with Client(url) as client:
        client.put_subject_file(tmp_path / "S01.yaml")
        job = client.wait(client.ask("comparisons", subject="advised", methods=["MB_lam", "MB"]))
        verdict = client.result(job)["verdict"]
    assert verdict["method"] == "MB_lam"  # and MB stands before it among the files
    visitor = visit(url)
    visitor.go(f"jobs/{job.id}/files")
    offered = visitor.page.get_by_label("model", exact=True)
    offered.wait_for()
    assert offered.input_value() == "MB_lam/model.json"
    assert offered.get_by_role("option").all_inner_texts() == ["MB_lam/model.json", "MB/model.json"]
    visitor.sees(f"MB_lam/model.json stands first because the comparison says: “{verdict['headline']}”")


@pytest.mark.costly  # what is written when asked for is asked in tests/cli/test_tables.py
def test_tables_and_further_forms_are_asked_for(visit: Visit, url: str, tmp_path: Path) -> None:
    laboratory(tmp_path, **document(subject={"id": "written"}))
    with Client(url) as client:
        client.put_subject_file(tmp_path / "S01.yaml")
        visitor = visit(url)
        visitor.go("subjects/written/run")
        visitor.page.get_by_role("button", name="Compare", exact=True).wait_for(timeout=LONG_MS)
        for method in ("MB_lam", "MB_am", "MAP"):  # one method will do
            visitor.page.get_by_role("checkbox", name=f"{method} ").uncheck()
        visitor.page.get_by_text("Settings", exact=True).click()
        visitor.page.get_by_label("CSV, for spreadsheets").check()
        visitor.page.get_by_label("biorbd (bioMod)").check()
        visitor.press("Compare")
        visitor.sees("How far to trust")
        job = visitor.page.url.split("/jobs/")[1].split("/")[0]
        names = {file.name for file in client.files(job)}
    assert any(name.startswith("tables/") and name.endswith(".csv") for name in names)
    assert "MB/model.bioMod" in names
