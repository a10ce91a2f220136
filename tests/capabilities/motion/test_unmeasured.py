"""Chair, box, missing plate and flight, from the vertical momentum balance, the feet and the pelvis."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from scaling_service.capabilities.dynamics.result import DynamicsResults
from scaling_service.capabilities.dynamics.run import dynamics
from scaling_service.capabilities.dynamics.saving import save_dynamics
from scaling_service.capabilities.dynamics.settings import DynamicsSettings
from scaling_service.capabilities.dynamics.unmeasured import (
    Unmeasured,
    find_unmeasured,
    find_unmeasured_frames,
)
from scaling_service.capabilities.kinetics.inverse_dynamics import compute_dynamics, differentiate_motion
from scaling_service.core.arrays import Array
from scaling_service.core.errors import TrialUnusable
from scaling_service.files.sto import Table, read_sto, write_sto
from scaling_service.model.builtin import load_builtin
from scaling_service.model.compile import list_parameter_values, repeat_default_pose
from scaling_service.model.forces import SegmentLoads
from scaling_service.model.inertia import compile_mechanism
from scaling_service.numerics.wrench import GRAVITY, compute_root_wrench
from scaling_service.recording.plates_feet import NOBODY, FootContacts

MODEL = load_builtin("full_body_35dof")
TIMES = np.arange(200) / 100.0
FEET, BOTH = ("calcn_r", "calcn_l"), (True, True)
BENT = {"hip_flexion": 1.5, "knee_angle": 1.5}


def moved(**curves: Array | float) -> Array:
    """The default pose but for some coordinates, (n, n_coordinates)."""
    q = repeat_default_pose(MODEL, len(TIMES))
    for name, curve in curves.items():
        q[:, MODEL.coordinate_names.index(name)] += curve
    return q


def found_of(
    q: Array,
    share: Array,
    *,
    on_floor: tuple[bool, bool] = (True, True),
    bears: tuple[bool, bool] = (True, True),
) -> tuple[Unmeasured, ...]:
    """What is told of a motion (n, n_coordinates) of whose wrench the plates measure a share (n,)."""
    rated = differentiate_motion(MODEL, TIMES, q, cutoff_hz=None)
    wrench = (
        compute_root_wrench(compile_mechanism(MODEL), rated.rates, list_parameter_values(MODEL))[0].T
        * share[:, None]
    )
    loads = SegmentLoads(TIMES, FEET[:1], wrench[:, None, :3], wrench[:, None, 3:])
    foot = np.where(np.array([[0, 1]] * len(TIMES)) * 0 + np.array(bears), [0, 1], NOBODY)
    contacts = FootContacts(
        feet=FEET,
        foot=foot,
        on_floor=np.tile(on_floor, (len(TIMES), 1)),
        over_edge=np.zeros((len(TIMES), 2), dtype=bool),
        supported=np.ones(len(TIMES), dtype=bool),
        repairs=(),
    )
    return find_unmeasured(compute_dynamics(MODEL, rated, loads), contacts, MODEL)


def test_what_plates_measure_whole_is_not_reported() -> None:
    assert found_of(moved(lumbar_extension=0.2 * np.sin(6.0 * TIMES)), np.ones(len(TIMES))) == ()


def test_a_declared_mass_that_is_ten_per_cent_off_is_no_chair() -> None:
    assert found_of(moved(), np.full(len(TIMES), 0.9)) == ()


def test_a_chair_is_reported_with_its_time_and_share() -> None:
    """For the first second somebody sits and the plates bear 40 %."""
    seated = np.where(TIMES < 1.0, 1.0, 0.0)
    bent = {f"{joint}_{side}": value * np.ones(len(TIMES)) for joint, value in BENT.items() for side in "rl"}
    (chair,) = found_of(moved(**bent), np.where(seated > 0.0, 0.4, 1.0))
    assert chair.kind == "chair"
    assert (chair.start_s, chair.end_s) == pytest.approx((0.0, 0.99), abs=0.02)
    assert chair.share == pytest.approx(0.6, abs=0.02)
    assert "as on a chair" in chair.sentence
    np.testing.assert_array_equal(find_unmeasured_frames([chair], TIMES), TIMES < 0.995)


def test_a_foot_without_a_plate_and_both_feet_on_a_box() -> None:
    share = np.where(TIMES < 1.0, 0.45, 1.0)
    (lost,) = found_of(moved(), share, bears=(True, False))
    assert (lost.kind, lost.foot) == ("missing_plate", "calcn_l")
    (box,) = found_of(moved(), share, on_floor=(False, False))
    assert box.kind == "step"
    (hand,) = found_of(moved(), share)
    assert hand.kind == "contact"


def test_flight_is_measured_and_reported() -> None:
    """A parabola of half a second between two rests: the motion needs nothing, as the plates say."""
    up = np.clip(TIMES - 0.7, 0.0, 0.5)
    height = up * (0.5 - up) * -GRAVITY[1] / 2.0
    found = found_of(moved(pelvis_ty=height), np.ones(len(TIMES)), on_floor=(False, False))
    flight = [one for one in found if one.kind == "flight"]
    assert len(flight) == 1
    assert (flight[0].start_s, flight[0].end_s) == pytest.approx((0.7, 1.2), abs=0.05)
    assert not find_unmeasured_frames(flight, TIMES).any()


# Real recordings with something taken away


def without(columns: tuple[str, ...], source: Path, target: Path, share: Any = 0.0) -> str:
    """A file of forces with only a share of some columns, as a number or a function of time; its path."""
    table = read_sto(source)
    data = table.data.copy()
    times = data[:, 0]
    for k, name in enumerate(table.columns):
        if name.startswith(columns) and "_p" not in name:
            data[:, k] *= share(times) if callable(share) else share
    write_sto(target, Table(name=target.stem, columns=table.columns, data=data))
    return str(target)


def judged(folder: Path, start: str, **content: Any) -> DynamicsResults:
    file = folder / "S.yaml"
    file.write_text(yaml.safe_dump(content))
    return dynamics(file, DynamicsSettings(start=start))


def test_a_plate_left_out_of_a_walk_is_missed_in_alternate_steps(shared_data: Path, tmp_path: Path) -> None:
    data = shared_data / "gait2354"
    walk = "subject01_walk1"
    found = judged(
        tmp_path,
        "MB",
        subject={"id": "walk", "height_m": 1.803, "mass_kg": 72.6},
        model=str(data / "gait2354_simbody.osim"),
        marker_set=str(data / "gait2354_Scale_MarkerSet.xml"),
        trials={"static": str(data / "subject01_static.trc"), "calibration": [str(data / f"{walk}.trc")]},
        forces={f"{walk}.trc": without(("1_ground",), data / f"{walk}_grf.mot", tmp_path / "one.mot")},
    )
    reported = found.trials[walk].unmeasured
    assert [one.kind for one in reported] == ["missing_plate"] * 2
    assert all(0.8 < one.share < 1.0 for one in reported)
    assert "a plate is missing" in found.verdict
    assert "can be calibrated" not in found.verdict
    assert "explains all" not in found.verdict
    assert not found.trials[walk].calibration_supported.any()


def test_one_bad_trial_is_left_out_and_the_wrong_mass_is_reported(shared_data: Path, tmp_path: Path) -> None:
    """A squat without its left plate says nothing; the walk is judged, and weighed."""
    data = shared_data / "opencap_squat"
    content: dict[str, Any] = {
        "subject": {"id": "squat", "height_m": 1.68, "mass_kg": 58.0},
        "model": str(data / "unscaled_generic.osim"),
        "trials": {
            "static": str(data / "static1.trc"),
            "calibration": [str(data / "squats1.trc"), str(data / "walking1.trc")],
        },
        "forces": {
            "squats1.trc": without(
                ("ground_force_2", "ground_torque_2"), data / "squats1_grf.mot", tmp_path / "s.mot"
            ),
            "walking1.trc": str(data / "walking1_grf.mot"),
        },
    }
    found = judged(tmp_path, "MB", **content)
    assert list(found.trials) == ["walking1"]
    assert "squats1 is left out" in found.verdict
    assert "Give the right mass first" in found.verdict
    document = save_dynamics(found, tmp_path / "out")
    assert document.weight.differs
    assert "The declared mass is wrong" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    content["trials"]["calibration"].pop()
    content["forces"].pop("walking1.trc")
    with pytest.raises(TrialUnusable, match="a plate is missing"):
        judged(tmp_path, "MB", **content)


def test_sitting_down_on_a_chair_is_reported(shared_data: Path, tmp_path: Path) -> None:
    """Of somebody who sits down, the plates bear 40 % from 0.95 s on."""
    data, name = shared_data / "hidden" / "case_13", "STSweakLegs1"
    seat = without(
        ("ground_force", "ground_torque"), data / f"{name}_grf.mot", tmp_path / "seat.mot",
        lambda t: 1.0 - 0.6 * np.clip((t - 0.85) / 0.1, 0.0, 1.0),
    )  # fmt: skip
    for forces, kinds in ((str(data / f"{name}_grf.mot"), []), (seat, ["chair"])):
        found = judged(
            tmp_path,
            "none",
            subject={"id": "seat", "height_m": 1.68, "mass_kg": 62.6},
            model=str(data / "model.osim"),
            trials={"calibration": [str(data / f"{name}.trc")]},
            forces={f"{name}.trc": forces},
        )
        assert [one.kind for one in found.trials[name].unmeasured] == kinds
        assert ("as on a chair" in found.verdict) == bool(kinds)
    assert "can be calibrated" not in found.verdict
    assert found.trials[name].unmeasured[0].start_s == pytest.approx(0.9, abs=0.1)
