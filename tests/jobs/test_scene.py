"""What is played back agrees with what was computed, and with itself."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from scaling_service.capabilities.discovery.playing import AFTER, BEFORE, write_discovery_scene
from scaling_service.capabilities.playback.drawing import find_ends, make_simple_shape, to_glb
from scaling_service.capabilities.playback.result import BodyEntry, MotionEntry, SceneDocument, SceneTrial
from scaling_service.capabilities.playback.scene import WHOLE
from scaling_service.capabilities.scaling.result import Results
from scaling_service.capabilities.scaling.run import run
from scaling_service.capabilities.scaling.scene import write_results_scene
from scaling_service.capabilities.subject.loading import Loaded
from scaling_service.core.arrays import Array
from scaling_service.documents.base import ArrayEntry
from scaling_service.files.table_files import MOST_FRAMES, ArrayFiles, sample_at
from scaling_service.model.builtin import load_builtin
from scaling_service.model.poses import pose_neutral_frames, pose_segments
from scaling_service.virtual.example import make_demo_session
from scaling_service.virtual.subject import VirtualSettings
from tests.jobs.hidden_case import found

TOLERANCE_MM = 0.005  # float32 of some metres, local coordinates to the micrometre


@cache
def results() -> Results:
    """A person with bones, two methods, short recordings."""
    session, _ = make_demo_session(3, VirtualSettings(functional_s=1.0, gait_trials=2), images=True)
    return run(Loaded(session=session), ("MB", "EB"))


def table(folder: Path, entry: ArrayEntry) -> Array:
    return np.fromfile(folder / entry.file, dtype="<f4").reshape(entry.shape).astype(float)


def placed(folder: Path, body: BodyEntry, motion: MotionEntry, labels: list[str]) -> Array:
    """Where a viewer puts the model's markers: by poses and local coordinates alone."""
    poses = table(folder, motion.poses)
    names = [segment.name for segment in body.segments]
    points = np.full((len(poses), len(labels), 3), np.nan)
    for marker in body.markers:
        if marker.name in labels:
            pose = poses[:, names.index(marker.segment)]
            known = np.isfinite(pose).all(axis=1)
            turned = Rotation.from_quat(pose[known, 3:]).apply(marker.xyz_m)
            points[known, labels.index(marker.name)] = pose[known, :3] + turned
    return points


def check_errors(folder: Path, scene: SceneDocument, trial: SceneTrial, body: BodyEntry) -> None:
    motion = trial.motions[body.name]
    model = (
        placed(folder, body, motion, trial.labels) if motion.placed is None else table(folder, motion.placed)
    )
    away = 1e3 * np.linalg.norm(model - table(folder, trial.measured), axis=2)
    errors = table(folder, motion.errors)
    known = np.isfinite(errors)
    assert known.mean() > 0.5
    assert np.abs(away - errors)[known].max() < TOLERANCE_MM


def test_poses_markers_and_errors_belong_together(tmp_path: Path) -> None:
    scene = write_results_scene(results(), tmp_path)
    assert [body.name for body in scene.bodies] == ["MB", "EB"]
    for trial in scene.trials:
        for body in scene.bodies:
            check_errors(tmp_path, scene, trial, body)
    walk = next(t for t in scene.trials if t.role == "evaluation")
    reported = results().scalings["EB"].errors[walk.name].mean
    assert np.nanmean(table(tmp_path, walk.motions["EB"].errors)) == pytest.approx(1e3 * reported, rel=1e-4)


def test_angles_are_degrees_with_their_names(tmp_path: Path) -> None:
    scene = write_results_scene(results(), tmp_path)
    trial = next(t for t in scene.trials if t.name == "knee_r")
    motion = trial.motions["MB"]
    names = [c.name for c in motion.coordinates]
    units = {c.name: c.unit for c in motion.coordinates}
    assert (units["knee_angle_r"], units["pelvis_ty"]) == ("deg", "m")
    knee = table(tmp_path, motion.angles)[:, names.index("knee_angle_r")]
    q = results().scalings["MB"].motions["knee_r"]
    assert np.allclose(knee, np.degrees(q.q[:, q.coordinates.index("knee_angle_r")]), atol=1e-4)


def test_bones_are_fine_enough_and_small_enough(tmp_path: Path) -> None:
    scene = write_results_scene(results(), tmp_path)
    for body in scene.bodies:
        content = trimesh.load(tmp_path / body.bones, process=False)
        assert isinstance(content, trimesh.Scene)
        shapes = {s.name: s.shape for s in body.segments}
        assert set(content.geometry) == {name for name, shape in shapes.items() if shape != "none"}
        assert set(shapes.values()) == {"image" if body.name == "EB" else "simple"}
        for mesh in content.geometry.values():
            assert 100 < len(mesh.faces) <= WHOLE.most_faces * 1.01
        femur = content.geometry["femur_r"]
        knee = next(c for c in body.centres if c.name == "knee_r")
        assert np.linalg.norm(femur.bounds, axis=1).max() < 0.6  # m, around the hip
        assert np.abs(femur.vertices - knee.xyz_m).sum(axis=1).min() < 0.05  # and it reaches the knee


def test_the_cycle_is_that_of_the_report(tmp_path: Path) -> None:
    gait = write_results_scene(results(), tmp_path).gait
    assert gait is not None
    tested = [curve for curve in gait.angles.values() if curve.cycles > 1]
    assert tested
    for curve in tested:
        assert (set(curve.mean_deg), len(curve.mean_deg["MB"])) == ({"MB", "EB"}, 101)
        assert 0.0 < (curve.p or 0.0) <= 1.0  # of two methods, this is their comparison


