"""The rigid fit and the rotation formulas against closed forms, scipy's rotations and invariants."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from scaling_service.numerics.multibody.rigid import (
    build_skew,
    convert_rotation_to_vector,
    convert_vector_to_rotation,
    find_nearest_rotation,
    fit_rigid,
    rotate_about,
)


def _case(seed, frames=5, m=6):
    rng = np.random.default_rng(seed)
    local = rng.normal(size=(m, 3))
    rotation = Rotation.random(frames, random_state=seed).as_matrix()
    shift = rng.normal(size=(frames, 3))
    return rng, local, rotation, shift, np.einsum("fij,mj->fmi", rotation, local) + shift[:, None]


@given(st.integers(0, 10_000))
@settings(max_examples=25)
def test_exact_motion_is_recovered_with_missing_markers(seed):
    rng, local, rotation, shift, measured = _case(seed)
    measured[rng.random(measured.shape[:2]) < 0.3] = np.nan
    R, t = fit_rigid(local, measured)
    solvable = np.isfinite(measured).all(-1).sum(-1) >= 3
    assert np.isnan(R[~solvable]).all()
    assert np.isnan(t[~solvable]).all()
    np.testing.assert_allclose(R[solvable], rotation[solvable], atol=1e-9)
    np.testing.assert_allclose(t[solvable], shift[solvable], atol=1e-9)


def test_batch_equals_single_calls():
    rng, local, _, _, measured = _case(3, frames=4)
    measured += rng.normal(size=measured.shape) * 0.1
    weights = rng.random(len(local)) + 0.1
    R, t = fit_rigid(local, measured, weights)
    for k in range(4):
        single_R, single_t = fit_rigid(local, measured[k], weights)
        np.testing.assert_allclose(R[k], single_R, atol=1e-14)
        np.testing.assert_allclose(t[k], single_t, atol=1e-14)
    nested_R, _ = fit_rigid(local, measured.reshape(2, 2, *measured.shape[1:]), weights)
    np.testing.assert_array_equal(nested_R.reshape(R.shape), R)


def test_weighted_fit_agrees_with_scipy():
    rng, local, _, _, measured = _case(11, frames=1)
    measured = measured[0] + rng.normal(size=local.shape) * 0.2
    weights = rng.random(len(local)) + 0.1
    R, t = fit_rigid(local, measured, weights)
    x, y = (p - np.average(p, axis=0, weights=weights) for p in (local, measured))
    expected = Rotation.align_vectors(y, x, weights=weights)[0].as_matrix()
    np.testing.assert_allclose(R, expected, atol=1e-10)
    residual = np.average(measured - local @ R.T - t, axis=0, weights=weights)
    np.testing.assert_allclose(residual, 0, atol=1e-12)


def test_a_mirrored_cloud_still_gives_a_proper_rotation():
    _, local, _, _, _ = _case(5)
    R, _ = fit_rigid(local, local * [1, 1, -1])
    assert np.linalg.det(R) == pytest.approx(1)


def test_a_plane_of_three_points_is_enough_and_a_line_is_not():
    plane = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    turn = rotate_about([0, 0, 1], 0.4)
    R, _ = fit_rigid(plane, plane @ turn.T)
    np.testing.assert_allclose(R, turn, atol=1e-12)
    line = np.array([[0.0, 0, 0], [1, 1, 0], [2, 2, 0], [3, 3, 0]])
    assert np.isnan(fit_rigid(line, line)[0]).all()
    assert np.isnan(fit_rigid(plane, line[:3])[0]).all()
    assert np.isnan(fit_rigid(np.zeros((4, 3)), np.zeros((4, 3)))[0]).all()


def test_a_point_of_weight_zero_does_not_count():
    _, local, _, _, measured = _case(7, frames=1)
    spoiled = measured[0].copy()
    spoiled[2] += 5
    weights = np.ones(len(local))
    weights[2] = 0
    np.testing.assert_allclose(
        fit_rigid(local, spoiled, weights)[0], fit_rigid(local, measured[0])[0], atol=1e-12
    )
    weights[:] = 0
    weights[:2] = 1
    assert np.isnan(fit_rigid(local, spoiled, weights)[0]).all()


def test_wrong_input_is_refused():
    with pytest.raises(ValueError, match="shape"):
        fit_rigid(np.zeros((3, 2)), np.zeros((3, 2)))
    with pytest.raises(ValueError, match="negative"):
        fit_rigid(np.eye(3), np.eye(3), [-1, 1, 1])


@given(
    st.lists(st.floats(-1, 1), min_size=3, max_size=3).filter(lambda v: np.linalg.norm(v) > 1e-3),
    st.sampled_from([0.0, 1e-12, 1e-7, 1e-5, 2e-4, 0.3, 2.0, np.pi - 1e-3, np.pi - 1e-7, np.pi]),
)
@settings(max_examples=100)
def test_vector_and_matrix_agree_with_scipy_and_each_other(axis, angle):
    v = angle * np.array(axis) / np.linalg.norm(axis)
    R = convert_vector_to_rotation(v)
    np.testing.assert_allclose(R, Rotation.from_rotvec(v).as_matrix(), atol=1e-14)
    back = convert_rotation_to_vector(R)
    # At pi the two opposite vectors are the same rotation; rounding may give either one.
    close = min(np.linalg.norm(back - v), np.linalg.norm(back + v) if angle > 3 else np.inf)
    assert close < 1e-7 if angle == np.pi else close < 1e-9


def test_small_angles_keep_their_digits():
    v = np.array([1e-9, -2e-9, 3e-9])
    np.testing.assert_allclose(convert_rotation_to_vector(convert_vector_to_rotation(v)), v, rtol=1e-6)


def test_vector_of_a_missing_rotation_is_missing():
    R = np.stack((np.eye(3), np.full((3, 3), np.nan)))
    back = convert_rotation_to_vector(R)
    assert (back[0] == 0).all()
    assert np.isnan(back[1]).all()


def test_skew_is_the_cross_product_and_nearest_rotation_undoes_scaling():
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 4, 3))
    np.testing.assert_allclose(np.einsum("fij,fj->fi", build_skew(a), b), np.cross(a, b))
    R = Rotation.random(4, random_state=1).as_matrix()
    np.testing.assert_allclose(find_nearest_rotation(3.7 * R), R, atol=1e-12)
