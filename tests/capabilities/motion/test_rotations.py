"""Rotations are observations: poses and sensors made from a recording of markers whose motion is known.

OpenSim poses the model (an engine of its own), and its bodies' frames are written as a markerless system's
and as sensors' files; the motion has to come back.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scaling_service.capabilities.motion.options import MotionOptions
from scaling_service.capabilities.motion.result import Tracked
from scaling_service.capabilities.motion.run import ik
from scaling_service.capabilities.motion.saving import save_motions
from scaling_service.core.errors import TrialUnusable
from scaling_service.files.orientations import read_orientations
from scaling_service.files.sto import read_sto
from scaling_service.files.trc import read_trc, write_trc
from tests.files.rotations_made import write_orientations, write_poses
from tests.peers.worker import ask

pytestmark = pytest.mark.skipif(find_spec("opensim") is None, reason="the opensim library is not installed")

NOISE_DEG = 3.0
WITHOUT_NOISE_DEG = 0.5
COVERED = (0.90, 0.98)  # by bands of 95 %
MODEL, WALK = "opencap_squat/manually_scaled.osim", "opencap_squat/walking1.trc"
THINNED = slice(None, None, 2)
"""Every second frame of the walk, as 50 Hz are enough for joints."""

THEIA = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""Columns: right, forward and up in OpenSim's axes of a body (forward, up, right)."""
Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # from y up to z up
BODIES = {
    "pelvis": "pelvis",
    "torso": "torso",
    **{
        f"{body}_{side}": f"{side}_{name}"
        for side in "rl"
        for body, name in (
            ("femur", "thigh"),
            ("tibia", "shank"),
            ("calcn", "foot"),
            ("toes", "toes"),
            ("humerus", "uarm"),
            ("radius", "larm"),
            ("hand", "hand"),
        )
    },
}
SENSORS = tuple(name for name in BODIES if not name.startswith(("toes", "hand")))


@dataclass(frozen=True)
class Truth:
    """The motion that files are made of."""

    model: Path
    times: np.ndarray
    coordinates: tuple[str, ...]
    q: np.ndarray  # (n, k), rad and m
    turns: dict[str, np.ndarray]  # body to (n, 3, 3)
    origins: dict[str, np.ndarray]  # (n, 3), m
    standing: dict[str, np.ndarray]  # body to (3, 3) in the default pose
    rotations: tuple[str, ...]  # the coordinates to be found


@pytest.fixture(scope="module")
def truth(shared_data: Path) -> Truth:
    """OpenSim's bodies in the motion that the markers of a walk give."""
    model = shared_data / MODEL
    tracked = ik(model, [shared_data / WALK])
    motion = tracked.trials["walking1"].motion
    body = tracked.loaded.session.model
    default = np.array([c.default for c in body.coordinates])
    q = np.where(np.isfinite(motion.q), motion.q, default)[THINNED]
    request = {"model": str(model), "coordinates": motion.coordinates, "q": [*q.tolist(), default.tolist()]}
    posed = ask("tests.peers.opensim_bodies", request)
    turns = {name: Rotation.from_euler("XYZ", posed["angles"][name]).as_matrix() for name in BODIES}
    return Truth(
        model=model,
        times=motion.times[THINNED],
        coordinates=motion.coordinates,
        q=q,
        turns={name: turn[:-1] for name, turn in turns.items()},
        origins={name: np.array(posed["origins"][name])[:-1] for name in BODIES},
        standing={name: turn[-1] for name, turn in turns.items()},
        rotations=tuple(c.name for c in body.coordinates if c.kind == "rotation" and not c.locked),
    )


def spoil(turns: np.ndarray, rng: np.random.Generator, moment: float, always: float) -> np.ndarray:
    """Rotations (n, s, 3, 3) with noise about each axis, deg: anew in every frame, and the same in all."""
    shape = turns.shape[:2]
    each = Rotation.from_rotvec(np.radians(moment) * rng.normal(size=(shape[0] * shape[1], 3))).as_matrix()
    own = Rotation.from_rotvec(np.radians(always) * rng.normal(size=(shape[1], 3))).as_matrix()
    return turns @ own @ each.reshape(*shape, 3, 3)


def make_poses(
    truth: Truth,
    folder: Path,
    seed: int = 0,
    moment: float = 0.0,
    always: float = 0.0,
    axes: np.ndarray = THEIA,
) -> Path:
    """A file as Theia3D writes it: z up, mm."""
    turns = np.stack([Z_UP @ truth.turns[name] @ axes for name in BODIES], axis=1)
    turns = spoil(turns, np.random.default_rng(seed), moment, always)
    origins = 1e3 * np.stack([truth.origins[name] @ Z_UP.T for name in BODIES], axis=1)
    world, corner = np.tile(np.eye(3), (len(turns), 1, 1, 1)), np.zeros((len(turns), 1, 3))
    labels = ["worldbody_4X4", *(f"{name}_4X4" for name in BODIES.values())]
    both = np.concatenate([world, turns], axis=1), np.concatenate([corner, origins], axis=1)
    write_poses(folder / "theia.c3d", labels, *both)
    return folder / "theia.c3d"


