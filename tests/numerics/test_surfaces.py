"""Functions of several coordinates: closed forms, and derivatives against differences."""

from __future__ import annotations

import numpy as np
import pytest

from scaling_service.core.arrays import Array
from scaling_service.numerics.multibody.rigid import rotate_about
from scaling_service.numerics.multibody.surfaces import Surface

X, Y, Z = np.eye(3)
OFFSETS = (0.1, -0.05)
ALL = [
    ("powers", (2.0, 1.0, 3.0), 3),
    *[(f"normal_{c}", (), 2) for c in "xyz"],
    *[(f"arc_{c}", OFFSETS, 2) for c in "xyz"],
]


def places(n_coordinates: int) -> Array:
    """Coordinates, among them where an arc is straight, and nearly so."""
    x = np.random.default_rng(1).uniform(-1.4, 1.4, (n_coordinates, 300))
    x[:, :50] *= 1e-3
    x[:, 0] = 0.0
    x[:2, 1] = -np.array(OFFSETS)
    return x


@pytest.mark.parametrize(("kind", "numbers", "count"), ALL)
def test_slopes_are_those_of_differences(kind: str, numbers: tuple[float, ...], count: int) -> None:
    surface, x, step = Surface(kind, numbers), places(count), 1e-5
    for k, slope in enumerate(surface.evaluate(x)[1]):
        by = step * np.eye(count)[:, k : k + 1]
        expected = (surface.evaluate(x + by)[0] - surface.evaluate(x - by)[0]) / (2.0 * step)
        np.testing.assert_allclose(slope, expected, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(("kind", "numbers", "count"), ALL)
def test_slopes_change_along_a_motion_as_differences_say(
    kind: str, numbers: tuple[float, ...], count: int
) -> None:
    surface, x, step = Surface(kind, numbers), places(count), 1e-4
    rate, pace = np.random.default_rng(2).normal(size=(2, *x.shape))

    def slopes(t: float) -> Array:
        return np.array(surface.evaluate(x + rate * t + 0.5 * pace * t**2)[1])

    once, twice = np.moveaxis(np.array(surface.follow_slopes(x, rate, pace)), 1, 0)
    np.testing.assert_allclose(once, (slopes(step) - slopes(-step)) / (2 * step), rtol=0.0, atol=1e-5)
    expected = (slopes(step) - 2.0 * slopes(0.0) + slopes(-step)) / step**2
    np.testing.assert_allclose(twice, expected, rtol=0.0, atol=1e-4)
    (alone,) = np.array(surface.follow_slopes(x, rate, None)).transpose(1, 0, 2)
    np.testing.assert_array_equal(alone, once)


def test_a_normal_is_the_turned_z_axis() -> None:
    a, b = 0.7, -0.4
    found = [Surface(f"normal_{c}", ()).evaluate(np.array([[a], [b]]))[0][0] for c in "xyz"]
    np.testing.assert_allclose(found, rotate_about(X, a) @ rotate_about(Y, b) @ Z, atol=1e-15)


@pytest.mark.parametrize(("a", "b"), [(0.7, -0.4), (1.2, 0.9), (1e-9, 0.0), (0.0, 0.0), (3e-4, -2e-4)])
def test_an_arc_is_the_sum_of_its_tangents(a: float, b: float) -> None:
    """Along an arc of constant curvature the tangent turns evenly from y to the y axis of the end."""
    found = [Surface(f"arc_{c}", (0.0, 0.0)).evaluate(np.array([[a], [b]]))[0][0] for c in "xyz"]
    end = rotate_about(X, a) @ rotate_about(Z, b) @ Y
    axis = np.cross(Y, end)
    angle = np.arctan2(np.linalg.norm(axis), end @ Y)
    axis = axis / np.linalg.norm(axis) if angle else X
    nodes, weights = np.polynomial.legendre.leggauss(20)
    tangents = [rotate_about(axis, 0.5 * (1.0 + u) * angle) @ Y for u in nodes]
    np.testing.assert_allclose(found, 0.5 * weights @ np.array(tangents), rtol=0.0, atol=1e-15)
