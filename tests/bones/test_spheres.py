"""Spheres in a surface: a wrong first guess leads to the true one, and votes are counted as scipy does."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.ndimage import uniform_filter

from scaling_service.bones.fits import _add_neighbours, refine_sphere
from scaling_service.bones.surface import Surface, prepare
from scaling_service.numerics.multibody.laws import Array

RADIUS_M, CENTRE_M = 0.02, np.array([0.01, -0.02, 0.005])


@pytest.fixture(scope="module")
def ball_on_a_rod() -> Surface:
    """A ball of 20 mm at the end of a rod, in the surface's own frame."""
    ball = trimesh.creation.icosphere(subdivisions=5, radius=RADIUS_M)
    rod = trimesh.creation.capsule(height=0.2, radius=0.008, count=[32, 60])
    rod.apply_translation([0.0, 0.0, 0.05])
    mesh = trimesh.util.concatenate([ball, rod])
    mesh.apply_translation(CENTRE_M)
    return prepare(np.asarray(mesh.vertices), np.asarray(mesh.faces))


def guesses(surface: Surface, off_m: float) -> list[Array]:
    """Centres beside the true one in six directions."""
    true = (CENTRE_M - surface.origin) @ surface.R_image_own
    return [true + off_m * direction for direction in (*np.eye(3), *-np.eye(3))]


@pytest.mark.parametrize("off_m", [0.0, 0.002, 0.004])
def test_a_first_guess_beside_the_centre_leads_to_it(ball_on_a_rod: Surface, off_m: float) -> None:
    """As far beside it as votes in cells of 3 mm may be."""
    true = guesses(ball_on_a_rod, 0.0)[0]
    for guess in guesses(ball_on_a_rod, off_m):
        found = refine_sphere(ball_on_a_rod, guess, 0.9 * RADIUS_M)
        assert found is not None
        np.testing.assert_allclose(found.centre, true, atol=1e-4)
        assert found.radius == pytest.approx(RADIUS_M, abs=1e-4)


@pytest.mark.parametrize("off_m", [0.0, 0.004, 0.012])
def test_vertices_further_away_have_no_part(
    ball_on_a_rod: Surface, off_m: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same with all vertices, and with those around chosen anew whenever the centre moves."""
    for guess in guesses(ball_on_a_rod, off_m):
        found = []
        for room in (1e3, 1.5, 1.0):
            monkeypatch.setattr("scaling_service.bones.fits._ROOM", room)
            found.append(refine_sphere(ball_on_a_rod, guess, 0.9 * RADIUS_M))
        wanted = found[0]
        for other in found[1:]:
            assert (other is None) == (wanted is None)
            if other is not None and wanted is not None:
                np.testing.assert_array_equal(other.centre, wanted.centre)
                np.testing.assert_array_equal(other.support, wanted.support)


def test_votes_of_neighbouring_cells_are_counted() -> None:
    votes = np.random.default_rng(1).random((9, 7, 8))
    np.testing.assert_allclose(_add_neighbours(votes), 27.0 * uniform_filter(votes, 3, mode="constant"))