def make_sensors(
    truth: Truth,
    folder: Path,
    seed: int = 0,
    moment: float = 0.0,
    always: float = 0.0,
    heading_deg: float = 70.0,
) -> tuple[Path, Path]:
    """Files as OpenSense has them, of standing in the default pose and of walking; the world has z up."""
    rng = np.random.default_rng(seed)
    on = Rotation.random(len(SENSORS), random_state=11).as_matrix()
    world = Z_UP @ Rotation.from_euler("y", heading_deg, degrees=True).as_matrix()
    walking = np.stack([world @ truth.turns[name] @ on[k] for k, name in enumerate(SENSORS)], axis=1)
    standing = np.stack([world @ truth.standing[name] @ on[k] for k, name in enumerate(SENSORS)])
    labels = [f"{name}_imu" for name in SENSORS]
    walking = spoil(walking, rng, moment, always)
    stood = spoil(np.tile(standing, (50, 1, 1, 1)), rng, moment, 0.0)
    write_orientations(folder / "standing.sto", np.arange(50) / 100.0, labels, stood)
    write_orientations(folder / "walking.sto", truth.times, labels, walking)
    return folder / "standing.sto", folder / "walking.sto"


def compare(tracked: Tracked, truth: Truth) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Errors and deviations of the coordinates that are determined, deg, (n, k), and their names."""
    (found,) = tracked.trials.values()
    names = tuple(name for name in truth.rotations if name in found.motion.estimated)
    own = [found.motion.coordinates.index(name) for name in names]
    error = found.motion.q[:, own] - truth.q[:, [truth.coordinates.index(name) for name in names]]
    return np.degrees(error), np.degrees(found.uncertainty.sd[:, own]), names


def count_covered(tracked: Tracked, truth: Truth) -> float:
    error, sd, _ = compare(tracked, truth)
    return float((np.abs(error) < 1.96 * sd).mean())


def test_poses_of_a_markerless_system_give_the_motion(truth: Truth, tmp_path: Path) -> None:
    tracked = ik(truth.model, [make_poses(truth, tmp_path)])
    error, sd, names = compare(tracked, truth)
    assert names == truth.rotations
    assert np.abs(error).max() < WITHOUT_NOISE_DEG
    assert (sd > 1.0).all()  # without noise, too, as a system's frames are nobody's bones
    (found,) = tracked.trials.values()
    places = [found.motion.coordinates.index(f"pelvis_t{axis}") for axis in "xyz"]
    theirs = [truth.coordinates.index(f"pelvis_t{axis}") for axis in "xyz"]
    np.testing.assert_allclose(found.motion.q[:, places], truth.q[:, theirs], atol=1e-3)
    said = " ".join(tracked.loaded.session.warnings)
    assert "r_shank_4X4 on right tibia" in said
    assert "worldbody_4X4" in said
    assert "as documented" in said


def test_axes_are_told_by_where_they_point(truth: Truth, tmp_path: Path) -> None:
    """The bodies' own axes, and others that no program documents."""
    for axes in (np.eye(3), THEIA @ np.diag([-1.0, -1.0, 1.0])):
        tracked = ik(truth.model, [make_poses(truth, tmp_path, axes=axes)])
        assert np.abs(compare(tracked, truth)[0]).max() < WITHOUT_NOISE_DEG
        assert "by where they point" in " ".join(tracked.loaded.session.warnings)


def test_sensors_put_on_anyhow_give_the_motion(truth: Truth, tmp_path: Path) -> None:
    standing, walking = make_sensors(truth, tmp_path)
    tracked = ik(truth.model, [walking], standing=standing)
    error, sd, names = compare(tracked, truth)
    assert np.abs(error).max() < WITHOUT_NOISE_DEG
    assert set(truth.rotations) - set(names) == {"mtp_angle_r", "mtp_angle_l"}  # no sensor on toes
    assert (sd > 1.0).all()
    document = save_motions(tracked, tmp_path / "out")
    assert document.trials["walking"].kinematic_error_mm.mean is None
    assert {"pelvis_tx", "pelvis_ty", "pelvis_tz"} <= set(document.trials["walking"].not_determined)
    assert max(document.trials["walking"].rotation_error_deg.values()) < WITHOUT_NOISE_DEG
    written = read_sto(tmp_path / "out" / "walking_ik.mot").column("knee_angle_r")
    np.testing.assert_allclose(
        written, np.degrees(truth.q[:, truth.coordinates.index("knee_angle_r")]), atol=WITHOUT_NOISE_DEG
    )


