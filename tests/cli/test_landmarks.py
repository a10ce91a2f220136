from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from scaling_service.capabilities.landmarks.result import LandmarksDocument
from scaling_service.cli import main
from tests.bones import bones


@pytest.fixture(scope="module")
def leg(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("leg")
    for name, mesh in (("femur", bones.femur()), ("tibia", bones.tibia()), ("talus", bones.talus())):
        trimesh.Trimesh(*mesh, process=False).export(folder / f"{name}.stl")
        trimesh.Trimesh(*bones.metres(mesh), process=False).export(folder / f"{name}_m.ply")
    return folder


def run(*arguments: object) -> int:
    return main([str(a) for a in ("landmarks", *arguments)])


def test_a_leg(leg: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    args = ["--femur_r", leg / "femur.stl", "--tibia_r", leg / "tibia.stl", "--talus_r", leg / "talus.stl"]
    assert run("--units", "mm", *args, "--out", tmp_path / "out") == 0
    content = json.loads((tmp_path / "out" / "landmarks.json").read_text())
    LandmarksDocument.model_validate(content)
    femur = content["femur_r"]
    assert femur["side"] == "r"
    assert femur["hip_centre_mm"] == pytest.approx(bones.HIP_CENTRE, abs=0.05)
    assert femur["head_radius_mm"] == pytest.approx(24.0, abs=0.05)
    assert np.linalg.norm(femur["knee_axis"]) == pytest.approx(1.0)
    assert femur["knee_axes_apart_deg"] < 3.0
    assert 0.0 < femur["fit_rms_mm"] < 1.0
    assert content["tibia_r"]["ankle_centre_from"] == "talus"
    assert set(content["input_hashes"]) == {"femur.stl", "tibia.stl", "talus.stl"}
    assert "femur_l" not in content
    assert content["settings"] == {"units": "mm", "units_from": "given"}
    assert "hip centre" in capsys.readouterr().out


def test_metres_are_detected(leg: Path, tmp_path: Path) -> None:
    assert run("--femur_r", leg / "femur_m.ply", "--out", tmp_path) == 0
    content = json.loads((tmp_path / "landmarks.json").read_text())
    assert content["settings"] == {"units": "m", "units_from": "size"}
    assert content["femur_r"]["hip_centre_mm"] == pytest.approx(bones.HIP_CENTRE, abs=0.05)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "no bone is given"),
        (["--femur_l", "femur.stl"], "right femur, but is given as a left"),
        (["--units", "m", "--femur_r", "femur.stl"], "Check the unit"),
        (["--femur_r", "femur.stl", "--tibia_r", "tibia_m.ply"], "in no unit"),
        (["--tibia_r", "none.stl"], "no such file"),
        (["--units", "inch", "--femur_r", "femur.stl"], "inch"),
    ],
)
def test_what_cannot_be_used_is_said(
    leg: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], said: str
) -> None:
    paths = [leg / a if a.endswith((".stl", ".ply")) else a for a in arguments]
    assert run(*paths, "--out", tmp_path / "out") == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "out" / "landmarks.json").exists()