def test_a_search_shows_both_models_and_the_marker_that_glides(tmp_path: Path) -> None:
    scene = write_discovery_scene(found(), tmp_path)
    assert [body.name for body in scene.bodies] == [BEFORE, AFTER]
    for trial in scene.trials:
        assert trial.motions[BEFORE].placed is None
        check_errors(tmp_path, scene, trial, scene.bodies[0])
        assert trial.motions[AFTER].placed is not None
    held_out = next(t for t in scene.trials if t.role == "evaluation")
    knee = held_out.labels.index("RLFE")
    before, after = (table(tmp_path, held_out.motions[n].errors)[:, knee] for n in (BEFORE, AFTER))
    assert np.nanmean(after) < 0.6 * np.nanmean(before)


def test_quaternions_turn_as_the_model_does_in_one_pose() -> None:
    model = load_builtin("full_body_35dof")
    rng = np.random.default_rng(0)
    q = rng.uniform(-0.5, 0.5, (1, len(model.coordinates)))
    poses = pose_segments(model, q)[0]
    truth = pose_neutral_frames(model, dict(zip(model.coordinate_names, q[0], strict=True)))
    for name, pose in zip(model.segment_names, poses, strict=True):
        R, origin = truth[name]
        assert np.allclose(pose[:3], origin, atol=1e-12)
        assert np.allclose(Rotation.from_quat(pose[3:]).as_matrix(), R, atol=1e-12)


def test_what_is_unknown_stays_unknown() -> None:
    model = load_builtin("lower_limb_14dof")
    q = np.zeros((3, len(model.coordinates)))
    q[1, model.coordinate_names.index("knee_angle_r")] = np.nan
    poses = pose_segments(model, q)
    unknown = np.isnan(poses).any(axis=2)
    assert not unknown[[0, 2]].any()
    assert [name for name, u in zip(model.segment_names, unknown[1], strict=True) if u] == ["tibia_r"]


@pytest.mark.parametrize("frames", [MOST_FRAMES, MOST_FRAMES + 1, 5 * MOST_FRAMES + 7])
def test_a_long_table_has_a_first_look(tmp_path: Path, frames: int) -> None:
    values = np.random.default_rng(1).normal(size=(frames, 3))
    values[100] = np.nan
    values[:, 2][: frames // 2] = np.nan
    files = ArrayFiles(tmp_path, "proof")
    plain = files.write("plain", values, "m")
    largest = files.write("largest", values, "mm", first_look="largest")
    assert np.allclose(table(tmp_path, plain), values, atol=1e-6, equal_nan=True)
    if frames <= MOST_FRAMES:
        assert plain.overview is None
        return
    assert plain.overview is not None
    assert largest.overview is not None
    step = plain.overview.step
    few = np.fromfile(tmp_path / plain.overview.file, "<f4").reshape(plain.overview.shape)
    assert len(few) <= MOST_FRAMES
    assert np.allclose(few, values[::step], atol=1e-6, equal_nan=True)
    most = np.fromfile(tmp_path / largest.overview.file, "<f4").reshape(largest.overview.shape)
    for k in (0, 100 // step, len(most) - 1):
        stretch = values[k * step : (k + 1) * step]
        expected = [np.nan if np.isnan(c).all() else np.nanmax(c) for c in stretch.T]
        assert np.allclose(most[k], expected, atol=1e-6, equal_nan=True)


@given(
    st.lists(st.floats(-5.0, 5.0), min_size=1, max_size=9, unique=True),
    st.lists(st.floats(-6.0, 6.0), min_size=1, max_size=9),
)
def test_samples_are_those_nearest_in_time(times: list[float], wanted: list[float]) -> None:
    clock, asked = np.array(sorted(times)), np.array(wanted)
    found = sample_at(clock, clock[:, None].copy(), asked)[:, 0]
    step = np.median(np.diff(clock)) if len(clock) > 1 else 0.0
    inside = (asked >= clock[0] - step) & (asked <= clock[-1] + step)
    assert np.array_equal(np.isnan(found), ~inside)
    nearest = np.abs(clock[:, None] - asked).min(axis=0)
    assert np.allclose(np.abs(found - asked)[inside], nearest[inside])


def test_a_body_without_any_shape_is_still_a_file(tmp_path: Path) -> None:
    (tmp_path / "empty.glb").write_bytes(to_glb({}))
    content = trimesh.load(tmp_path / "empty.glb")
    assert isinstance(content, trimesh.Scene)
    assert not content.geometry


def test_long_segments_are_rods_and_broad_ones_are_not() -> None:
    hip, knee, kneecap = [0.0, 0.0, 0.0], [0.0, -0.4, 0.0], [0.05, -0.37, 0.0]
    assert np.array_equal(find_ends(np.array([hip, kneecap, knee])), [hip, knee])
    assert find_ends(np.array([hip, [0.0, 0.0, 0.17], [0.1, 0.1, 0.08]])) is None
    assert find_ends(np.array([hip, hip])) is None


def test_a_simple_shape_goes_around_its_points() -> None:
    ends = np.array([[0.0, 0.0, 0.0], [0.0, -0.4, 0.0]])
    rod = make_simple_shape(ends)
    assert rod is not None
    assert rod.is_watertight
    length, radius = 0.4, 0.07 * 0.4
    assert rod.volume == pytest.approx(np.pi * radius**2 * (length + 4 / 3 * radius), rel=0.08)
    assert make_simple_shape(ends[:1]) is None
