"""Tables of results as other programs read them: pandas, pyarrow, and the rules of Motion-BIDS."""

from __future__ import annotations

import csv
import json
import re
import subprocess
import sysconfig
from pathlib import Path

import pytest

from scaling_service.core.errors import DependencyMissing, InputError
from scaling_service.core.tables import MotionTable, ResultTable
from scaling_service.files import result_tables
from scaling_service.files.result_tables import check_forms, save_tables

LENGTHS = ResultTable(
    "Segment lengths", ("method", "segment", "length_mm"), (("MB", "femur_r", 419.9), ("MB", "shank_r", None))
)
WALK = MotionTable(
    "walk",
    ("time_s", "knee_angle_r_deg", "knee_angle_r_sd_deg", "pelvis_tx_m"),
    ((0.0, 5.0, 1.5, 0.1), (0.02, float("nan"), float("inf"), 0.2), (0.04, 7.0, 1.5, 0.3)),
    trial="Walking 01",
    system="MB_am",
)
ABOUT = {"subject": "S_01", "code_version": "1.2.3", "seed": 0}

CHANNEL_TYPES = {
    *("ACCEL", "ANGACCEL", "GYRO", "JNTANG", "LATENCY", "MAGN", "MISC", "ORNT", "POS", "VEL"),
}
COMPONENTS = {"x", "y", "z", "quat_x", "quat_y", "quat_z", "quat_w", "n/a"}
REQUIRED = ["name", "component", "type", "tracked_point", "units"]
"""Of channels.tsv, in this order. All three: the specification of BIDS, modality Motion."""


def test_csv_and_what_stands_beside(tmp_path: Path) -> None:
    import pandas  # half a second in every process that collects

    save_tables({"lengths": LENGTHS}, tmp_path, ["csv"], ABOUT)
    frame = pandas.read_csv(tmp_path / "lengths.csv")
    assert list(frame.columns) == list(LENGTHS.columns)
    assert frame["length_mm"][0] == 419.9
    assert frame["length_mm"].isna().tolist() == [False, True]
    said = json.loads((tmp_path / "lengths.json").read_text(encoding="utf-8"))
    assert said["columns"]["length_mm"] == {"unit": "mm"}
    assert said["columns"]["method"] == {"unit": None}
    assert said["source"] == ABOUT


def test_parquet_holds_units_and_source(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    save_tables({"lengths": LENGTHS, "walk": WALK}, tmp_path, ["parquet"], ABOUT)
    lengths, walk = (parquet.read_table(tmp_path / f"{name}.parquet") for name in ("lengths", "walk"))
    assert lengths.column("length_mm").to_pylist() == [419.9, None]
    assert lengths.schema.field("length_mm").metadata == {b"unit": b"mm"}
    assert lengths.schema.field("segment").metadata is None
    assert json.loads(lengths.schema.metadata[b"source"]) == ABOUT
    assert lengths.schema.metadata[b"title"] == b"Segment lengths"
    assert walk.schema.field("knee_angle_r_sd_deg").metadata == {b"unit": b"deg"}
    assert walk.column("pelvis_tx_m").to_pylist() == [0.1, 0.2, 0.3]
    assert str(walk.schema.field("knee_angle_r_deg").type) == "double"


def test_a_table_without_rows_is_one(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    save_tables({"effects": ResultTable("None", ("kind", "value"), ())}, tmp_path, ["csv", "parquet"], ABOUT)
    assert parquet.read_table(tmp_path / "effects.parquet").num_rows == 0
    assert (tmp_path / "effects.csv").read_text(encoding="utf-8") == "kind,value\n"


def test_motions_follow_motion_bids(tmp_path: Path) -> None:
    save_tables({"lengths": LENGTHS, "walk": WALK}, tmp_path, ["bids"], ABOUT)
    root = tmp_path / "bids"
    files = sorted(path.relative_to(root).as_posix() for path in root.rglob("*") if path.is_file())
    stem = "sub-S01/motion/sub-S01_task-Walking01_tracksys-MBam"
    assert [name for name in files if "/" in name] == [
        f"{stem}_channels.tsv",
        f"{stem}_motion.json",
        f"{stem}_motion.tsv",
    ]
    assert all(re.fullmatch(r"[A-Za-z0-9._-]+", Path(name).name) for name in files)
    description = json.loads((root / "dataset_description.json").read_text(encoding="utf-8"))
    assert {"Name", "BIDSVersion"} <= set(description)
    with (root / f"{stem}_channels.tsv").open(encoding="utf-8", newline="") as stream:
        head, *channels = csv.reader(stream, delimiter="\t")
    assert head == REQUIRED
    assert {row[2] for row in channels} <= CHANNEL_TYPES
    assert {row[1] for row in channels} <= COMPONENTS
    assert [row[2] for row in channels] == ["JNTANG", "MISC", "POS"]
    assert channels[2] == ["pelvis_tx", "x", "POS", "pelvis_tx", "m"]
    with (root / f"{stem}_motion.tsv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.reader(stream, delimiter="\t"))
    assert rows == [["5", "1.5", "0.1"], ["n/a", "n/a", "0.2"], ["7", "1.5", "0.3"]]
    sidecar = json.loads((root / f"{stem}_motion.json").read_text(encoding="utf-8"))
    assert sidecar["SamplingFrequency"] == 50.0
    assert sidecar["TaskName"] == "Walking 01"
    assert sidecar["MotionChannelCount"] == len(channels)


def test_forms_are_checked_before_anything(monkeypatch: pytest.MonkeyPatch) -> None:
    assert check_forms("") == ()
    assert check_forms("csv, bids,csv") == ("csv", "bids")
    with pytest.raises(InputError, match="no tables as 'excel'"):
        check_forms("csv,excel")
    monkeypatch.setattr(result_tables, "find_spec", lambda _name: None)
    with pytest.raises(DependencyMissing, match="pyarrow"):
        check_forms("parquet")


def validate(folder: Path) -> list[dict[str, str]]:
    """What BIDS' own validator says of a dataset."""
    command = Path(sysconfig.get_path("scripts"), "bids-validator-deno")
    if not command.exists():
        pytest.skip("BIDS' validator is not installed")
    said = subprocess.run([command, "--json", folder], capture_output=True, text=True, check=False)
    issues: list[dict[str, str]] = json.loads(said.stdout)["issues"]["issues"]
    return issues


def test_bids_own_validator_has_no_objection(tmp_path: Path) -> None:
    save_tables({"walk": WALK}, tmp_path, ["bids"], ABOUT)
    assert not [issue for issue in validate(tmp_path / "bids") if issue["severity"] == "error"]
    (sidecar,) = tmp_path.rglob("*_motion.json")
    sidecar.unlink()
    assert [issue for issue in validate(tmp_path / "bids") if issue["severity"] == "error"]
