from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from scaling_service.bones.shapes import (
    SphereFit,
    fit_cylinder,
    fit_sphere,
    fit_sphere_pair,
    span_plane,
)

SEEDS = st.integers(0, 2**32 - 1)


def cap(
    rng: np.random.Generator, n: int, centre: np.ndarray, radius: float, least_z: float = 0.3
) -> np.ndarray:
    z = rng.uniform(least_z, 1.0, n)
    turn = rng.uniform(0, 2 * np.pi, n)
    flat = np.sqrt(1 - z**2)
    return centre + radius * np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z])


def tube(rng: np.random.Generator, n: int, point: np.ndarray, axis: np.ndarray, radius: float) -> np.ndarray:
    first, second = span_plane(axis)
    turn, along = rng.uniform(-1.0, 1.5, n), rng.uniform(-2 * radius, 2 * radius, n)
    radial = np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * second
    return point + radius * radial + along[:, None] * axis


@given(SEEDS)
@settings(max_examples=30)
def test_a_sphere_of_exact_points_is_found_from_a_cap(seed: int) -> None:
    rng = np.random.default_rng(seed)
    centre, radius = rng.normal(size=3) * 100, rng.uniform(0.5, 50)
    fit = fit_sphere(cap(rng, 60, centre, radius), rng.uniform(0.1, 1.0, 60))
    assert fit.converged
    assert fit.centre == pytest.approx(centre, abs=1e-6 * radius)
    assert fit.radius == pytest.approx(radius, rel=1e-6)
    assert fit.rms < 1e-8 * radius


def test_the_geometric_fit_is_less_biased_than_the_algebraic_one() -> None:
    rng = np.random.default_rng(0)
    radii = []
    for _ in range(40):
        points = cap(rng, 400, np.zeros(3), 20.0, least_z=0.5)
        radii.append(fit_sphere(points + rng.normal(scale=0.7, size=points.shape)).radius)
    mean, error = float(np.mean(radii)), float(np.std(radii)) / np.sqrt(len(radii))
    # The algebraic fit of the same points is 2 mm too small.
    assert abs(mean - 20.0) < 0.25 + 3 * error


@given(SEEDS)
@settings(max_examples=20)
def test_the_sphere_is_that_of_a_general_solver(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = cap(rng, 60, np.array([1.0, 2.0, 3.0]), 0.5) + rng.normal(0, 0.005, (60, 3))
    weights = rng.uniform(0.1, 1.0, 60)
    ours = fit_sphere(points, weights)
    theirs = least_squares(
        lambda x: np.sqrt(weights) * (np.linalg.norm(points - x[:3], axis=1) - x[3]),
        np.append(points.mean(axis=0), 0.4),
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-14,
    )
    np.testing.assert_allclose(np.append(ours.centre, ours.radius), theirs.x, rtol=0, atol=1e-7)


def test_points_without_weight_do_not_count() -> None:
    rng = np.random.default_rng(1)
    good = cap(rng, 50, np.array([1.0, 2, 3]), 4.0)
    points = np.vstack([good, rng.normal(size=(20, 3)) * 10])
    fit = fit_sphere(points, np.r_[np.ones(50), np.zeros(20)])
    assert fit.centre == pytest.approx([1, 2, 3], abs=1e-9)


def test_too_few_points_are_an_error() -> None:
    with pytest.raises(ValueError, match="at least 4"):
        fit_sphere(np.eye(3))
    with pytest.raises(ValueError, match="no negative"):
        fit_sphere(np.eye(3)[[0, 1, 2, 0, 1]], np.array([1.0, 1, 1, 1, -1]))


@given(SEEDS)
@settings(max_examples=30)
def test_a_cylinder_of_exact_points_is_found_from_a_rough_axis(seed: int) -> None:
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    point, radius = rng.normal(size=3) * 50, rng.uniform(1, 30)
    points = tube(rng, 200, point, axis, radius)
    first, second = span_plane(axis)
    rough = axis + 0.25 * first - 0.2 * second
    fit = fit_cylinder(points, rough, point + 0.2 * radius * first)
    assert fit.converged
    assert fit.direction == pytest.approx(axis, abs=1e-6)
    assert fit.radius == pytest.approx(radius, rel=1e-6)
    assert np.linalg.norm(np.cross(fit.point - point, axis)) < 1e-5 * radius


@given(SEEDS)
@settings(max_examples=20)
def test_the_cylinder_is_where_no_small_move_is_better(seed: int) -> None:
    rng = np.random.default_rng(seed)
    axis = np.array([0.0, 0.0, 1.0])
    points = tube(rng, 150, np.zeros(3), axis, 10.0) + rng.normal(scale=0.3, size=(150, 3))
    fit = fit_cylinder(points, axis, np.zeros(3))

    def cost(point: np.ndarray, direction: np.ndarray, radius: float) -> float:
        offset = points - point
        radial = offset - np.outer(offset @ direction, direction)
        return float(((np.linalg.norm(radial, axis=1) - radius) ** 2).mean())

    best = cost(fit.point, fit.direction, fit.radius)
    assert best == pytest.approx(fit.rms**2, rel=1e-9)
    for _ in range(20):
        direction = fit.direction + 1e-3 * rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        moved = cost(fit.point + 1e-2 * rng.normal(size=3), direction, fit.radius + 1e-2 * rng.normal())
        assert moved >= best


def test_two_spheres_of_exact_points_keep_their_own_radii() -> None:
    rng = np.random.default_rng(2)
    p = cap(rng, 80, np.array([0.0, 0, 0]), 21.5)
    q = cap(rng, 90, np.array([46.0, 0, 1]), 20.0)
    starts = (SphereFit(np.ones(3), 20.0, 1.0, True), SphereFit(np.array([45.0, 1, 0]), 20.0, 1.0, True))
    a, b = fit_sphere_pair(p, q, np.ones(80), np.ones(90), starts=starts, alike=1.0, noise=1e-3)
    assert (a.radius, b.radius) == pytest.approx((21.5, 20.0), abs=1e-4)
    assert b.centre == pytest.approx([46, 0, 1], abs=1e-3)


def test_two_spheres_on_noise_are_held_alike() -> None:
    rng = np.random.default_rng(3)
    apart, alone = [], []
    for _ in range(20):
        points = [cap(rng, 40, np.zeros(3), 20.0, 0.75) + rng.normal(scale=0.5, size=(40, 3)) for _ in "ab"]
        single = [fit_sphere(p) for p in points]
        counts = np.full(40, 0.5)
        pair = fit_sphere_pair(*points, counts, counts, starts=(single[0], single[1]), alike=1.0, noise=0.5)
        apart.append(abs(pair[0].radius - pair[1].radius))
        alone.append(abs(single[0].radius - single[1].radius))
    assert np.mean(apart) < 0.6 * np.mean(alone)