def test_sensors_with_their_segments_axes_need_no_pose(truth: Truth, tmp_path: Path) -> None:
    turns = np.stack([Z_UP @ truth.turns[name] for name in SENSORS], axis=1)
    write_orientations(tmp_path / "walking.sto", truth.times, [f"{name}_imu" for name in SENSORS], turns)
    tracked = ik(truth.model, [tmp_path / "walking.sto"])
    assert np.abs(compare(tracked, truth)[0]).max() < WITHOUT_NOISE_DEG
    assert "axes are those of their segments, their world is z up" in " ".join(
        tracked.loaded.session.warnings
    )


def test_a_pose_that_is_none_is_doubted(truth: Truth, tmp_path: Path) -> None:
    """Sensors put on anyhow, and a first frame in the middle of a step."""
    _, walking = make_sensors(truth, tmp_path)
    codes = {note.code for note in ik(truth.model, [walking]).loaded.session.notes}
    assert "mounting_doubtful" in codes


def test_as_opensim_does_it(truth: Truth, tmp_path: Path) -> None:
    """OpenSim's IMU placer and its inverse kinematics on the same files; and its placed model, used here."""
    standing, walking = make_sensors(truth, tmp_path, heading_deg=0.0)
    # The pelvis's sensor has no axis that points forward, so OpenSim is not asked for a heading.
    request = {
        "model": str(truth.model),
        "standing": str(standing),
        "walking": str(walking),
        "to_opensim": [-np.pi / 2.0, 0.0, 0.0],
        "base": "",
        "axis": "",
    }
    peer = ask("tests.peers.opensim_imu_ik", request)
    theirs = np.array(peer["values"])
    error, _, names = compare(ik(truth.model, [walking], standing=standing), truth)
    for k, name in enumerate(names):
        known = np.degrees(truth.q[:, truth.coordinates.index(name)])
        off = np.abs(theirs[:, peer["coordinates"].index(name)] - known).max()
        assert np.abs(error[:, k]).max() < max(WITHOUT_NOISE_DEG, off)
        assert off < 2.0 * WITHOUT_NOISE_DEG, name
    (tmp_path / "placed.osim").write_text(peer["placed"], encoding="utf-8")
    tracked = ik(tmp_path / "placed.osim", [walking])
    assert np.abs(compare(tracked, truth)[0]).max() < WITHOUT_NOISE_DEG
    assert "sit as the model has them" in " ".join(tracked.loaded.session.warnings)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_bands_cover_noise_of_poses(truth: Truth, tmp_path: Path, seed: int) -> None:
    tracked = ik(truth.model, [make_poses(truth, tmp_path, seed, moment=NOISE_DEG)])
    assert COVERED[0] < count_covered(tracked, truth) < COVERED[1]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_bands_cover_noise_of_sensors(truth: Truth, tmp_path: Path, seed: int) -> None:
    standing, walking = make_sensors(truth, tmp_path, seed, moment=NOISE_DEG)
    assert COVERED[0] < count_covered(ik(truth.model, [walking], standing=standing), truth) < COVERED[1]


@pytest.mark.costly
def test_bands_cover_mountings_that_are_off(truth: Truth, tmp_path: Path) -> None:
    """A constant error is one draw a coordinate, however many frames: several are taken together."""
    covered = [
        count_covered(ik(truth.model, [make_poses(truth, tmp_path, seed, always=NOISE_DEG)]), truth)
        for seed in range(12)
    ]
    assert COVERED[0] < np.mean(covered) < COVERED[1]


def test_bands_cover_both_at_once(truth: Truth, tmp_path: Path) -> None:
    """That frames sit askew shows where joints are hinges, and widens what jitter alone would say."""
    covered = [
        count_covered(ik(truth.model, [make_poses(truth, tmp_path, seed, NOISE_DEG, NOISE_DEG)]), truth)
        for seed in range(6)
    ]
    assert COVERED[0] < np.mean(covered) < COVERED[1]


