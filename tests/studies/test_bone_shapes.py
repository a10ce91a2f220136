"""Solids against closed forms: distances, and the surfaces made of them."""

from __future__ import annotations

import numpy as np
import pytest

from scaling_service.virtual.bones.shapes import (
    Part,
    contour_shape,
    join_parts,
    make_ball,
    make_chain,
    make_half_space,
    make_plate,
    make_rod,
    make_shaft,
    strip,
)


def at(*points: tuple[float, float, float]) -> np.ndarray:
    return np.array(points, dtype=float)


def volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def test_a_ball_and_a_rod() -> None:
    points = at((0, 0, 0), (3, 4, 0), (0, 0, -2))
    assert make_ball((0, 0, 0), 2.0).distance(points) == pytest.approx([-2.0, 3.0, 0.0])
    pole = make_rod((0, 0, 0), (0, 10, 0), 1.0, 2.0)
    # Beside the middle, beyond the thick end, beyond the thin one.
    assert pole.distance(at((5, 5, 0), (0, 15, 0), (0, -4, 0))) == pytest.approx([3.5, 3.0, 3.0])


def test_a_plate_over_its_face_edge_and_corner() -> None:
    face = make_plate(at((0, 0, 0), (4, 0, 0), (0, 4, 0)), 0.5)
    over = at((1, 1, 2), (1, 1, -2), (2, -3, 0), (-3, -4, 0), (4, 4, 0))
    assert face.distance(over) == pytest.approx([1.5, 1.5, 2.5, 4.5, np.sqrt(8.0) - 0.5])


def test_a_straight_shaft_is_a_cylinder_with_flat_ends() -> None:
    level = np.array([0.0, 5.0, 10.0])
    same = np.ones(3)
    column = make_shaft(heights=level, x=0 * same, z=0 * same, half_x=2 * same, half_z=2 * same, rounding=0.1)
    assert column.distance(at((5, 5, 0), (0, 12, 0), (0, 5, 0))) == pytest.approx([3.0, 2.0, -2.0])


def test_parts_are_added_cut_and_trimmed() -> None:
    cut = join_parts(
        (
            Part(make_ball((0, 0, 0), 0.05)),
            Part(make_ball((0.04, 0, 0), 0.02), 0.0, "cut"),
            Part(make_half_space(np.zeros(3), np.array([0.0, 1.0, 0.0])), 0.0, "trim"),
        )
    )
    inside = cut.distance(at((0, -0.03, 0), (0.04, -0.001, 0), (0, 0.03, 0))) < 0.0
    assert inside.tolist() == [True, False, False]


def test_a_blend_adds_near_the_seam_and_nothing_elsewhere() -> None:
    two = (make_ball((0, 0, 0), 0.02), make_ball((0.03, 0, 0), 0.02))
    sharp = join_parts(tuple(Part(each) for each in two))
    soft = join_parts((Part(two[0]), Part(two[1], 5e-3)))
    seam, far = at((0.015, 0.0135, 0)), at((-0.02, 0.0, 0))
    assert (soft.distance(seam) < 0 < sharp.distance(seam)).all()
    assert soft.distance(far) == pytest.approx(sharp.distance(far), abs=1e-12)


def test_what_lies_apart_is_found_whatever_points_are_asked_with_it() -> None:
    """Parts far from a block of points are left out: signs must not change by it."""
    solid = make_chain([(0, 0, 0), (0, 0.3, 0), (0.1, 0.4, 0)], [0.01, 0.02, 0.01])
    points = np.random.default_rng(0).uniform(-0.1, 0.5, (4000, 3))
    one_by_one = np.concatenate([solid.distance(point[None]) for point in points])
    assert (np.sign(solid.distance(points)) == np.sign(one_by_one)).all()


def test_the_surface_of_a_ball() -> None:
    whole, missing = 4.0 / 3.0 * np.pi * 0.024**3, []
    for step in (3e-3, 1.5e-3):
        vertices, faces = contour_shape(make_ball((0.1, -0.2, 0.3), 0.024), step)
        radius = np.linalg.norm(vertices - [0.1, -0.2, 0.3], axis=1)
        assert np.abs(radius - 0.024).max() < 1e-8
        assert len(vertices) - len(faces) / 2 == 2, "Euler: closed and without holes"
        missing.append(1.0 - volume(vertices, faces) / whole)
    assert 0.0 < missing[0] < 0.01
    assert missing[0] / missing[1] == pytest.approx(4.0, rel=0.15), (
        "flat faces cut off with the edge's square"
    )


def test_a_folded_plate_is_as_thick_as_asked() -> None:
    sheet = strip([(0, 0.05, 0), (0.05, 0.05, 0)], [(0, 0, 0), (0.05, 0, 0)], 3e-3)
    vertices, faces = contour_shape(sheet, 0.7e-3)
    middle = (np.abs(vertices[:, :2] - 0.025) < 0.02).all(axis=1)
    assert np.abs(np.abs(vertices[middle, 2]) - 3e-3).max() < 1e-7
    flat, edges = 0.05 * 0.05 * 6e-3, 0.2 * np.pi * 9e-6 / 2
    assert volume(vertices, faces) == pytest.approx(flat + edges + 4 / 3 * np.pi * 2.7e-8, rel=0.01)
