"""Rotations from files: Theia3D's segment poses in C3D, and OpenSense's orientations in STO."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scaling_service.core.errors import FileUnreadable, TrialUnusable
from scaling_service.files.orientations import is_orientation_file
from scaling_service.files.recording import read_recording
from tests.files.rotations_made import write_orientations, write_poses

LABELS = ("worldbody_4X4", "pelvis_4X4", "r_thigh_4X4", "r_shank_4X4")


def make(n=20):
    turns = Rotation.random(n * len(LABELS), random_state=1).as_matrix().reshape(n, -1, 3, 3)
    origins = np.tile([[0.0, 0, 0], [0, 0, 900.0], [80, 0, 880], [80, 10, 470]], (n, 1, 1))
    return turns, origins


def test_poses_are_read_as_written(tmp_path):
    turns, origins = make()
    write_poses(tmp_path / "walk.c3d", LABELS, turns, origins, rate_hz=120.0)
    read = read_recording(tmp_path / "walk.c3d")
    assert (read.labels, read.n_frames, read.rate_hz) == ((), 20, 120.0)
    assert (read.rotations.labels, read.rotations.of) == (LABELS, "segments")
    np.testing.assert_allclose(read.rotations.matrices, turns, atol=1e-6)
    np.testing.assert_allclose(read.rotations.origins, 1e-3 * origins, atol=1e-6)
    assert repr(read) == "Recording 'walk': 20 frames at 120 Hz, 4 rotations"
    assert read.frames([3, 5]).rotations.matrices.shape == (2, 4, 3, 3)


def test_poses_beside_markers(tmp_path):
    turns, origins = make()
    markers = np.random.default_rng(0).normal(size=(20, 2, 3)) * 500.0
    write_poses(tmp_path / "both.c3d", LABELS, turns, origins, points=(("RASI", "LASI"), markers))
    read = read_recording(tmp_path / "both.c3d")
    assert read.labels == ("RASI", "LASI")
    np.testing.assert_allclose(read.markers, 1e-3 * markers, atol=1e-6)
    np.testing.assert_allclose(read.rotations.matrices, turns, atol=1e-6)


def test_what_is_no_rotation_is_not_measured(tmp_path):
    turns, origins = make()
    turns[3:5, 1], turns[7, 2] = 0.0, np.diag([1.0, 1.0, -1.0])
    write_poses(tmp_path / "walk.c3d", LABELS, turns, origins)
    read = read_recording(tmp_path / "walk.c3d")
    lost = np.isnan(read.rotations.matrices).all(axis=(2, 3))
    assert np.argwhere(lost).tolist() == [[3, 1], [4, 1], [7, 2]]
    assert [(r.where, r.frames) for r in read.repairs if r.what == "lost_pose"] == [
        ("pelvis_4X4", 2),
        ("r_thigh_4X4", 1),
    ]


def test_a_unit_that_cannot_be_is_mended(tmp_path):
    turns, origins = make()
    write_poses(tmp_path / "walk.c3d", LABELS, turns, origins, unit="m")
    read = read_recording(tmp_path / "walk.c3d")
    np.testing.assert_allclose(read.rotations.origins, 1e-3 * origins, atol=1e-6)
    assert "thigh's length" in next(r.detail for r in read.repairs if r.what == "unit")


def test_bad_poses_are_refused(tmp_path):
    turns, origins = make()
    write_poses(tmp_path / "none.c3d", LABELS, 0.0 * turns, origins)
    with pytest.raises(TrialUnusable, match="no segment pose"):
        read_recording(tmp_path / "none.c3d")
    write_poses(tmp_path / "twice.c3d", (*LABELS[:3], "pelvis_4X4"), turns, origins)
    with pytest.raises(TrialUnusable, match="different labels"):
        read_recording(tmp_path / "twice.c3d")
    write_poses(tmp_path / "cut.c3d", LABELS, turns, origins)
    (tmp_path / "cut.c3d").write_bytes((tmp_path / "cut.c3d").read_bytes()[:-2000])
    with pytest.raises(FileUnreadable, match="cut off"):
        read_recording(tmp_path / "cut.c3d")


def test_orientations_are_read_as_written(tmp_path):
    turns, _ = make()
    times = np.arange(20) / 50.0
    write_orientations(tmp_path / "walk.sto", times, ("pelvis_imu", "a", "b", "c"), turns)
    read = read_recording(tmp_path / "walk.sto")
    assert (read.rotations.labels, read.rotations.of) == (("pelvis_imu", "a", "b", "c"), "sensors")
    assert read.rotations.origins is None
    np.testing.assert_allclose(read.rotations.matrices, turns, atol=1e-9)
    np.testing.assert_allclose(read.times, times)
    assert is_orientation_file(tmp_path / "walk.sto")


def test_cells_that_are_no_orientation_are_not_measured(tmp_path):
    path = tmp_path / "walk.sto"
    rows = ["0.00\t1,0,0,0\tnan,nan,nan,nan", "0.01\t1,0,0,0\t0.7071,0.7071,0,0", "0.02\t3,0,0,0\t0,1,0,0"]
    path.write_text("\n".join(["DataType=Quaternion", "endheader", "time\tpelvis_imu\ttorso_imu", *rows]))
    read = read_recording(path)
    lost = np.isnan(read.rotations.matrices).all(axis=(2, 3))
    assert np.argwhere(lost).tolist() == [[0, 1], [2, 0]]
    assert read.rate_hz == pytest.approx(100.0)
    assert {r.where for r in read.repairs if r.what == "lost_orientation"} == {"pelvis_imu", "torso_imu"}


def test_tables_of_plain_numbers_are_no_recordings(tmp_path):
    path = tmp_path / "grf.sto"
    path.write_text("grf\nversion=1\nendheader\ntime\tground_force_vx\n0.0\t1.0\n")
    assert not is_orientation_file(path)
    with pytest.raises(FileUnreadable, match="orientations of sensors") as caught:
        read_recording(path)
    assert "forces:" in caught.value.remedy
