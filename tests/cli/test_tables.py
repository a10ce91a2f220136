"""The option `--tables`: the same numbers as in the files that OpenSim reads."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas
import pytest

from scaling_service.cli import main
from scaling_service.cli.app import EXIT_INPUT
from scaling_service.files.sto import read_sto


def test_tables_of_a_motion_hold_what_its_files_hold(folder: Path) -> None:
    pytest.importorskip("pyarrow")
    given = ["ik", "lower_limb_14dof", str(folder / "walk.trc"), "--tables", "csv,parquet,bids"]
    assert main([*given, "--out", str(folder / "out")]) == 0
    motion, spread = (read_sto(folder / f"out/walk_ik{kind}.mot") for kind in ("", "_sd"))
    tables = folder / "out" / "tables"
    for frame in (pandas.read_csv(tables / "walk.csv"), pandas.read_parquet(tables / "walk.parquet")):
        np.testing.assert_allclose(frame["knee_angle_r_deg"], motion.column("knee_angle_r"), atol=1e-8)
        np.testing.assert_allclose(frame["knee_angle_r_sd_deg"], spread.column("knee_angle_r"), atol=1e-8)
        np.testing.assert_allclose(frame["pelvis_tx_m"], motion.column("pelvis_tx"), atol=1e-9)
    said = json.loads((tables / "walk.json").read_text(encoding="utf-8"))
    assert said["columns"]["pelvis_tx_m"]["unit"] == "m"
    assert any(name.endswith("walk.trc") for name in said["source"]["input_hashes"])
    assert len(list((tables / "bids").rglob("*_motion.tsv"))) == 1


def test_tables_of_a_scaling(folder: Path) -> None:
    given = ["scale", str(folder / "S01.yaml"), "--method", "MB", "--tables", "csv"]
    assert main([*given, "--out", str(folder / "out")]) == 0
    scaled = json.loads((folder / "out/MB/scaling.json").read_text(encoding="utf-8"))
    lengths = pandas.read_csv(folder / "out/tables/lengths.csv").set_index("segment")["length_mm"]
    for segment, value in scaled["segment_lengths_mm"].items():
        assert lengths[segment] == pytest.approx(value, abs=1e-3)
    assert any((folder / "out/tables").glob("MB_*.csv"))


def test_an_unknown_form_is_refused_before_computing(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["ik", "lower_limb_14dof", str(folder / "walk.trc"), "--tables", "xlsx"]
    assert main([*given, "--out", str(folder / "out")]) == EXIT_INPUT
    assert "there are no tables as 'xlsx'" in capsys.readouterr().err
    assert not (folder / "out").exists()
