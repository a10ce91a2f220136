"""The command ``dynamics``: what it writes, and what laboratories give it by mistake."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scaling_service.cli import main
from scaling_service.files.sto import read_sto
from scaling_service.files.trc import read_trc, write_trc
from scaling_service.virtual.plates import write_forces
from tests.files.c3d_writing import write_c3d
from tests.jobs.force_laboratory import document, force_laboratory, write_subject

Spoil = Callable[[Path], None]
NAMES = ("sway", "swing")


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("forces")
    force_laboratory(folder)
    return folder


@pytest.fixture
def folder(sound: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(sound, tmp_path / "laboratory"))


def run(folder: Path, *more: str) -> int:
    file, out = str(folder / "S01.yaml"), str(folder / "out")
    return main(["dynamics", file, "--start", "none", "--out", out, *more])


def plates(folder: Path, name: str) -> tuple[np.ndarray, list[np.ndarray]]:
    table = read_sto(folder / f"{name}_grf.mot")
    return table.times, [
        table.data[:, 1 + 9 * k : 10 + 9 * k].copy() for k in range(table.data.shape[1] // 9)
    ]


def with_plates(change: Callable[[list[np.ndarray]], list[np.ndarray]], delay_s: float = 0.0) -> Spoil:
    """Both recordings' plates (n, 9: force, point, moment) changed."""

    def spoil(folder: Path) -> None:
        for name in NAMES:
            times, found = plates(folder, name)
            write_forces(folder / f"{name}_grf.mot", times + delay_s, tuple(change(found)))

    return spoil


def scaled(columns: slice, factor: float) -> Spoil:
    return with_plates(lambda found: [p * _factors(columns, factor) for p in found])


def _factors(columns: slice, factor: float) -> np.ndarray:
    factors = np.ones(9)
    factors[columns] = factor
    return factors


def subject(**changes: Any) -> Spoil:
    return lambda folder: write_subject(folder, document(**changes)) and None


def person(**changes: Any) -> Spoil:
    return subject(subject=document()["subject"] | changes)


def turned(folder: Path) -> None:
    """Markers with Z up, forces with Y up."""
    for name in NAMES:
        trial = read_trc(folder / f"{name}.trc")
        write_trc(
            folder / f"{name}.trc", trial.with_markers(trial.markers[..., [0, 2, 1]] * [1, -1, 1]), "mm"
        )


def without_toes(folder: Path) -> None:
    for name in NAMES:
        trial = read_trc(folder / f"{name}.trc")
        kept = [label for label in trial.labels if label not in ("RTOE", "RMT1", "RMT5")]
        write_trc(folder / f"{name}.trc", trial.select(kept), "mm")


def unsupported_plate(folder: Path) -> None:
    """A C3D file with a plate of type 5."""
    ezc3d = pytest.importorskip("ezc3d")
    write_c3d(folder / "sway.c3d", read_trc(folder / "sway.trc"))
    content = ezc3d.c3d(str(folder / "sway.c3d"))
    n = content["data"]["points"].shape[2]
    content["parameters"]["ANALOG"]["RATE"]["value"] = [100.0]
    content["parameters"]["ANALOG"]["LABELS"]["value"] = [f"F{k}" for k in range(6)]
    content["data"]["analogs"] = np.zeros((1, 6, n))
    for key, value in (("USED", [1]), ("TYPE", [5])):
        content.add_parameter("FORCE_PLATFORM", key, value)
    content.write(str(folder / "sway.c3d"))
    trials = {"calibration": ["sway.c3d"], "evaluation": ["swing.trc"]}
    write_subject(folder, document(trials=trials, forces={"swing.trc": "swing_grf.mot"}))


@dataclass(frozen=True)
class Mistake:
    """What is spoilt, the file that the message names, and what else it says."""

    spoil: Spoil
    file: str
    says: tuple[str, ...]
    options: tuple[str, ...] = ()


