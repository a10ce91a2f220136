"""Key points of video: joint centres that are off, followed and sized with nothing mapped."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scaling_service.capabilities.intake.run import prove
from scaling_service.capabilities.motion.run import ik
from scaling_service.capabilities.scaling.run import compare, scale
from scaling_service.core.errors import TrialUnusable
from scaling_service.files.trc import write_trc
from scaling_service.model.builtin import load_builtin
from scaling_service.model.poses import pose_segments
from scaling_service.model.trial import Trial
from tests.jobs.laboratory import document, write_subject

MODEL = "lower_limb_feet_18dof"
LEGS = ("hip_adduction", "knee_angle", "ankle_angle")
FRAMES = 120


def move() -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Steps on the spot, and where joint centres are in them: the origins of the segments below."""
    model = load_builtin(MODEL)
    q = np.tile([c.default for c in model.coordinates], (FRAMES, 1))
    phase = np.linspace(0.0, 4.0 * np.pi, FRAMES)
    for side, late in (("r", 0.0), ("l", np.pi)):
        lifted = 0.5 * (1.0 - np.cos(phase + late))
        q[:, model.coordinate_names.index(f"hip_flexion_{side}")] += np.radians(40.0) * lifted
        q[:, model.coordinate_names.index(f"knee_angle_{side}")] -= np.radians(70.0) * lifted
    posed = pose_segments(model, q)
    centres, row = {}, model.segment_names.index
    for side in "rl":
        for name, body in (("Hip", "femur"), ("Knee", "tibia"), ("Ankle", "calcn")):
            centres[f"{side.upper()}{name}"] = posed[:, row(f"{body}_{side}"), :3]
        foot = row(f"calcn_{side}")
        turn = Rotation.from_quat(posed[:, foot, 3:])
        for name, marker, before in (
            ("Heel", "HEE", 0.0),
            ("BigToe", "MT1", 0.055),
            ("SmallToe", "MT5", 0.045),
        ):
            at = np.add(model.marker(f"{side.upper()}{marker}").nominal, (before, 0.0, 0.0))
            centres[f"{side.upper()}{name}"] = posed[:, foot, :3] + turn.apply(at)
    for name, up in (("Neck", 0.5), ("Nose", 0.65), ("Head", 0.8)):
        centres[name] = posed[:, row("pelvis"), :3] + [0.0, up, 0.0]
    for side, across in (("R", 0.2), ("L", -0.2)):
        for name, up in (("Shoulder", 0.45), ("Elbow", 0.2), ("Wrist", -0.05)):
            centres[f"{side}{name}"] = posed[:, row("pelvis"), :3] + [0.0, up, across]
    return q, centres


def write(path: Path, centres: dict[str, np.ndarray], noise_m: float = 0.0, factor: float = 1.0) -> Path:
    markers = factor * np.stack(list(centres.values()), axis=1)
    markers = markers + np.random.default_rng(3).normal(0.0, noise_m, markers.shape)
    times = np.arange(FRAMES) / 60.0
    write_trc(
        path, Trial(name=path.stem, times=times, labels=tuple(centres), markers=markers, rate_hz=60.0), "m"
    )
    return path


def test_joints_are_followed_with_their_deviations(tmp_path: Path) -> None:
    q, centres = move()
    for noise_m, most_deg in ((0.0, 4.0), (0.02, 12.0)):
        tracked = ik(MODEL, [write(tmp_path / "steps.trc", centres, noise_m)])
        (found,) = tracked.trials.values()
        names = [f"{name}_{side}" for name in LEGS for side in "rl"]
        own = [found.motion.coordinates.index(name) for name in names]
        error, sd = found.motion.q[:, own] - q[:, own], found.uncertainty.sd[:, own]
        assert np.degrees(np.abs(error)).max() < most_deg
        assert (np.abs(error) < 1.96 * sd).mean() > 0.9
        assert 2.0 < np.degrees(np.median(sd)) < 12.0
        assert not {"pelvis_tilt", "hip_flexion_r"} & set(found.motion.estimated)  # no key point shows them
        assert any(note.code == "key_points" for note in tracked.loaded.session.notes)


def test_lengths_come_from_stature_and_distances(tmp_path: Path) -> None:
    _, centres = move()
    generic = np.median(np.linalg.norm(centres["RHip"] - centres["RKnee"], axis=1))
    write(tmp_path / "steps.trc", centres, factor=1.08)
    content = document(model=MODEL, trials={"calibration": ["steps.trc"]})
    results = compare(write_subject(tmp_path, content))
    assert list(results.scalings) == ["MB"]
    femur = results.lengths.to_frame().set_index("segment")["length_mm"]["femur_r"]
    assert 1e3 * generic < femur < 1.08e3 * generic  # between persons of this stature and what is seen
    with pytest.raises(TrialUnusable, match="fitted to markers on skin"):
        scale(write_subject(tmp_path, content), "MB_am")


def test_a_look_says_which_analyses_need_markers(tmp_path: Path) -> None:
    write(tmp_path / "steps.trc", move()[1])
    found = prove(
        tmp_path, {"subject": {"id": "S01", "sex": "F", "height_m": 1.7}, "model": MODEL}, tmp_path / "out"
    )
    ready = {entry.analysis: entry.ready for entry in found.readiness}
    assert ready["comparisons"]
    assert not ready["discoveries"]


def test_landmarks_beside_them_make_them_no_set(tmp_path: Path) -> None:
    """Markers of the model are followed as markers, and nothing is added."""
    _, centres = move()
    path = write(tmp_path / "steps.trc", {"RKnee": centres["RKnee"], "LKnee": centres["LKnee"]})
    with pytest.raises(TrialUnusable):
        ik(MODEL, [path])
