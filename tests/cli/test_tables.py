"""The option `--tables`: the same numbers as in the files that OpenSim reads."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from pydantic import ValidationError

from scaling_service.cli import main
from scaling_service.cli.app import EXIT_INPUT
from scaling_service.files.sto import read_sto
from scaling_service.service.jobs.kinds import KINDS
from tests.safety.running import unpack_subject


def test_tables_of_a_motion_hold_what_its_files_hold(folder: Path) -> None:
    import pandas  # half a second in every process that collects

    pytest.importorskip("pyarrow")
    given = ["ik", "lower_limb_14dof", str(folder / "walk.trc"), "--tables", "csv,parquet,bids"]
    assert main([*given, "--out", str(folder / "out")]) == 0
    motion, spread = (read_sto(folder / f"out/walk_ik{kind}.mot") for kind in ("", "_sd"))
    tables = folder / "out" / "tables"
    for frame in (
        pandas.read_csv(tables / "motion_walk.csv"),
        pandas.read_parquet(tables / "motion_walk.parquet"),
    ):
        np.testing.assert_allclose(frame["knee_angle_r_deg"], motion.column("knee_angle_r"), atol=1e-8)
        np.testing.assert_allclose(frame["knee_angle_r_sd_deg"], spread.column("knee_angle_r"), atol=1e-8)
        np.testing.assert_allclose(frame["pelvis_tx_m"], motion.column("pelvis_tx"), atol=1e-9)
    said = json.loads((tables / "motion_walk.json").read_text(encoding="utf-8"))
    assert said["columns"]["pelvis_tx_m"]["unit"] == "m"
    assert any(name.endswith("walk.trc") for name in said["source"]["input_hashes"])
    assert len(list((tables / "bids").rglob("*_motion.tsv"))) == 1


def test_tables_of_a_scaling(folder: Path) -> None:
    import pandas  # half a second in every process that collects

    given = ["scale", str(folder / "S01.yaml"), "--method", "MB", "--tables", "csv"]
    assert main([*given, "--out", str(folder / "out")]) == 0
    scaled = json.loads((folder / "out/MB/scaling.json").read_text(encoding="utf-8"))
    lengths = pandas.read_csv(folder / "out/tables/lengths.csv").set_index("segment")["length_mm"]
    for segment, value in scaled["segment_lengths_mm"].items():
        assert lengths[segment] == pytest.approx(value, abs=1e-3)
    assert any((folder / "out/tables").glob("motion_MB_*.csv"))


def test_an_unknown_form_is_refused_before_computing(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["ik", "lower_limb_14dof", str(folder / "walk.trc"), "--tables", "xlsx"]
    assert main([*given, "--out", str(folder / "out")]) == EXIT_INPUT
    assert "there are no tables as 'xlsx'" in capsys.readouterr().err
    assert not (folder / "out").exists()


def test_tables_of_loads_are_those_of_their_file(tmp_path: Path) -> None:
    import pandas  # half a second in every process that collects

    unpack_subject("forces", tmp_path)
    given = ["dynamics", str(tmp_path / "S01.yaml"), "--start", "none", "--no-report"]
    assert main([*given, "--tables", "csv", "--out", str(tmp_path / "out")]) == 0
    forces = read_sto(tmp_path / "out/sway_id.sto")
    frame = pandas.read_csv(tmp_path / "out/tables/loads_sway.csv")
    for column, name in (("residual_fy_N", "residual_fy"), ("knee_angle_r_moment_Nm", "knee_angle_r_moment")):
        np.testing.assert_allclose(frame[column], forces.column(name), atol=1e-6)
    said = json.loads((tmp_path / "out/tables/residuals.json").read_text(encoding="utf-8"))
    assert said["columns"]["mz_Nm"]["unit"] == "N m"


@pytest.mark.parametrize(
    ("kind", "asked", "wanted"),
    [
        ("motion", {"recordings": ["walk.trc"]}, "motion_walk.csv"),
        ("linear-scaling", {"method": "MB"}, "lengths.csv"),
    ],
)
def test_jobs_write_the_tables_of_their_commands(
    folder: Path, tmp_path: Path, kind: str, asked: dict[str, object], wanted: str
) -> None:
    inputs = tmp_path / "work" / "inputs" / "S01"
    shutil.copytree(folder, inputs)
    document = yaml.safe_load((folder / "S01.yaml").read_text(encoding="utf-8"))
    (inputs / "subject.json").write_text(json.dumps(document), encoding="utf-8")
    (tmp_path / "work" / "outputs").mkdir()
    request = {"subject": "S01", **asked}
    KINDS[kind].perform({**request, "tables": ["csv", "bids"]}, tmp_path / "work", lambda *_: None)
    tables = tmp_path / "work" / "outputs" / "tables"
    assert (tables / wanted).is_file()
    assert list((tables / "bids").rglob("*_motion.tsv"))
    with pytest.raises(ValidationError, match="tables"):
        KINDS[kind].request.model_validate_json(json.dumps({**request, "tables": ["xlsx"]}))
