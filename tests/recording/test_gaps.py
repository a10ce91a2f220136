"""Gaps: exact on rigid bodies, honest about what stays open, close on gaps cut out of real recordings."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from scaling_service.model.trial import Trial
from scaling_service.recording.pipeline import average_shape, fill

LABELS = ("A", "B", "C", "D", "E")
CLUSTERS = {"femur_r": ("A", "B", "C", "D", "E")}


def _rigid(frames=200, seed=0):
    """Five markers on a rigid body that turns and travels smoothly."""
    rng = np.random.default_rng(seed)
    t = np.arange(frames) / 100
    local = rng.uniform(-0.2, 0.2, (5, 3))
    turn = Rotation.from_rotvec(np.stack((np.sin(3 * t), 0.5 * np.cos(2 * t), t), axis=1)).as_matrix()
    shift = np.stack((t, 1 + 0.1 * np.sin(9 * t), 0 * t), axis=1)
    markers = np.einsum("fij,mj->fmi", turn, local) + shift[:, None]
    return Trial(name="walk", times=t, labels=LABELS, markers=markers, rate_hz=100.0)


def _holed(trial, *holes):
    markers = trial.markers.copy()
    for label, start, stop in holes:
        markers[start:stop, trial.index(label)] = np.nan
    return trial.with_markers(markers)


def _noted(trial):
    return [(r.what, r.where, r.frames) for r in trial.repairs]


def test_long_gaps_of_a_rigid_body_are_filled_exactly():
    trial = _rigid()
    holed = _holed(trial, ("A", 50, 120), ("B", 0, 40), ("C", 160, 200))
    result = fill(holed, CLUSTERS)
    np.testing.assert_allclose(result.markers, trial.markers, atol=1e-9)
    assert _noted(result) == [
        ("gap_solidification", "A", 70),
        ("gap_solidification", "B", 40),
        ("gap_solidification", "C", 40),
    ]
    assert "right femur" in result.repairs[0].detail


def test_short_gaps_take_the_spline_up_to_its_limit():
    trial = _rigid()
    result = fill(_holed(trial, ("A", 50, 65), ("B", 50, 66)), {})
    filled = result.markers[50:65, 0]
    assert 0 < np.abs(filled - trial.markers[50:65, 0]).max() < 2e-3
    assert _noted(result) == [("gap_spline", "A", 15), ("gap_left", "B", 16)]
    assert np.isnan(result.markers[50:66, 1]).all()


@given(st.floats(30, 500))
@settings(max_examples=20)
def test_the_limit_is_in_seconds(rate):
    longest = int(np.floor(0.15 * rate + 1e-6))
    trial = _rigid()
    trial = Trial(name="t", times=np.arange(200) / rate, labels=LABELS, markers=trial.markers, rate_hz=rate)
    result = fill(_holed(trial, ("A", 50, 50 + longest), ("B", 50, 51 + longest)), {})
    assert _noted(result) == [("gap_spline", "A", longest), ("gap_left", "B", longest + 1)]


def test_too_few_others_leave_the_gap():
    trial = _rigid()
    holed = _holed(trial, ("A", 50, 120), ("B", 90, 200), ("C", 90, 200))
    result = fill(holed, CLUSTERS)
    np.testing.assert_array_equal(
        np.isnan(result.markers[:, 0, 0]), (trial.times >= 0.895) & (trial.times < 1.195)
    )
    assert ("gap_left", "A", 30) in _noted(result)


def test_too_few_common_frames_leave_the_gap():
    for seen, kind in ((9, "gap_left"), (10, "gap_solidification")):
        holed = _holed(_rigid(), ("A", seen, 200))
        assert _noted(fill(holed, CLUSTERS)) == [(kind, "A", 200 - seen)]


def test_markers_on_a_line_do_not_carry_another():
    trial = _rigid()
    markers = trial.markers.copy()
    markers[:, 3] = 0.5 * (markers[:, 1] + markers[:, 2])
    holed = _holed(trial.with_markers(markers), ("A", 50, 120), ("E", 0, 200))
    assert ("gap_left", "A", 70) in _noted(fill(holed, CLUSTERS))


def test_never_seen_markers_and_unknown_labels_stay():
    trial = _rigid()
    result = fill(_holed(trial, ("E", 0, 200)), {"femur_r": (*LABELS, "absent"), "tibia_r": ("nothing",)})
    assert np.isnan(result.markers[:, 4]).all()
    assert _noted(result) == [("gap_left", "E", 200)]


def test_a_whole_trial_is_returned_as_it_is():
    trial = _rigid()
    result = fill(trial, CLUSTERS)
    np.testing.assert_array_equal(result.markers, trial.markers)
    assert result.repairs == ()


def test_a_marker_of_two_segments_is_filled_once():
    trial = _holed(_rigid(), ("A", 50, 120))
    result = fill(trial, {"femur_r": LABELS, "tibia_r": LABELS})
    assert _noted(result) == [("gap_solidification", "A", 70)]


def test_no_step_is_left_where_the_marker_comes_back():
    trial = _rigid()
    markers = trial.markers.copy()
    drift = 0.02 * np.sin(2 * np.pi * trial.times[:, None] / 4)  # m: skin that moves against the others
    markers[:, 0] += drift * [1, 0, 0]
    result = fill(_holed(trial.with_markers(markers), ("A", 50, 120)), CLUSTERS)
    step = np.linalg.norm(np.diff(result.markers[:, 0] - markers[:, 0], axis=0), axis=1)
    assert step.max() < 1e-3


@given(st.integers(0, 500))
@settings(max_examples=15)
def test_mean_shape_of_a_rigid_cluster_with_holes_is_the_cluster(seed):
    trial = _rigid(60, seed)
    markers = trial.markers.copy()
    rng = np.random.default_rng(seed)
    for frame in range(60):
        markers[frame, rng.choice(5, size=rng.integers(0, 3), replace=False)] = np.nan
    shape = average_shape(markers)
    distances = np.linalg.norm(shape[:, None] - shape, axis=-1)
    np.testing.assert_allclose(
        distances, np.linalg.norm(trial.markers[0][:, None] - trial.markers[0], axis=-1), atol=1e-5
    )


@pytest.mark.parametrize("length", [20, 50])
def test_gaps_cut_out_of_a_real_recording(shared_data, length):
    from scaling_service.files.trc import read_trc

    trial = read_trc(shared_data / "opencap_squat/squats1.trc")
    cluster = {"femur_r": ("r_thigh1", "r_thigh2", "r_thigh3", "r_knee")}
    errors = []
    for label in cluster["femur_r"]:
        for start in range(100, 1200, 250):
            result = fill(_holed(trial, (label, start, start + length)), cluster)
            gap = slice(start, start + length)
            errors.append(result.position(label)[gap] - trial.position(label)[gap])
    rms = np.sqrt((np.concatenate(errors) ** 2).sum(-1).mean())
    assert rms < 5e-3  # m: soft tissue moves a thigh cluster by this much in squats