MISTAKES = {
    "no force data": Mistake(subject(forces={}), "S01.yaml", ("no movement has forces", "under `forces:`")),
    "a plate of type 5": Mistake(
        unsupported_plate, "sway.c3d", ("FORCE_PLATFORM:TYPE", "type 5", "MOT or STO")
    ),
    "clocks apart": Mistake(
        with_plates(lambda p: p, 100.0), "sway_grf.mot", ("time", "do not overlap", "same recording")
    ),
    "points in mm": Mistake(
        scaled(slice(3, 6), 1e3), "sway_grf.mot", ("point of application", "points in m")
    ),
    "moments in N mm": Mistake(scaled(slice(6, 9), 1e3), "sway_grf.mot", ("moment", "as no foot can", "N m")),
    "forces in kN": Mistake(
        scaled(slice(0, 3), 1e-3), "sway_grf.mot", ("no plate bears more than 0.", "forces in N")
    ),
    "a mass that the plates do not bear": Mistake(
        scaled(slice(0, 3), 0.5), "sway.trc", ("mass_kg", "the plates bear", "forces in N")
    ),
    "a mass of 0": Mistake(person(mass_kg=0.0), "S01.yaml", ("mass_kg", "0 kg", "kilograms")),
    "a mass of 1000 kg": Mistake(person(mass_kg=1000.0), "S01.yaml", ("mass_kg", "1000 kg", "kilograms")),
    "no stature": Mistake(person(height_m=None), "S01.yaml", ("subject.height_m", "stature in m")),
    "a foot on no plate": Mistake(
        with_plates(lambda p: p[:1]), "sway.trc", ("forces", "a plate is missing", "forces of all plates")
    ),
    "no load near a foot": Mistake(
        with_plates(lambda p: [q + np.array([0, 0, 0, 1.5, 0, 0, 0, 0, 0]) for q in p]),
        "sway_grf.mot",
        ("no load is near a foot", "one recording"),
    ),
    "a model without feet": Mistake(
        subject(model="lower_limb_14dof"), "S01.yaml", ("model", "has no feet", "full_body_35dof")
    ),
    "a model with one foot": Mistake(subject(model="squat_4dof"), "S01.yaml", ("model", "has one foot")),
    "a foot without markers": Mistake(without_toes, "sway.trc", ("calcn_r", "RHEE", "`extra_markers:`")),
    "axes that differ": Mistake(turned, "sway_grf.mot", ("Y up", "+z up", "same axes")),
    "no such start": Mistake(lambda _: None, "", ("no method 'MBB'", "MB_am"), ("--start", "MBB")),
    "no such table": Mistake(lambda _: None, "", ("no inertial table 'dumas'",), ("--inertia", "dumas")),
    "too high a cutoff": Mistake(
        lambda _: None, "sway_grf.mot", ("cutoff_hz", "80 Hz", "between 0 and 50"), ("--cutoff-hz", "80")
    ),
    "a table without a mass": Mistake(
        person(mass_kg=None), "S01.yaml", ("subject.mass_kg", "inertial tables"), ("--inertia", "dumas2007")
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_refused_with_file_field_and_remedy(
    name: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mistake = MISTAKES[name]
    mistake.spoil(folder)
    assert run(folder, *mistake.options) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1, said
    assert "Traceback" not in said
    for part in (str(folder / mistake.file) if mistake.file else "", *mistake.says):
        assert part in said, said
    assert not (folder / "out").exists()


def result(folder: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((folder / "out" / "dynamics.json").read_text())
    return content


def test_what_is_written_follows_the_contract(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(folder) == 0
    assert sorted(p.name for p in (folder / "out").iterdir() if p.suffix != ".html") == [
        "dynamics.json",
        "sway_id.sto",
        "swing_id.sto",
    ]
    found = result(folder)
    sway = found["trials"]["sway"]
    assert list(sway["residual_rms"]) == ["fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm"]
    for key in ("dr", "slopes_per_cm", "r2", "calibration_supported"):
        assert len(sway[key]) == 6
    assert {k: len(v) for k, v in sway["uncertainty"].items()} == {"kinematic": 6, "plate": 6, "total": 6}
    assert found["verdict"]
    assert (found["start"], found["inertia"]) == ("none", "model")
    # The person is the model: what is left is the marker noise of 0.5 mm, which the filter lets through.
    assert max(sway["residual_rms"].values()) < 5.0
    assert all(gate["passed"] for gate in sway["gates"])
    shown = capsys.readouterr().out
    for part in ("sway", "swing", "Hicks 2015: RMS force, N", "Verdict", "dynamics.json"):
        assert part in shown


def test_joint_forces_are_named_as_opensim_names_them(folder: Path) -> None:
    assert run(folder) == 0
    table = read_sto(folder / "out" / "sway_id.sto")
    assert {"hip_flexion_r_moment", "pelvis_tx_force", "residual_fx", "residual_mz"} <= set(table.columns)
    rms = np.sqrt(np.mean(table.column("residual_fy")[10:-10] ** 2))
    assert rms == pytest.approx(result(folder)["trials"]["sway"]["residual_rms"]["fy_N"], rel=1e-4)
    load = result(folder)["trials"]["sway"]["joint_loads"]["hip_flexion_r"]
    assert load["unit"] == "N m"
    peak = np.abs(table.column("hip_flexion_r_moment")[10:-10]).max()
    assert load["peak"] == pytest.approx(peak, rel=1e-4)


def test_a_foot_on_two_plates_is_reported_and_right(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(folder) == 0
    whole = result(folder)["trials"]["sway"]["residual_rms"]
    half = _factors(slice(0, 3), 0.5) * _factors(slice(6, 9), 0.5)
    with_plates(lambda p: [p[0] * half, p[0] * half, p[1]])(folder)
    assert run(folder) == 0
    assert "right foot: stands on two plates at once; both loads count" in capsys.readouterr().out
    split = result(folder)["trials"]["sway"]["residual_rms"]
    assert split == pytest.approx(whole, rel=1e-6)


def test_two_feet_on_one_plate_are_reported(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def joined(found: list[np.ndarray]) -> list[np.ndarray]:
        right, left = found
        force = right[:, :3] + left[:, :3]
        share = right[:, 1:2] / force[:, 1:2]
        point = share * right[:, 3:6] + (1 - share) * left[:, 3:6]
        moment = sum(p[:, 6:] + np.cross(p[:, 3:6] - point, p[:, :3]) for p in found)
        return [np.column_stack([force, point, moment])]

    with_plates(joined)(folder)
    assert run(folder) in (0, 2)  # the other foot stands beside the plate: no frame may be left
    said = capsys.readouterr()
    assert "bears two feet at once" in said.out or "no frame has both" in said.err


def test_one_nan_frame_of_forces_costs_its_neighbourhood_only(folder: Path) -> None:
    assert run(folder) == 0
    before = result(folder)["trials"]["sway"]

    def blank(found: list[np.ndarray]) -> list[np.ndarray]:
        found[0][125, :3] = np.nan
        return found

    with_plates(blank)(folder)
    assert run(folder) == 0
    after = result(folder)["trials"]["sway"]
    # The frame, and half a period of the cutoff to both sides, where the filter now ends.
    assert 1 <= before["frames"] - after["frames"] <= 1 + 2 * 10
    assert max(after["residual_rms"].values()) < 5.0


def test_identification_obeys_the_verdict_unless_overruled(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(folder, "--identify") == 0
    assert "inertia was not identified" in capsys.readouterr().out
    assert result(folder)["inertial"] is None
    assert run(folder, "--identify", "--despite-verdict", "--free-mass") == 0
    found = result(folder)["inertial"]
    assert {name: fit["held_out"] for name, fit in found["trials"].items()} == {"sway": False, "swing": True}
    assert found["total_mass_kg"][1] == pytest.approx(found["total_mass_kg"][0], rel=0.01)
    assert "it was identified all the same" in found["warnings"][0]
