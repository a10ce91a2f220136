"""Anatomical frames and joint angles, against the built-in model whose frames they define."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from scaling_service.model.anatomy.frames import (
    Frames,
    build_femur_frame,
    build_pelvis_frame,
    build_tibia_frame,
    compute_hip_angles,
    compute_knee_angles,
    compute_pelvis_angles,
    decompose_cardan,
)
from scaling_service.model.builtin import load_builtin
from scaling_service.model.poses import pose_neutral_frames, pose_neutral_markers

TORSION = np.radians(15.0)  # of the malleoli in the built-in model
angle = st.floats(-1.2, 1.2)


def points(values: dict[str, float] | None = None) -> dict[str, np.ndarray]:
    """Markers and joint centres of the built-in lower limbs in a posture, each (1, 3)."""
    model = load_builtin("lower_limb_14dof")
    frames = pose_neutral_frames(model, values)
    centres = {
        f"{joint}_{side}": frames[f"{bone}_{side}"][1]
        for side in "rl"
        for joint, bone in (("hip", "femur"), ("knee", "tibia"))
    }
    return {name: p[None] for name, p in (pose_neutral_markers(model, values) | centres).items()}


def pelvis(at: dict[str, np.ndarray]) -> Frames:
    return build_pelvis_frame(at["RASIS"], at["LASIS"], at["RPSIS"], at["LPSIS"])


def femur(at: dict[str, np.ndarray], side: str) -> Frames:
    s = side.upper()
    return build_femur_frame(at[f"hip_{side}"], at[f"{s}LFE"], at[f"{s}MFE"], side)


def tibia(at: dict[str, np.ndarray], side: str) -> Frames:
    s = side.upper()
    return build_tibia_frame(at[f"knee_{side}"], at[f"{s}AJC"], at[f"{s}LM"], at[f"{s}MM"], side)


posture = st.fixed_dictionaries(dict.fromkeys(load_builtin("lower_limb_14dof").coordinate_names, angle))


@settings(max_examples=25)
@given(posture)
def test_markers_give_back_the_segments_frames(values: dict[str, float]) -> None:
    at, truth = points(values), pose_neutral_frames(load_builtin("lower_limb_14dof"), values)
    for found, name in ((pelvis(at), "pelvis"), (femur(at, "r"), "femur_r"), (femur(at, "l"), "femur_l")):
        np.testing.assert_allclose(found.rotation[0], truth[name][0], atol=1e-12)
        np.testing.assert_allclose(found.origin[0], truth[name][1], atol=1e-12)


@settings(max_examples=25)
@given(posture)
def test_angles_are_the_models_coordinates(values: dict[str, float]) -> None:
    at = points(values)
    root = [values[f"pelvis_{name}"] for name in ("rotation", "list", "tilt")]
    np.testing.assert_allclose(compute_pelvis_angles(pelvis(at))[0], root, atol=1e-9)
    for side in "rl":
        hip = [values[f"hip_{name}_{side}"] for name in ("flexion", "adduction", "rotation")]
        np.testing.assert_allclose(compute_hip_angles(pelvis(at), femur(at, side), side)[0], hip, atol=1e-9)


@pytest.mark.parametrize("side", ["r", "l"])
@pytest.mark.parametrize("flexion", [0.0, 0.4, 1.3])
def test_knee_flexion_is_the_models_and_torsion_shows_as_rotation(side: str, flexion: float) -> None:
    """The malleoli are turned outward, so the shank's own frame is rotated externally by the torsion."""
    at = points({f"knee_angle_{side}": flexion})
    found = compute_knee_angles(femur(at, side), tibia(at, side), side)[0]
    np.testing.assert_allclose(
        found, [flexion, 0.0, -TORSION], atol=2e-3
    )  # model: .011 / .041 = tan 15.02 deg


def test_frames_are_right_handed_and_look_forward() -> None:
    at = points()
    for found in (pelvis(at), *(f(at, side) for f in (femur, tibia) for side in "rl")):
        assert np.linalg.det(found.rotation[0]) == pytest.approx(1.0)
        assert (np.diag(found.rotation[0]) > 0.9).all()


def test_rigid_motion_changes_no_angle() -> None:
    at = points({"hip_flexion_r": 0.5, "hip_rotation_r": -0.3, "knee_angle_r": 0.9})
    turns, shift = Rotation.random(6, random_state=5), np.random.default_rng(2).normal(size=(6, 3))
    moved = {name: turns.apply(p[0]) + shift for name, p in at.items()}
    for angles in (
        lambda a: compute_hip_angles(pelvis(a), femur(a, "r"), "r"),
        lambda a: compute_knee_angles(femur(a, "r"), tibia(a, "r"), "r"),
    ):
        np.testing.assert_allclose(angles(moved), np.repeat(angles(at), 6, axis=0), atol=1e-12)
    np.testing.assert_allclose(pelvis(moved).rotation, turns.as_matrix() @ pelvis(at).rotation, atol=1e-12)


def test_mirror_image_has_equal_angles_on_the_other_side() -> None:
    at = points(
        {
            "hip_flexion_r": 0.4,
            "hip_adduction_r": 0.2,
            "hip_rotation_r": 0.3,
            "knee_angle_r": 0.7,
            "pelvis_tilt": -0.2,
        }
    )
    swap = {"R": "L", "L": "R"}
    mirrored = {
        (swap[name[0]] + name[1:] if name[0] in swap else f"{name[:-1]}{swap[name[-1].upper()].lower()}"): p
        * [1, 1, -1]
        for name, p in at.items()
    }
    np.testing.assert_allclose(
        compute_hip_angles(pelvis(mirrored), femur(mirrored, "l"), "l"),
        compute_hip_angles(pelvis(at), femur(at, "r"), "r"),
        atol=1e-12,
    )
    np.testing.assert_allclose(
        compute_knee_angles(femur(mirrored, "l"), tibia(mirrored, "l"), "l"),
        compute_knee_angles(femur(at, "r"), tibia(at, "r"), "r"),
        atol=1e-12,
    )


@given(angle, angle, angle)
def test_cardan_against_scipy(a: float, b: float, c: float) -> None:
    distal = Rotation.from_euler("ZXY", [a, b, c]).as_matrix()[None]
    ground = Frames(np.eye(3)[None], np.zeros((1, 3)))
    np.testing.assert_allclose(
        decompose_cardan(ground, Frames(distal, np.zeros((1, 3))))[0], [a, b, c], atol=1e-12
    )


def test_missing_or_collinear_landmarks_give_nan_in_that_frame_only() -> None:
    at = {name: np.repeat(p, 3, axis=0) for name, p in points().items()}
    at["RLFE"][0] = np.nan
    at["RMFE"][2] = at["RLFE"][2]  # no direction across
    found = femur(at, "r")
    assert np.isnan(found.rotation[[0, 2]]).all()
    assert np.isnan(found.origin[[0, 2]]).all()
    assert np.isfinite(found.rotation[1]).all()


def test_to_local_undoes_to_ground() -> None:
    found, local = femur(points({"hip_flexion_r": 0.6}), "r"), np.array([[0.1, -0.2, 0.3]])
    np.testing.assert_allclose(found.to_local(found.to_ground(local)), local, atol=1e-12)
    np.testing.assert_allclose(found.to_ground([0.1, -0.2, 0.3]), found.to_ground(local), atol=0)
