"""Inverse kinematics of trials: truth recovered, gaps, outliers, bounds, starts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scaling_service.capabilities.motion.inverse_kinematics import Task, inverse_kinematics, solve_task
from scaling_service.core.errors import TrialUnusable
from scaling_service.model.body import BodyModel, Joint, Law, Marker
from scaling_service.model.builtin import load_builtin
from scaling_service.model.compile import compile_model, list_parameter_values, repeat_default_pose
from scaling_service.model.trial import Trial
from scaling_service.numerics.least_squares.problem import Huber
from scaling_service.numerics.multibody.tree import pose_markers
from tests.numerics.bodies import Array

RATE = 100.0


def legs() -> BodyModel:
    """The built-in legs without their landmarks."""
    model = load_builtin("lower_limb_14dof")
    return model.with_markers(tuple(m for m in model.markers if m.weight > 0.0))


def motion(model: BodyModel, n: int, seed: int = 0, size: float = 1.0) -> Array:
    """A smooth motion in which every coordinate moves; knees stay bent, the body turns by a right angle."""
    rng = np.random.default_rng(seed)
    t = np.arange(n)[:, None] / RATE
    q = repeat_default_pose(model, n)
    width = np.array([0.5 if c.kind == "rotation" else 0.2 for c in model.coordinates]) * size
    q += width * np.sin(2 * np.pi * rng.uniform(0.3, 0.9, len(width)) * t + rng.uniform(0, 6.28, len(width)))
    for name in ("knee_angle_r", "knee_angle_l"):
        q[:, model.coordinate_names.index(name)] += 0.6
    q[:, model.coordinate_names.index("pelvis_rotation")] += 1.57
    return q


def recorded(model: BodyModel, q: Array, noise: float = 0.0, seed: int = 1) -> Trial:
    markers = pose_markers(compile_model(model), q, list_parameter_values(model))
    markers = markers + np.random.default_rng(seed).normal(0.0, noise, markers.shape)
    return Trial(
        name="made", times=np.arange(len(q)) / RATE, labels=model.marker_names, markers=markers, rate_hz=RATE
    )


def changed(trial: Trial, markers: Array) -> Trial:
    return replace(trial, markers=markers)


@pytest.mark.parametrize("n", [1, 2, 5, 47, 48, 49, 300])
def test_a_made_motion_is_recovered_whatever_its_length(n: int) -> None:
    model = legs()
    q = motion(model, n)
    found = inverse_kinematics(model, recorded(model, q))
    np.testing.assert_allclose(found.q, q, rtol=0, atol=1e-6)
    assert found.distances.max() < 1e-7
    assert found.estimated == model.coordinate_names
    assert found.coordinates == model.coordinate_names


@pytest.mark.parametrize("heading", np.linspace(-3.0, 3.1, 7))
def test_the_heading_does_not_matter(heading: float) -> None:
    model, q = (m := legs()), motion(m, 60)
    trial = recorded(model, q)
    turn = Rotation.from_euler("y", heading)
    moved = trial.markers @ turn.as_matrix().T + [10.0, 0.0, -5.0]
    found = inverse_kinematics(model, changed(trial, moved))
    here = [k for k, c in enumerate(model.coordinate_names) if not c.startswith(("pelvis_t", "pelvis_rot"))]
    tilt = model.coordinate_names.index("pelvis_tilt")
    np.testing.assert_allclose(found.q[:, [*here, tilt]], q[:, [*here, tilt]], rtol=0, atol=1e-6)


def test_with_noise_the_residuals_are_the_noise() -> None:
    model = legs()
    q = motion(model, 400)
    found = inverse_kinematics(model, recorded(model, q, noise=0.001))
    free = 14 * 3 - 14
    assert np.sqrt((found.residuals**2).sum() / (400 * free)) == pytest.approx(0.001, rel=0.03)


def test_labels_may_be_in_any_order_and_others_are_ignored() -> None:
    model = legs()
    trial = recorded(model, motion(model, 60))
    other = trial.select(("nose", *reversed(trial.labels)))
    np.testing.assert_allclose(
        inverse_kinematics(model, other).q, inverse_kinematics(model, trial).q, rtol=0, atol=1e-12
    )
    assert inverse_kinematics(model, other).markers == model.marker_names


def test_landmarks_of_weight_zero_are_not_compared() -> None:
    model = load_builtin("lower_limb_14dof")
    trial = recorded(model, motion(model, 50))
    assert "RAJC" in trial.labels
    assert "RAJC" not in inverse_kinematics(model, trial).markers
    assert "RASIS" not in inverse_kinematics(model, trial, weights={"RASIS": 0.0}).markers


def test_weights_decide_who_is_followed() -> None:
    model = legs()
    trial = recorded(model, motion(model, 60), noise=0.01)
    column = trial.index("RLM")
    plain, heavy = (inverse_kinematics(model, trial, weights=w).distances for w in ({}, {"RLM": 100.0}))
    assert heavy[:, column].mean() < 0.3 * plain[:, column].mean()


def test_no_marker_in_common_is_an_error_that_says_what_to_do() -> None:
    model = legs()
    trial = recorded(model, motion(model, 3)).relabel({name: f"x{name}" for name in model.marker_names})
    with pytest.raises(TrialUnusable) as caught:
        inverse_kinematics(model, trial)
    assert caught.value.file == "made"
    assert "markers" in str(caught.value)
    assert caught.value.remedy is not None


def test_a_leg_that_is_never_seen_stands_at_its_default() -> None:
    model = legs()
    q = motion(model, 80)
    trial = recorded(model, q)
    right = trial.select(
        [name for name in trial.labels if name in ("RPSIS", "LPSIS", "LASIS") or name[0] == "R"]
    )
    found = inverse_kinematics(model, right)
    left = [k for k, name in enumerate(model.coordinate_names) if name.endswith("_l")]
    assert not set(found.estimated) & {model.coordinate_names[k] for k in left}
    np.testing.assert_array_equal(found.q[:, left], repeat_default_pose(model, 80)[:, left])
    others = [k for k in range(14) if k not in left]
    np.testing.assert_allclose(found.q[:, others], q[:, others], rtol=0, atol=1e-6)


def test_frames_that_show_too_little_are_nan_there_and_right_elsewhere() -> None:
    model = legs()
    q = motion(model, 120)
    trial = recorded(model, q)
    markers = trial.markers.copy()
    shank = [trial.index(name) for name in ("RFH", "RLM", "RMM")]
    markers[30:40, shank] = np.nan
    markers[60:63] = np.nan
    found = inverse_kinematics(model, changed(trial, markers))
    knee = model.coordinate_names.index("knee_angle_r")
    assert np.isnan(found.q[30:40, knee]).all()
    assert np.isnan(found.q[60:63]).all()
    known = np.isfinite(found.q)
    assert known.sum() == known.size - 10 - 3 * 14
    np.testing.assert_allclose(found.q[known], q[known], rtol=0, atol=1e-6)
    assert np.isnan(found.residuals[30:40][:, shank]).all()


def test_one_missing_marker_costs_nothing() -> None:
    model = legs()
    q = motion(model, 120)
    trial = recorded(model, q)
    markers = trial.markers.copy()
    markers[20:90, trial.index("RASIS")] = np.nan
    markers[50:70, trial.index("LMFE")] = np.nan
    found = inverse_kinematics(model, changed(trial, markers))
    np.testing.assert_allclose(found.q, q, rtol=0, atol=1e-6)


def test_a_robust_loss_resists_a_flying_marker() -> None:
    model = legs()
    q = motion(model, 60)
    trial = recorded(model, q, noise=0.001)
    markers = trial.markers.copy()
    markers[20:40, trial.index("RLM")] += 0.2
    wild = changed(trial, markers)
    knee = [model.coordinate_names.index(n) for n in ("knee_angle_r", "hip_flexion_r", "hip_rotation_r")]
    plain, robust = (
        np.abs(inverse_kinematics(model, wild, **how).q - q)[20:40][:, knee].max()
        for how in ({}, {"loss": Huber(0.005)})
    )
    assert robust < 0.2 * plain


def test_clamped_coordinates_keep_to_their_range_only_if_asked() -> None:
    model = legs()
    clamp = {"knee_angle_r": (0.0, 0.7)}
    coordinates = tuple(
        replace(c, lower=clamp[c.name][0], upper=clamp[c.name][1], clamped=True) if c.name in clamp else c
        for c in model.coordinates
    )
    narrow = replace(model, coordinates=coordinates)
    q = motion(model, 60)
    trial = recorded(model, q)
    knee = model.coordinate_names.index("knee_angle_r")
    assert q[:, knee].max() > 0.8
    assert inverse_kinematics(narrow, trial).q[:, knee].max() == pytest.approx(0.7)
    np.testing.assert_allclose(inverse_kinematics(narrow, trial, bounded=False).q, q, rtol=0, atol=1e-6)


def test_locked_coordinates_stay_at_their_default_and_are_not_called_estimated() -> None:
    model = legs()
    coordinates = tuple(
        replace(c, default=0.3, locked=True) if c.name == "hip_rotation_l" else c for c in model.coordinates
    )
    found = inverse_kinematics(replace(model, coordinates=coordinates), recorded(model, motion(model, 60)))
    np.testing.assert_allclose(found.q[:, model.coordinate_names.index("hip_rotation_l")], 0.3, rtol=1e-15)
    assert "hip_rotation_l" not in found.estimated


def test_a_given_start_is_used() -> None:
    model = legs()
    q = motion(model, 120)
    found = inverse_kinematics(model, recorded(model, q), start=q + 1e-4)
    np.testing.assert_allclose(found.q, q, rtol=0, atol=1e-6)
    assert found.iterations <= 3


def test_irregular_times_are_solved_frame_by_frame() -> None:
    model = legs()
    q = motion(model, 90)
    trial = recorded(model, q)
    times = np.sort(np.random.default_rng(0).uniform(0.0, 1.0, 90)).cumsum()
    found = inverse_kinematics(model, replace(trial, times=times))
    np.testing.assert_allclose(found.q, q, rtol=0, atol=1e-6)


def test_progress_reaches_every_frame() -> None:
    model, reported = legs(), []
    inverse_kinematics(model, recorded(model, motion(model, 300)), progress=reported.append)
    assert reported[-1] == 300


def test_a_model_without_markers_asks_for_them() -> None:
    model = legs()
    with pytest.raises(TrialUnusable, match=r"no markers.*marker_set"):
        Task.of(model.with_markers(()), recorded(model, motion(model, 3)))


def test_the_general_estimator_and_the_sweeps_agree() -> None:
    model = legs()
    trial = recorded(model, motion(model, 60), noise=0.003)
    task = Task.of(model, trial)
    dense = solve_task(replace(task, loss=Huber(10.0)), trial.times)  # never reaches its linear part
    sweeps = solve_task(task, trial.times)
    np.testing.assert_allclose(dense.cost, sweeps.cost, rtol=1e-5)
    np.testing.assert_allclose(dense.q, sweeps.q, rtol=0, atol=1e-4)


def test_a_coordinate_that_enters_two_joints_is_solved_too() -> None:
    """A knee that bends a little with the hip."""
    model = legs()
    shank = model.segment("tibia_r")
    follower = Joint("rotation", (0.0, 0.0, 1.0), Law.of("hip_flexion_r", 0.2))
    with_more = replace(shank, joints=(*shank.joints, follower))
    segments = tuple(with_more if s.name == "tibia_r" else s for s in model.segments)
    model = replace(model, segments=segments)
    q = motion(model, 60)
    found = inverse_kinematics(model, recorded(model, q))
    np.testing.assert_allclose(found.q, q, rtol=0, atol=1e-4)


def test_a_frame_in_a_wrong_minimum_is_freed_by_its_neighbours() -> None:
    """Deep knee bends at a run: far from the neutral pose that every frame starts from."""
    model = legs()
    q = motion(model, 200, size=1.6)
    for name in ("hip_flexion_r", "hip_flexion_l"):
        q[:, model.coordinate_names.index(name)] += 0.7
    found = inverse_kinematics(model, recorded(model, q))
    assert found.distances.max() < 1e-6


def test_three_markers_on_one_segment_place_a_free_body() -> None:
    root = legs().segments[0]
    markers = tuple(
        Marker.at(f"m{k}", "pelvis", at) for k, at in enumerate([(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0)])
    )
    free = BodyModel(name="one", segments=(root,), coordinates=legs().coordinates[:6], markers=markers)
    q = motion(legs(), 20)[:, :6]
    np.testing.assert_allclose(inverse_kinematics(free, recorded(free, q)).q, q, rtol=0, atol=1e-6)