def test_markers_and_poses_go_together(truth: Truth, shared_data: Path, tmp_path: Path) -> None:
    """Half of the markers beside poses with noise: better than either, as the pelvis is where markers are."""
    from scaling_service.files.recording import read_recording

    trial = read_recording(shared_data / WALK).trial.frames(THINNED)
    turns = np.stack([truth.turns[name] @ THEIA for name in BODIES], axis=1)
    turns = spoil(turns, np.random.default_rng(3), NOISE_DEG, 0.0)
    origins = np.stack([truth.origins[name] for name in BODIES], axis=1)
    labels = [f"{name}_4X4" for name in BODIES.values()]
    write_poses(
        tmp_path / "both.c3d", labels, turns, 1e3 * origins, points=(trial.labels, 1e3 * trial.markers)
    )
    write_poses(tmp_path / "alone.c3d", labels, turns, 1e3 * origins)
    both, alone = (ik(truth.model, [tmp_path / name]) for name in ("both.c3d", "alone.c3d"))
    errors = [np.sqrt(np.mean(np.square(compare(tracked, truth)[0]))) for tracked in (both, alone)]
    assert errors[0] < 0.7 * errors[1]
    sds = [np.median(compare(tracked, truth)[1]) for tracked in (both, alone)]
    assert sds[0] < sds[1]


def test_sensors_beside_markers_are_mounted_by_them(truth: Truth, shared_data: Path, tmp_path: Path) -> None:
    """Two files of one name are one movement; sensors go on where markers are lost."""
    trial = read_trc(shared_data / WALK).trial.frames(THINNED)
    markers = trial.markers.copy()
    markers[35:] = np.nan
    write_trc(tmp_path / "walking.trc", replace(trial, markers=markers), "m")
    _, walking = make_sensors(truth, tmp_path, moment=1.0)
    tracked = ik(truth.model, [tmp_path / "walking.trc", walking])
    assert "sit as the markers of 'walking' show" in " ".join(tracked.loaded.session.warnings)
    error, sd, names = compare(tracked, truth)
    legs = [k for k, name in enumerate(names) if name.startswith(("hip", "knee", "ankle", "pelvis"))]
    assert np.isfinite(error[:, legs]).all()  # without sensors nothing is known after the markers are lost
    assert np.sqrt(np.mean(np.square(error[35:, legs]))) < NOISE_DEG
    assert (np.abs(error) < 1.96 * sd)[35:, legs].mean() > COVERED[0]


def test_a_world_of_sensors_that_was_reset_between_recordings(
    truth: Truth, shared_data: Path, tmp_path: Path
) -> None:
    """With markers beside them each recording tells its own heading; without, it is the pelvis's alone."""
    trial = read_trc(shared_data / WALK).trial.frames(THINNED)
    parts = {"first": slice(0, 33), "second": slice(33, None)}
    found = {}
    for reset_deg in (0.0, 90.0):
        folder = tmp_path / f"{reset_deg:.0f}"
        folder.mkdir()
        files, standing = [], folder
        for name, rows in parts.items():
            heading = 70.0 + (reset_deg if name == "second" else 0.0)
            stood, walking = make_sensors(truth, folder, moment=1.0, heading_deg=heading)
            standing = stood.rename(folder / "stood.sto") if name == "first" else standing
            table = read_orientations(walking)
            held = table.trial.rotations
            assert held is not None
            write_orientations(
                folder / f"{name}.sto", truth.times[rows], list(held.labels), held.matrices[rows]
            )
            write_trc(folder / f"{name}.trc", trial.frames(rows), "m")
            files += [folder / f"{name}.trc", folder / f"{name}.sto"]
        beside, alone = ik(truth.model, files), ik(truth.model, files[1::2], standing=standing)
        found[reset_deg] = [each.trials["second"].motion for each in (beside, alone)]
    (both, alone), (both_reset, alone_reset) = found.values()
    np.testing.assert_allclose(both_reset.q, both.q, atol=1e-3)
    joints = [k for k, name in enumerate(alone.coordinates) if not name.startswith("pelvis")]
    assert len(set(alone.estimated)) > 20
    np.testing.assert_allclose(alone_reset.q[:, joints], alone.q[:, joints], atol=1e-3)


def test_rotations_of_nothing_are_refused(truth: Truth, tmp_path: Path) -> None:
    turns = np.stack([truth.turns["pelvis"], truth.turns["torso"]], axis=1)
    write_orientations(tmp_path / "walking.sto", truth.times, ["IMU01", "IMU02"], turns)
    with pytest.raises(TrialUnusable, match=r"IMU01.*on a segment") as caught:
        ik(truth.model, [tmp_path / "walking.sto"])
    assert "pelvis" in str(caught.value.remedy)


def test_up_can_be_said(truth: Truth, tmp_path: Path) -> None:
    standing, walking = make_sensors(truth, tmp_path)
    tracked = ik(truth.model, [walking], MotionOptions(up="+z"), standing=standing)
    assert np.abs(compare(tracked, truth)[0]).max() < WITHOUT_NOISE_DEG
