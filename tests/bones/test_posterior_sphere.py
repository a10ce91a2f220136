"""The mean over likely spheres against spheres that are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pyvista import Sphere

from scaling_service.bones.posterior_sphere import Usual, average_spheres
from scaling_service.bones.surface import Surface, prepare

RADIUS = 0.014
USUAL = Usual(radius=0.0145, radius_sd=0.0012)


def make_ball(share: float) -> tuple[Surface, np.ndarray]:
    """The upper part of a ball, and where its centre is in the surface's frame."""
    ball = Sphere(radius=RADIUS, theta_resolution=60, phi_resolution=60).triangulate()
    points = np.asarray(ball.points, dtype=float)
    faces = np.asarray(ball.regular_faces)
    low = RADIUS * (1.0 - 2.0 * share)
    surface = prepare(points, faces[(points[faces][:, :, 2] > low).all(axis=1)])
    return surface, -surface.origin @ surface.R_image_own


def test_a_whole_ball_is_found_from_beside_it() -> None:
    surface, centre = make_ball(1.1)
    found = average_spheres(surface, centre + np.array([0.003, -0.004, 0.002]), USUAL)
    assert np.linalg.norm(found.centre - centre) < 2e-4
    assert found.radius == pytest.approx(RADIUS, abs=5e-4)
    assert found.covered == pytest.approx(1.0, abs=0.2)


def test_less_of_a_ball_says_less_of_its_centre() -> None:
    much, little = (make_ball(share) for share in (0.5, 0.15))
    sure, unsure = (average_spheres(surface, centre, USUAL) for surface, centre in (much, little))
    assert unsure.deviation > 1.5 * sure.deviation
    assert np.linalg.norm(unsure.centre - little[1]) < 3.0 * unsure.deviation


def test_where_nothing_is_seen_people_decide() -> None:
    surface, centre = make_ball(0.15)
    known = Usual(radius=0.0145, radius_sd=0.0012, centre=centre, axes=np.eye(3), spread=np.full(3, 5e-4))
    held = average_spheres(surface, centre + 0.002, known)
    assert held.deviation < average_spheres(surface, centre, USUAL).deviation


def test_a_socket_is_a_ball_seen_from_inside() -> None:
    surface, centre = make_ball(0.4)
    inside = replace(surface, normals=-surface.normals)
    ball, socket = (
        average_spheres(surface, centre, USUAL),
        average_spheres(inside, centre, USUAL, hollow=True),
    )
    assert socket.centre == pytest.approx(ball.centre)
    assert socket.deviation == pytest.approx(ball.deviation)
