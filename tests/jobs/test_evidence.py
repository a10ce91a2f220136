"""Bones and image markers of a real person become joint centres, and those a model."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from scaling_service.capabilities.scaling.run import compare
from scaling_service.capabilities.subject.images import place_images, read_images
from scaling_service.capabilities.subject.reading import load_subject
from scaling_service.core.errors import InputError
from scaling_service.model.builtin import load_builtin
from scaling_service.model.subject import Subject
from tests.jobs.recorded import walker_document

MODEL = load_builtin("lower_limb_14dof")


@pytest.fixture(scope="module")
def document(shared_data: Path) -> dict[str, object]:
    folder = shared_data / "jia_mri"
    return walker_document(shared_data) | {
        "subject": {"id": "imaged"},
        "bones": {
            "units": "mm",
            "pelvis": str(folder / "bones" / "pelvis_no_sacrum.stl"),
            "femur_r": str(folder / "bones" / "femur_r.stl"),
            "tibia_r": str(folder / "bones" / "tibia_r.stl"),
        },
        "image_markers": str(folder / "image_markers.csv"),
    }


def subject(document: dict[str, object], folder: Path) -> Subject:
    file = folder / "subject.yaml"
    file.write_text(json.dumps(document))
    return load_subject(file)


def test_centres_are_the_experts(document: dict[str, object], tmp_path: Path, shared_data: Path) -> None:
    known = subject(document, tmp_path)
    imaged = read_images(known)
    assert imaged is not None
    evidence = place_images(imaged, MODEL, MODEL.marker_names, known.marker_map)
    assert evidence is not None
    expert = json.loads((shared_data / "jia_mri" / "reference_joints.json").read_text())["manual"]
    for joint, limit_mm in (
        ("hip_r", 1.0),
        ("knee_r", 4.0),
        ("ankle_r", 12.0),
    ):  # the expert's ankle is the talus
        gap = 1e3 * np.array(evidence.centres[joint]) - expert[joint]["centre_mm"]
        assert np.linalg.norm(gap) < limit_mm, joint
    assert {"hip_r", "knee_r", "ankle_r"} <= evidence.centres.keys()
    assert "knee_l" not in evidence.centres
    assert "hip_l" in evidence.centres  # the socket's
    assert evidence.markers["RLFE"][0] == "femur_r"
    assert not [name for name, (segment, _) in evidence.markers.items() if segment.startswith("calcn")]


def test_the_image_based_model_follows_walking_that_it_never_saw(
    document: dict[str, object], tmp_path: Path
) -> None:
    results = compare(subject(document, tmp_path), ("MB", "EB", "EB_am"))
    error = {name: scaling.errors["Walking01"].mean for name, scaling in results.scalings.items()}
    assert error["EB_am"] < error["EB"] < error["MB"]
    assert error["EB_am"] < 0.005


def test_bones_of_the_wrong_side_are_refused_by_name(document: dict[str, object], tmp_path: Path) -> None:
    known = subject(document, tmp_path)
    bones = {"femur_l": known.bones["femur_r"]}
    with pytest.raises(InputError, match="femur_l"):
        read_images(replace(known, bones=bones))


def moved(document: dict[str, object], folder: Path, bone: str, by_mm: list[float]) -> Subject:
    """The subject with one bone elsewhere in the image."""
    known = subject(document, folder)
    mesh = trimesh.load_mesh(known.bones[bone])
    mesh.apply_translation(by_mm)
    mesh.export(folder / f"{bone}.stl")
    return replace(known, bones={**known.bones, bone: folder / f"{bone}.stl"})


def test_bones_in_frames_of_their_own_are_refused(document: dict[str, object], tmp_path: Path) -> None:
    for bone, by_mm in (("tibia_r", [0.0, 0.0, -500.0]), ("femur_r", [200.0, 0.0, 0.0])):
        with pytest.raises(InputError, match=r"lies .* mm from .* frame of one image") as caught:
            read_images(moved(document, tmp_path, bone, by_mm))
        assert caught.value.field == f"bones.{bone}"


def test_a_knee_that_gapes_is_reported(document: dict[str, object], tmp_path: Path) -> None:
    imaged = read_images(moved(document, tmp_path, "tibia_r", [0.0, 0.0, -15.0]))
    assert imaged is not None
    assert any(
        "right tibia" in note and "other poses, images or persons" in note for note in map(str, imaged.notes)
    )


def test_bones_are_left_alone_with_other_models(document: dict[str, object], tmp_path: Path) -> None:
    imaged = read_images(replace(subject(document, tmp_path), model="own.json"))
    assert imaged is not None
    assert place_images(imaged, MODEL, MODEL.marker_names, {}) is None
    assert "built-in and .osim models only" in str(imaged.notes[0])
