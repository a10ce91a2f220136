"""Surfaces onto surfaces: what a known map of space did to a bone is found from the bones alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pyvista import PolyData

from scaling_service.bones.morph import map_surface, measure_distances
from scaling_service.bones.results import MeshRefused
from scaling_service.model.trial import Bone
from tests.bones.bones import HIP_CENTRE, femur

Array = np.ndarray


def bend(points: Array) -> Array:
    """A shaft bowed by 8 mm, twisted by 10 deg from end to end, 5 % broader; the ends' centres stay."""
    along = points[:, 1] / 0.405
    twist = np.radians(10.0) * (along - 1.0) * along
    x, z = points[:, 0], points[:, 2]
    bowed = 1.05 * (np.cos(twist) * x + np.sin(twist) * z) + 0.032 * along * (1.0 - along)
    return np.stack([bowed, points[:, 1], 1.05 * (np.cos(twist) * z - np.sin(twist) * x)], axis=1)


@pytest.fixture(scope="module")
def bone() -> Bone:
    vertices, faces = femur()
    return Bone(vertices * 1e-3, faces)


def attachments(bone: Bone) -> Array:
    """Places some millimetres off the surface, all over the bone."""
    middle = bone.vertices[:: len(bone.vertices) // 60]
    return middle * (1.1, 1.0, 1.1)


def test_a_known_map_is_found(bone: Bone) -> None:
    person = replace(bone, vertices=bend(bone.vertices))
    fixed = np.stack([HIP_CENTRE * 1e-3, np.zeros(3)])
    found = map_surface(bone, person, fixed[1:], fixed[1:])
    at = attachments(bone)
    off, before = (1e3 * np.linalg.norm(p - bend(at), axis=1) for p in (found(at), at))
    assert np.median(off) < 1.0 < 2.0 < np.median(before)
    assert 1e3 * found.left_m < 0.5
    assert found.sizes(at).min() > 0.8


def test_a_bone_onto_itself_stays(bone: Bone) -> None:
    full = PolyData.from_regular_faces(bone.vertices, bone.faces)
    coarse = full.decimate(0.9)  # few enough faces to be taken as they are
    same, at = Bone(coarse.points, coarse.regular_faces), attachments(bone)
    found = map_surface(same, same, *np.zeros((2, 1, 3)))
    assert found(at) == pytest.approx(at, abs=1e-4)
    assert found.sizes(at) == pytest.approx(np.ones(len(at)), abs=0.02)


def test_distances_are_from_the_surface_not_from_its_corners() -> None:
    square = Bone(np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]]))
    assert measure_distances(square, np.array([[0.3, 0.6, 0.02], [2.0, 0.5, 0.0]])) == pytest.approx(
        [0.02, 1.0]
    )


def test_what_is_no_such_bone_is_refused(bone: Bone) -> None:
    box = Bone(
        np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]), np.array([[0, 1, 2], [0, 3, 1]])
    )
    with pytest.raises(MeshRefused, match="has its like"):
        map_surface(box, replace(bone, vertices=bone.vertices + 1.0), *np.zeros((2, 1, 3)))
