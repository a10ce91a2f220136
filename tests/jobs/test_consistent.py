"""The planar squat of a real recording: half of the classical errors, and what is written."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from scaling_service.cli import main

EXIT_INPUT = 2


@pytest.fixture(scope="module")
def squat(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = shared_data / "opencap_squat"
    document = {
        "subject": {"id": "squat", "height_m": 1.68, "mass_kg": 62.6, "sex": "M"},
        "model": "squat_4dof",
        "trials": {"calibration": [str(folder / "squats1.trc")]},
        "forces": {"squats1.trc": str(folder / "squats1_grf.mot")},
    }
    path = tmp_path_factory.mktemp("squat") / "squat.yaml"
    path.write_text(json.dumps(document))
    return path


def test_the_planar_squat_halves_the_wrench_error(squat: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = squat.parent / "out"
    assert main(["consistent", str(squat), "--out", str(out)]) == 0
    document = json.loads((out / "consistent.json").read_text())
    trial = document["trials"]["squats1"]
    classical, ours = (trial["ground_wrench_rmse"][way] for way in ("classical", "consistent"))
    for name in ("fx_N", "fy_N", "mz_Nm"):
        assert ours[name] <= 0.5 * classical[name]
    assert trial["marker_rms_mm"]["consistent"] <= 17.0
    assert trial["held_out"] is False
    assert {"thigh", "shank"} & set(document["length_factors"])
    for name in ("squats1_ik.mot", "model.json", "report.html"):
        assert (out / name).stat().st_size > 0
    assert "What to beware of" in (out / "report.html").read_text(encoding="utf-8")
    assert "used to fit" in capsys.readouterr().out


def test_a_scaling_method_is_refused_for_it(squat: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["consistent", str(squat), "--start", "MB", "--out", str(squat.parent / "no")]) == EXIT_INPUT
    assert "scaled by the standing" in capsys.readouterr().err


def test_a_squat_without_forces_is_refused(
    squat: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    document = json.loads(squat.read_text())
    del document["forces"]
    path = tmp_path / "squat.yaml"
    path.write_text(json.dumps(document))
    assert main(["consistent", str(path), "--out", str(tmp_path / "out")]) == EXIT_INPUT
    assert "no movement has forces" in capsys.readouterr().err
