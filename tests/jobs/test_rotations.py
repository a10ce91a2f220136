"""Recordings of rotations among a subject's: what scales follows them, and what needs markers says so."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scaling_service.capabilities.discovery.run import discover
from scaling_service.capabilities.intake.files import look_into
from scaling_service.capabilities.motion.job import MotionRequest, work
from scaling_service.capabilities.scaling.run import compare, scale
from scaling_service.capabilities.scaling.saving import save
from scaling_service.core.errors import SubjectInvalid, TrialUnusable
from scaling_service.core.progress import show_nothing
from scaling_service.documents.base import DOCUMENT
from scaling_service.files.sto import read_sto
from scaling_service.model.builtin import load_builtin
from scaling_service.model.poses import pose_segments
from tests.files.rotations_made import write_orientations, write_poses
from tests.jobs.laboratory import document, known_person, laboratory, write_subject

LABELS = {
    "pelvis": "pelvis_4X4",
    **{f"femur_{s}": f"{s}_thigh_4X4" for s in "rl"},
    **{f"tibia_{s}": f"{s}_shank_4X4" for s in "rl"},
}
THEIA = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
KNEE_DEG = 60.0  # at most


def write_files(folder: Path, femur_m: float = 0.40) -> None:
    """A knee bends by 60 degrees in `poses.c3d` and `sensors.sto`; `standing.sto` is the default pose."""
    model = load_builtin("lower_limb_14dof")
    q = np.tile([c.default for c in model.coordinates], (80, 1))
    bend = np.radians(KNEE_DEG) * np.sin(np.linspace(0.0, np.pi, 80)) ** 2
    for side, share in (("r", 1.0), ("l", 0.5)):
        q[:, model.coordinate_names.index(f"knee_angle_{side}")] -= share * bend
        q[:, model.coordinate_names.index(f"hip_flexion_{side}")] += 0.5 * share * bend
    posed = pose_segments(model, q)
    own = [model.segment_names.index(name) for name in LABELS]
    turns = Rotation.from_quat(posed[:, own, 3:].reshape(-1, 4)).as_matrix().reshape(80, -1, 3, 3)
    origins = 1e3 * posed[:, own, :3]
    thigh = origins[:, 3:] - origins[:, 1:3]
    origins[:, 3:] = origins[:, 1:3] + 1e3 * femur_m * thigh / np.linalg.norm(thigh, axis=2, keepdims=True)
    write_poses(folder / "poses.c3d", list(LABELS.values()), Z_UP @ turns @ THEIA, origins @ Z_UP.T)
    on = Rotation.random(len(LABELS), random_state=2).as_matrix()
    labels = [f"{name}_imu" for name in LABELS]
    write_orientations(folder / "sensors.sto", np.arange(80) / 100.0, labels, Z_UP @ turns @ on)
    still = np.tile(Z_UP @ turns[:1] @ on, (20, 1, 1, 1))
    write_orientations(folder / "standing.sto", np.arange(20) / 100.0, labels, still)


def make(folder: Path, **trials: Any) -> Path:
    write_files(folder)
    return write_subject(folder, document(trials=trials))


def find_bend(path: Path) -> float:
    return float(np.ptp(read_sto(path).column("knee_angle_r")))


def test_a_model_scaled_from_markers_follows_rotations(tmp_path: Path) -> None:
    subject = laboratory(tmp_path, known_person())
    write_files(tmp_path)
    content = document()
    content["trials"]["evaluation"] = [*content["trials"].get("evaluation", []), "poses.c3d"]
    write_subject(tmp_path, content)
    results = scale(subject, "MB")
    assert "poses" not in results.scalings["MB"].errors
    save(results, tmp_path / "out", comparison=False)
    assert find_bend(tmp_path / "out" / "MB" / "poses_ik.mot") == pytest.approx(KNEE_DEG, abs=0.5)
    sd = read_sto(tmp_path / "out" / "MB" / "poses_ik_sd.mot").column("knee_angle_r")
    assert 1.0 < sd.mean() < 6.0


def test_rotations_alone_are_sized_by_stature_and_joint_centres(tmp_path: Path) -> None:
    results = compare(make(tmp_path, evaluation=["poses.c3d"]))
    assert list(results.scalings) == ["MB"]
    lengths = results.lengths.to_frame().set_index("segment")["length_mm"]
    without = compare(make(tmp_path, static="standing.sto", evaluation=["sensors.sto"]))
    by_stature = without.lengths.to_frame().set_index("segment")["length_mm"]
    assert abs(lengths["femur_r"] - 400.0) < abs(by_stature["femur_r"] - 400.0) + 1e-9
    said = " ".join(without.warnings)
    assert "sized as persons of" in " ".join(without.scalings["MB"].calibration.warnings)
    assert "'standing' as the model does by default" in said
    bend = np.degrees(without.scalings["MB"].followed["sensors"].motion.column("knee_angle_r"))
    assert np.ptp(bend) == pytest.approx(KNEE_DEG, abs=0.5)


def test_markers_and_sensors_of_one_name_are_one_recording(tmp_path: Path) -> None:
    """Scaling takes its markers and says so; only another role, or another kind of file, is another."""
    subject = laboratory(tmp_path, known_person())
    write_files(tmp_path)
    alone = scale(subject, "MB")
    (tmp_path / "sensors.sto").rename(tmp_path / "walk.sto")
    content = document()
    content["trials"]["evaluation"] = ["walk.trc", "walk.sto"]
    both = scale(write_subject(tmp_path, content), "MB")
    assert list(both.scalings["MB"].errors) == list(alone.scalings["MB"].errors)
    np.testing.assert_array_equal(
        both.scalings["MB"].motions["walk"].q, alone.scalings["MB"].motions["walk"].q
    )
    assert not both.scalings["MB"].followed
    assert "walk: its rotations are not used, its markers are" in " ".join(both.warnings)
    content["trials"] = {**content["trials"], "calibration": ["walk.sto"], "evaluation": ["walk.trc"]}
    with pytest.raises(SubjectInvalid, match=r"walk\.trc.*walk\.sto.*same name"):
        scale(write_subject(tmp_path, content), "MB")


def test_what_needs_markers_says_so(tmp_path: Path) -> None:
    subject = make(tmp_path, evaluation=["poses.c3d"])
    with pytest.raises(TrialUnusable, match="MAP is fitted to markers") as caught:
        scale(subject, "MAP")
    assert "MB" in str(caught.value.remedy)
    with pytest.raises(TrialUnusable, match="rotations and no markers") as caught:
        discover(subject)
    assert "poses.c3d" in str(caught.value.file)
    assert "ik" in str(caught.value.remedy)


def test_a_folder_that_is_looked_at_names_them(tmp_path: Path) -> None:
    write_files(tmp_path)
    for name in ("poses.c3d", "sensors.sto"):
        found = look_into(tmp_path / name, None, None)
        assert (found.kind, found.usable) == ("other", True)
        assert "`ik`" in found.why


def test_a_job_takes_the_static_trial_of_sensors_for_their_pose(tmp_path: Path) -> None:
    make(tmp_path, static="standing.sto", evaluation=["sensors.sto"])
    folder = tmp_path / "inputs" / "S01"
    folder.mkdir(parents=True)
    for file in ("standing.sto", "sensors.sto"):
        (tmp_path / file).rename(folder / file)
    content = document(trials={"static": "standing.sto", "evaluation": ["sensors.sto"]})
    (folder / DOCUMENT).write_text(json.dumps(content), encoding="utf-8")
    request = MotionRequest(subject="S01")
    outputs = tmp_path / "outputs"
    outputs.mkdir()
    result = work(request, tmp_path / "inputs", outputs, show_nothing)
    assert any("'standing' as the model does by default" in text for text in result["warnings"])
    assert find_bend(outputs / "sensors_ik.mot") == pytest.approx(KNEE_DEG, abs=0.5)
