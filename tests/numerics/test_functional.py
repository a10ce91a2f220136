"""SCoRE and SARA: exact on known joints, and under noise as accurate as published."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from scaling_service.numerics.multibody.functional import (
    Poses,
    find_rotation_axis,
    find_rotation_centre,
    measure_ranges_of_motion,
)
from scaling_service.numerics.multibody.rigid import fit_rigid

CENTRE = np.array([0.02, -0.09, 0.08])
"""In the proximal segment, m: about where a hip lies in the pelvis."""
DISTAL_CENTRE = np.array([-0.01, 0.4, 0.03])
AXIS = np.array([0.05, -0.08, 1.0]) / np.linalg.norm([0.05, -0.08, 1.0])
NOISE_M = 1e-3
"""Ehrig et al. 2006 and 2007: independent Gaussian noise of 0.1 cm on every marker."""


def wandering(n: int, rng: np.random.Generator, size: float = 0.5) -> Poses:
    """A segment that moves and turns at will."""
    times = np.linspace(0.0, 2.0 * np.pi, n)[:, None]
    vectors = size * np.sin(times * rng.uniform(0.5, 2.0, 3) + rng.uniform(0.0, 6.0, 3))
    return Poses(Rotation.from_rotvec(vectors).as_matrix(), np.cumsum(rng.normal(0.0, 0.01, (n, 3)), axis=0))


def joined(first: Poses, relative: np.ndarray) -> Poses:
    """The distal segment, turned by ``relative`` (n, 3, 3) about the joint."""
    rotation = first.rotation @ relative
    return Poses(rotation, first.place(CENTRE) - rotation @ DISTAL_CENTRE)


def ball(n: int, range_deg: float) -> np.ndarray:
    """A circling along the edge of the cone of that opening, as half of a star-arc movement is."""
    phase = np.linspace(0.0, 6.0 * np.pi, n)
    size = np.deg2rad(range_deg) / 2.0
    return Rotation.from_rotvec(
        size * np.column_stack([np.cos(phase), 0.0 * phase, np.sin(phase)])
    ).as_matrix()


def hinge(n: int, range_deg: float, axis: np.ndarray = AXIS) -> np.ndarray:
    angle = np.deg2rad(range_deg) * np.sin(np.linspace(0.0, 3.0 * np.pi, n)) ** 2
    return Rotation.from_rotvec(angle[:, None] * axis).as_matrix()


def seen(
    poses: Poses, cluster: np.ndarray, rng: np.random.Generator, noise: float = NOISE_M, batch: int = 1
) -> Poses:
    """The poses as a cluster of markers (m, 3) with noise gives them, ``batch`` times."""
    places = np.einsum("nij,mj->nmi", poses.rotation, cluster) + poses.position[:, None]
    noisy = places + rng.normal(0.0, noise, (batch, *places.shape))
    return Poses(*fit_rigid(cluster, noisy))


# Clusters of four markers, a decimetre or two wide, as worn on pelvis and thigh.
PELVIS = np.array([[0.0, 0.0, 0.12], [0.0, 0.0, -0.12], [-0.155, 0.0, 0.04], [-0.155, 0.0, -0.04]])
THIGH = np.array([[0.05, 0.25, 0.06], [0.06, 0.15, -0.02], [0.0, 0.0, 0.05], [0.0, 0.0, -0.05]])


def test_a_ball_joint_is_found_exactly() -> None:
    first = wandering(200, np.random.default_rng(0))
    found = find_rotation_centre(first, joined(first, ball(200, 40.0)))
    np.testing.assert_allclose(found.proximal, CENTRE, atol=1e-13)
    np.testing.assert_allclose(found.distal, DISTAL_CENTRE, atol=1e-13)
    assert found.rms < 1e-14
    assert found.frames == 200


def test_a_hinge_is_found_exactly_and_its_centre_is_free_along_it() -> None:
    first = wandering(150, np.random.default_rng(1))
    second = joined(first, hinge(150, 70.0))
    found = find_rotation_axis(first, second)
    sign = np.sign(found.proximal @ AXIS)
    np.testing.assert_allclose(sign * found.proximal, AXIS, atol=1e-12)
    np.testing.assert_allclose(sign * found.distal, AXIS, atol=1e-12)  # unmoved by a turn about itself
    assert np.linalg.norm(np.cross(found.point_proximal - CENTRE, AXIS)) < 1e-12
    assert max(found.rms, found.spread, found.sharpness) < 1e-7


def test_it_is_the_least_squares_solution() -> None:
    """Against a general solver on noisy poses."""
    rng = np.random.default_rng(2)
    true = wandering(60, rng)
    first, second = seen(true, PELVIS, rng), seen(joined(true, ball(60, 50.0)), THIGH, rng)
    first, second = (Poses(p.rotation[0], p.position[0]) for p in (first, second))
    found = find_rotation_centre(first, second)
    peer = least_squares(
        lambda c: (first.place(c[:3]) - second.place(c[3:])).ravel(), np.zeros(6), xtol=1e-15
    )
    np.testing.assert_allclose(np.append(found.proximal, found.distal), peer.x, atol=1e-9)
    assert found.rms == pytest.approx(np.sqrt(2.0 * peer.cost / 60), rel=1e-9)


def test_centres_are_as_accurate_as_published() -> None:
    """Ehrig 2006, abstract: about 1.2 mm at 20 deg for SCoRE, within 3 mm from 45 deg on for most methods."""
    rng = np.random.default_rng(3)
    true = wandering(200, rng)
    first = seen(true, PELVIS, rng, batch=200)
    rms = {}
    for range_deg in (20.0, 45.0):
        found = find_rotation_centre(first, seen(joined(true, ball(200, range_deg)), THIGH, rng, batch=200))
        errors = np.linalg.norm(found.proximal - CENTRE, axis=-1)
        rms[range_deg] = float(np.sqrt((errors**2).mean()))
        # Independent frames: the stated deviation is the scatter that is seen.
        scatter = np.sqrt(found.proximal.var(axis=0, ddof=1).sum())
        assert found.sd.mean() == pytest.approx(scatter, rel=0.15)
    assert rms[20.0] == pytest.approx(1.2e-3, rel=0.15)
    assert rms[45.0] < 1e-3


def test_axes_are_as_accurate_as_published() -> None:
    """Ehrig 2007, abstract: within 1 mm at 90 deg; here of the point where the axis passes the joint."""
    rng = np.random.default_rng(4)
    true = wandering(200, rng)
    first = seen(true, PELVIS + np.array([0.0, -0.3, 0.0]), rng, batch=200)
    second = seen(joined(true, hinge(200, 90.0)), THIGH + np.array([0.0, 0.35, 0.0]), rng, batch=200)
    found = find_rotation_axis(first, second)
    across = np.linalg.norm(np.cross(CENTRE - found.point_proximal, found.proximal), axis=-1)
    assert np.sqrt((across**2).mean()) < 1e-3
    tilted = np.degrees(np.arccos(np.clip(np.abs(found.proximal @ AXIS), -1.0, 1.0)))
    assert np.sqrt((tilted**2).mean()) < 0.5


def test_a_batch_is_as_good_as_single_calls() -> None:
    rng = np.random.default_rng(5)
    true = wandering(40, rng)
    first, second = seen(true, PELVIS, rng, batch=4), seen(joined(true, ball(40, 30.0)), THIGH, rng, batch=4)
    for function in (find_rotation_centre, find_rotation_axis):
        together = function(first, second)
        for k in range(4):
            alone = function(
                Poses(first.rotation[k], first.position[k]), Poses(second.rotation[k], second.position[k])
            )
            np.testing.assert_allclose(np.abs(together.proximal[k]), np.abs(alone.proximal), atol=1e-10)
            np.testing.assert_allclose(together.rms[k], alone.rms, rtol=1e-9)
    np.testing.assert_allclose(
        measure_ranges_of_motion(first, second)[2],
        measure_ranges_of_motion(
            Poses(first.rotation[2], first.position[2]), Poses(second.rotation[2], second.position[2])
        ),
        rtol=1e-12,
    )


def test_frames_without_a_pose_are_passed_over() -> None:
    first = wandering(100, np.random.default_rng(6))
    second = joined(first, ball(100, 40.0))
    rotation, position = second.rotation.copy(), second.position.copy()
    rotation[10:60], position[70] = np.nan, np.nan
    found = find_rotation_centre(first, Poses(rotation, position))
    assert found.frames == 49
    np.testing.assert_allclose(found.proximal, CENTRE, atol=1e-13)
    few = Poses(np.full_like(rotation, np.nan), position)
    assert np.isnan(find_rotation_centre(first, few).proximal).all()
    assert np.isnan(find_rotation_axis(first, few).proximal).all()
    assert np.isnan(measure_ranges_of_motion(first, few)).all()


def test_where_the_whole_moves_changes_nothing() -> None:
    rng = np.random.default_rng(7)
    true = wandering(80, rng)
    first, second = (
        Poses(p.rotation[0], p.position[0])
        for p in (seen(true, PELVIS, rng), seen(joined(true, ball(80, 40.0)), THIGH, rng))
    )
    turn, shift = Rotation.from_rotvec([0.3, -1.0, 0.4]).as_matrix(), np.array([1.0, -2.0, 0.5])
    there = [Poses(turn @ p.rotation, p.position @ turn.T + shift) for p in (first, second)]
    here, moved = find_rotation_centre(first, second), find_rotation_centre(*there)
    np.testing.assert_allclose(moved.proximal, here.proximal, atol=1e-10)
    np.testing.assert_allclose(moved.rms, here.rms, rtol=1e-9)


def test_ranges_tell_a_hinge_from_a_ball() -> None:
    first = wandering(400, np.random.default_rng(8))
    one = np.degrees(measure_ranges_of_motion(first, joined(first, hinge(400, 70.0)), share=1.0))
    assert one == pytest.approx([70.0, 0.0, 0.0], abs=0.1)
    plane = np.deg2rad(30.0) * np.sin(np.linspace(0.0, 8.0 * np.pi, 400))
    other = np.deg2rad(12.0) * np.sin(np.linspace(0.0, 2.0 * np.pi, 400))
    both = Rotation.from_rotvec(np.column_stack([other, 0.0 * plane, plane])).as_matrix()
    assert np.degrees(measure_ranges_of_motion(first, joined(first, both), share=1.0)) == pytest.approx(
        [60.0, 24.0, 0.0], abs=0.5
    )


def test_a_ball_joint_has_no_sharp_axis() -> None:
    first = wandering(200, np.random.default_rng(9))
    assert find_rotation_axis(first, joined(first, ball(200, 60.0))).sharpness > 0.5
