"""Bones with fewer triangles keep their shape."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from scaling_service.capabilities.playback.drawing import coarsen
from scaling_service.model.trial import Bone


@pytest.mark.parametrize("most", [200, 1000, 5000])
def test_a_coarse_sphere_is_a_sphere(most: int) -> None:
    sphere = trimesh.creation.icosphere(subdivisions=5, radius=0.05)
    fine = Bone(np.array(sphere.vertices), np.array(sphere.faces))
    found = coarsen(fine, most)
    assert most / 4 < len(found.faces) <= most
    radii = np.linalg.norm(found.vertices, axis=1)
    assert np.abs(radii / 0.05 - 1.0).max() < 8.0 / most  # triangles of this number sag by so much
    corners = found.vertices[found.faces]
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    # An icosahedron lacks 40 % with its 20 faces, and the error falls with their number.
    assert volume == pytest.approx(4 / 3 * np.pi * 0.05**3, rel=8 / most)
    assert trimesh.Trimesh(found.vertices, found.faces, process=False).is_watertight


def test_a_thin_plate_keeps_both_sides() -> None:
    plate = (
        trimesh.creation.box((0.1, 0.1, 0.002)).subdivide().subdivide().subdivide().subdivide().subdivide()
    )
    found = coarsen(Bone(np.array(plate.vertices), np.array(plate.faces)), 500)
    coarse = trimesh.Trimesh(found.vertices, found.faces, process=False)
    assert coarse.is_watertight
    assert coarse.volume == pytest.approx(plate.volume, rel=0.01)


def test_corners_repeated_in_every_triangle_are_one() -> None:
    sphere = trimesh.creation.icosphere(subdivisions=5, radius=0.05)
    torn = Bone(np.array(sphere.triangles).reshape(-1, 3), np.arange(3 * len(sphere.faces)).reshape(-1, 3))
    found = coarsen(torn, 1000)
    assert len(found.faces) <= 1000
    assert trimesh.Trimesh(found.vertices, found.faces, process=False).is_watertight


def test_a_small_surface_stays_as_it_is() -> None:
    sphere = trimesh.creation.icosphere(subdivisions=1)
    fine = Bone(np.array(sphere.vertices), np.array(sphere.faces))
    assert coarsen(fine, 4000) is fine
