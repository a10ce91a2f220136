"""Cleaning, smoothing and refining of surfaces."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from scaling_service.bones.mesh import (
    Smoother,
    compute_vertex_areas,
    compute_vertex_normals,
    label_pieces,
    measure_openness,
    merge_vertices,
    refine_mesh,
    wind_alike,
)
from scaling_service.bones.surface import prepare

BALL = trimesh.creation.icosphere(4, 0.03)
POINTS, FACES = np.asarray(BALL.vertices), np.asarray(BALL.faces).astype(np.intp)


def test_areas_and_normals_of_a_ball() -> None:
    assert compute_vertex_areas(POINTS, FACES).sum() == pytest.approx(4 * np.pi * 0.03**2, rel=5e-3)
    assert compute_vertex_normals(POINTS, FACES) == pytest.approx(POINTS / 0.03, abs=0.02)


def test_smoothing_takes_noise_off_and_keeps_the_size() -> None:
    rng = np.random.default_rng(0)
    noisy = POINTS + rng.normal(scale=3e-4, size=POINTS.shape)
    smooth = Smoother(noisy, FACES).smooth(5e-3)
    before, after = (np.linalg.norm(p, axis=1) - 0.03 for p in (noisy, smooth))
    assert after.std() < 0.5 * before.std()
    assert abs(after.mean()) < 1e-4


def test_refining_a_coarse_ball_puts_vertices_on_the_ball() -> None:
    coarse = trimesh.creation.icosphere(2, 0.03)
    points, faces = refine_mesh(np.asarray(coarse.vertices), np.asarray(coarse.faces).astype(np.intp), 5e-3)
    assert len(faces) == 4 * len(coarse.faces)
    chords = 0.03 - np.linalg.norm(coarse.triangles_center, axis=1).min()
    assert np.abs(np.linalg.norm(points, axis=1) - 0.03).max() < 0.1 * chords
    assert measure_openness(faces) == 0.0


def test_a_fine_mesh_is_left_alone() -> None:
    assert refine_mesh(POINTS, FACES, 5e-3)[1] is FACES


def test_soup_is_merged() -> None:
    soup = POINTS[FACES].reshape(-1, 3)
    points, faces = merge_vertices(soup, np.arange(len(soup)).reshape(-1, 3))
    assert len(points) == len(POINTS)
    assert label_pieces(len(points), faces).max() == 0


def test_winding_is_restored_piece_by_piece() -> None:
    both = np.vstack([FACES, FACES + len(POINTS)])
    wrong = np.random.default_rng(1).random(len(both)) < 0.3
    mixed = np.where(wrong[:, None], both[:, ::-1], both)
    restored, turned = wind_alike(2 * len(POINTS), mixed)
    assert turned == wrong.sum()
    assert np.array_equal(np.sort(restored, axis=1), np.sort(both, axis=1))
    assert compute_vertex_normals(np.vstack([POINTS, POINTS]), restored) == pytest.approx(
        np.vstack([POINTS, POINTS]) / 0.03, abs=0.02
    )


def test_own_frame_and_image_frame_are_inverse() -> None:
    moved = POINTS * [1.5, 1.0, 0.5] + [1.0, 2.0, 3.0]
    surface = prepare(moved, FACES)
    assert np.linalg.det(surface.R_image_own) == pytest.approx(1.0)
    assert np.ptp(surface.points[:, 0]) > np.ptp(surface.points[:, 1]) > np.ptp(surface.points[:, 2])
    back = surface.to_image(surface.points)
    assert np.sort(back, axis=0) == pytest.approx(np.sort(moved, axis=0), abs=1e-6)
