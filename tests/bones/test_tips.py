"""Tips against summits in closed form, with noise and after decimation."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from scaling_service.bones.fits import find_tip
from scaling_service.bones.mesh import Smoother, remove_noise
from scaling_service.bones.surface import Surface, prepare

UP = np.array([0.36, 0.48, 0.8])
SEMIAXES = np.array([0.060, 0.020, 0.015])


def egg(subdivisions: int) -> tuple[np.ndarray, np.ndarray]:
    ball = trimesh.creation.icosphere(subdivisions)
    return np.asarray(ball.vertices) * SEMIAXES, np.asarray(ball.faces).astype(np.intp)


def found(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    surface: Surface = prepare(points, faces)
    everywhere = np.ones(len(surface.points), dtype=bool)
    return surface.to_image(find_tip(surface, surface.R_image_own.T @ UP, everywhere))


@pytest.mark.parametrize("radius", [0.007, 0.012, 0.025])
def test_the_summit_of_a_ball(radius: float) -> None:
    ball = trimesh.creation.icosphere(5, radius)
    at = found(np.asarray(ball.vertices) * [1.0, 1.0, 1.0001], np.asarray(ball.faces).astype(np.intp))
    assert at * 1e3 == pytest.approx(1e3 * radius * UP, abs=0.5)


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("along_normals", [True, False])
def test_a_millimetre_of_noise_moves_a_tip_by_half_at_most(seed: int, along_normals: bool) -> None:
    points, faces = egg(5)
    rng = np.random.default_rng(seed)
    normals = points / SEMIAXES**2
    normals = normals / np.linalg.norm(normals, axis=1)[:, None]
    noise = rng.normal(size=(len(points), 1)) * normals if along_normals else rng.normal(size=points.shape)
    assert np.linalg.norm(found(points + 1e-3 * noise, faces) - found(points, faces)) < 5e-4


def test_a_coarse_mesh_has_the_same_tip() -> None:
    assert np.linalg.norm(found(*egg(3)) - found(*egg(5))) < 5e-4


def test_noise_is_measured_and_taken_off_whatever_it_does_to_the_edges() -> None:
    ball = trimesh.creation.icosphere(5, 0.03)
    points, faces = np.asarray(ball.vertices), np.asarray(ball.faces).astype(np.intp)
    noisy = points + np.random.default_rng(0).normal(scale=1e-3, size=points.shape)
    quiet, _, noise = remove_noise(noisy, faces, 5e-3)
    assert noise == pytest.approx(1e-3, rel=0.2)
    off = [np.std(np.linalg.norm(p, axis=1)) for p in (Smoother(noisy, faces).smooth(5e-3), quiet)]
    assert off[1] < 0.8 * off[0]
    assert abs(np.linalg.norm(quiet, axis=1).mean() - 0.03) < 2e-4


@pytest.mark.parametrize("subdivisions", [3, 5])
def test_a_quiet_mesh_is_left_as_it_is(subdivisions: int) -> None:
    points, faces = egg(subdivisions)
    same, _, noise = remove_noise(points, faces, 5e-3)
    assert same is points
    assert noise == 0.0
