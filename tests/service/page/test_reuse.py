"""A model that a job made follows recordings again: one button beside its files."""

from __future__ import annotations

from pathlib import Path

from scaling_service.client import Client
from tests.jobs.laboratory import document, laboratory
from tests.service.page.conftest import Visit
from tests.service.page.visitor import LONG_MS


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
