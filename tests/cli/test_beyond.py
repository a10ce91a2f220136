"""Options that go beyond the paper: they reach the results, and what cannot be done is told."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from scaling_service.capabilities.scaling import saving
from scaling_service.capabilities.shared.settings import CalibrationSettings, Settings
from scaling_service.cli import main
from tests.jobs.laboratory import laboratory


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Writing .osim files takes a second each, and is tested elsewhere."""
    monkeypatch.setattr(saving, "render_scaled", lambda found, _: ["<model/>"] * len(found))


@pytest.fixture(scope="module")
def subject_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return laboratory(tmp_path_factory.mktemp("laboratory"))


def test_options_stand_in_the_resolved_settings(subject_file: Path, tmp_path: Path) -> None:
    chosen = ["--scaling", "per-axis", "--knee", "universal", "--method", "MB"]
    assert main(["scale", str(subject_file), "--out", str(tmp_path), *chosen]) == 0
    written = json.loads((tmp_path / "MB" / "scaling.json").read_text(encoding="utf-8"))
    calibration = written["settings"]["calibration"]
    assert calibration["scaling"] == "per-axis"
    assert calibration["knee"] == "universal"
    assert calibration["hip_centre"] == "regression"
    assert len(set(written["scale_factors"]["pelvis"])) == 3


def test_the_paper_is_the_default() -> None:
    plain = Settings().resolved()["calibration"]
    assert (plain["hip_centre"], plain["knee_axis"]) == ("regression", "epicondyles")
    assert (plain["scaling"], plain["knee"]) == ("uniform", "hinge")
    assert Settings().calibration == CalibrationSettings()


@pytest.mark.parametrize("option", ["--hip-centre", "--knee-axis"])
def test_a_movement_without_thigh_markers_is_refused_with_the_reason(
    subject_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], option: str
) -> None:
    out = tmp_path / "out"
    assert main(["compare", str(subject_file), "--out", str(out), option, "functional"]) == 2
    reported = capsys.readouterr().err
    assert "right femur carries 2 markers" in reported
    assert "extra_markers" in reported
    assert not out.exists()


def test_an_unknown_choice_names_the_known_ones(
    subject_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["compare", str(subject_file), "--out", str(tmp_path), "--knee", "magnetic"]) == 2
    reported = capsys.readouterr().err
    assert all(name in reported for name in ("hinge", "universal", "spherical"))
