"""Bones beside the model: a known shape in the image comes back in its segment's frame."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from scaling_service.capabilities.playback.drawing import place_bones
from scaling_service.capabilities.scaling.methods.table import calibrate
from scaling_service.capabilities.scaling.saving import write_bones
from scaling_service.files.mesh import read_mesh
from scaling_service.model.poses import pose_neutral_frames
from scaling_service.model.results import Calibration
from scaling_service.model.trial import Bone, ImageEvidence
from tests.calibration.people import imaged, person

TILTS_DEG = {"knee_r": (3.0, -5.0, 0.0), "knee_l": (-4.0, 2.0, 0.0)}
HEAD_M = 0.024


def ball(centre: tuple[float, float, float]) -> Bone:
    sphere = trimesh.creation.icosphere(subdivisions=2, radius=HEAD_M)
    return Bone(np.array(sphere.vertices) + centre, np.array(sphere.faces))


@pytest.fixture(scope="module")
def evidence() -> ImageEvidence:
    """A ball about the right hip centre for a femur, one about the right knee centre for a tibia."""
    who = person(41, tilts_deg=TILTS_DEG, seconds=1.0)
    found = imaged(who, TILTS_DEG)
    return replace(
        found, bones={"femur_r": ball(found.centres["hip_r"]), "tibia_r": ball(found.centres["knee_r"])}
    )


@pytest.fixture(scope="module")
def calibration(evidence: ImageEvidence) -> Calibration:
    who = person(41, tilts_deg=TILTS_DEG, seconds=1.0)
    return calibrate(replace(who.session, images=evidence), "EB")


def test_a_bone_lies_where_its_segment_says(calibration: Calibration, evidence: ImageEvidence) -> None:
    """Thigh and shank begin at hip and knee centre, so the balls are about their origins."""
    for bone in place_bones(calibration, evidence.bones).values():
        np.testing.assert_allclose(bone.vertices.mean(axis=0), 0.0, atol=1e-9)
        np.testing.assert_allclose(np.linalg.norm(bone.vertices, axis=1), HEAD_M, rtol=1e-9)


def test_files_are_in_metres_and_read_again(
    calibration: Calibration, evidence: ImageEvidence, tmp_path: Path
) -> None:
    written = write_bones(tmp_path, calibration, evidence.bones)
    assert sorted(written) == ["bones.glb", "bones/femur_r.stl", "bones/tibia_r.stl"]
    assert sorted(p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*") if p.is_file()) == sorted(
        written
    )
    mesh = read_mesh(tmp_path / "bones" / "femur_r.stl")
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices, axis=1), HEAD_M, rtol=1e-5)  # 32 bit


def test_the_skeleton_stands(calibration: Calibration, evidence: ImageEvidence, tmp_path: Path) -> None:
    write_bones(tmp_path, calibration, evidence.bones)
    scene = trimesh.load_scene(tmp_path / "bones.glb")
    frames = pose_neutral_frames(calibration.model)
    assert set(scene.graph.nodes_geometry) == {"femur_r", "tibia_r"}
    for name in ("femur_r", "tibia_r"):
        transform, geometry = scene.graph[name]
        vertices = trimesh.transform_points(scene.geometry[geometry].vertices, transform)
        np.testing.assert_allclose(vertices.mean(axis=0), frames[name][1], atol=1e-6)
    hip, knee = frames["femur_r"][1], frames["tibia_r"][1]
    assert hip[1] - knee[1] > 0.3  # Y is up, m


def test_without_bones_nothing_is_written(calibration: Calibration, tmp_path: Path) -> None:
    assert write_bones(tmp_path, calibration, {}) == []
    assert list(tmp_path.iterdir()) == []
