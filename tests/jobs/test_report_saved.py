"""The report and the bones on disk: written with the results, gone with them, left out when asked."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from scaling_service.capabilities.scaling import saving
from scaling_service.capabilities.scaling.result import Results
from scaling_service.capabilities.scaling.run import compare
from scaling_service.capabilities.scaling.saving import save
from scaling_service.cli import main
from tests.jobs.conftest import UNSMOOTHED
from tests.jobs.reported import MOST_BYTES
from tests.report.reading import held, read


@pytest.fixture
def no_osim(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(saving, "render_scaled", lambda found, _: ["<model/>"] * len(found))


@pytest.mark.usefixtures("no_osim")
def test_saving_writes_what_the_report_says(results: Results, tmp_path: Path) -> None:
    save(results, tmp_path)
    written = json.loads((tmp_path / "comparison.json").read_text(encoding="utf-8"))
    root = read((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert written["verdict"]["headline"] in root.all("div", "callout")[0].text
    assert "S01" in root.all("h1")[0].text


@pytest.mark.usefixtures("no_osim")
def test_a_report_of_other_numbers_does_not_stay(results: Results, tmp_path: Path) -> None:
    save(results, tmp_path)
    save(results, tmp_path, report=False)
    assert not (tmp_path / "report.html").exists()
    assert (tmp_path / "comparison.json").exists()


@pytest.mark.usefixtures("no_osim")
def test_bones_of_an_earlier_run_do_not_stay(results: Results, tmp_path: Path) -> None:
    (tmp_path / "MB" / "bones").mkdir(parents=True)
    for name in ("bones/femur_r.stl", "bones.glb", "notes.glb"):
        (tmp_path / "MB" / name).write_text("old", encoding="utf-8")
    save(results, tmp_path, report=False)
    assert not (tmp_path / "MB" / "bones" / "femur_r.stl").exists()
    assert not (tmp_path / "MB" / "bones.glb").exists()
    assert (tmp_path / "MB" / "notes.glb").exists()


@pytest.mark.usefixtures("no_osim")
def test_the_option_leaves_the_report_out(subject_file: Path, tmp_path: Path) -> None:
    assert main(["compare", str(subject_file), "--methods", "MB", "--no-report", "--out", str(tmp_path)]) == 0
    assert {p.name for p in tmp_path.iterdir()} == {"MB", "comparison.json"}


def test_a_real_person_with_bones(shared_data: Path, tmp_path: Path) -> None:
    """The whole way on a real recording: bones beside the model, a report that reads and stays small."""
    folder = shared_data / "jia_mri"
    content = {
        "subject": {"id": "walker", "height_m": 1.62, "mass_kg": 63.0},
        "model": "lower_limb_14dof",
        "trials": {
            "static": str(folder / "Static.c3d"),
            "calibration": [str(folder / "Walking02.c3d")],
            "evaluation": [str(folder / "Walking01.c3d")],
        },
        "bones": {"units": "mm"}
        | {
            name: str(folder / "bones" / f"{name}{'_no_sacrum' if name == 'pelvis' else ''}.stl")
            for name in ("pelvis", "femur_r", "tibia_r")
        },
        "image_markers": str(folder / "image_markers.csv"),
    }
    file = tmp_path / "walker.json"
    file.write_text(json.dumps(content), encoding="utf-8")
    results = compare(file, ["EB"], UNSMOOTHED)
    save(results, tmp_path / "out")
    html = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert len(html.encode()) < MOST_BYTES
    inside = held(read(html))
    assert {"scene/scene.json", "scene/EB.glb"} <= set(inside["files"])
    written = json.loads((tmp_path / "out" / "EB" / "scaling.json").read_text(encoding="utf-8"))
    assert {"bones.glb", "bones/femur_r.stl", "bones/pelvis.stl", "bones/tibia_r.stl"} <= set(
        written["files"]
    )
