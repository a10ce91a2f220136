"""Segmentations as they come: label maps, folders, names of others, both legs in one label."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from scaling_service.bones.images import assemble, read_bones
from scaling_service.bones.results import MeshRefused
from scaling_service.bones.whole import find_landmarks
from scaling_service.capabilities.subject.images import Imaged, place_images, read_images
from scaling_service.capabilities.subject.reading import load_subject
from scaling_service.cli.app import app
from scaling_service.core.errors import FileUnreadable, SubjectInvalid
from scaling_service.files.segmentation import read_segmentation
from scaling_service.model.builtin import load_builtin
from tests.bones import bones
from tests.bones.bones import Mesh
from tests.bones.labels import write_labels

ASIDE = 90.0  # mm; from the middle of the body to each leg
SPACING = (1.5, 1.5, 2.0)


def place(points: np.ndarray, side: str) -> np.ndarray:
    """From forward, up and right of a right leg to right, anterior and superior of the image."""
    forward, up, right = np.moveaxis(np.asarray(points, dtype=float), -1, 0)
    across = right + ASIDE
    return np.stack([across if side == "r" else -across, forward, up], axis=-1)


def image(mesh: Mesh, side: str) -> Mesh:
    turned = mesh[1] if side == "l" else mesh[1][:, ::-1]
    return place(mesh[0], side), turned


@pytest.fixture(scope="module")
def legs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("image") / "legs.nii.gz"
    both = {bone: [image(mesh, side) for side in "rl"] for bone, mesh in (("femur", bones.femur()),)}
    labels = {
        "Left Femur": both["femur"][1],
        "femur_right": both["femur"][0],
        "tibia": bones.joined(image(bones.tibia(), "r"), image(bones.tibia(), "l")),
        "spleen": image(bones.meshed([bones.ball([0, 600, 0], 20)], [-30, 570, -30], [30, 630, 30]), "r"),
    }
    write_labels(file, labels, SPACING)
    return file


def test_both_legs_of_a_label_map(legs: Path) -> None:
    imaged = read_bones({"segmentation": legs})
    assert set(imaged.meshes) == {"femur_r", "femur_l", "tibia_r", "tibia_l"}
    assert imaged.passed_over == ("spleen",)
    assert imaged.voxel == pytest.approx(1e-3 * np.sqrt((2 * 1.5**2 + 2.0**2) / 12))
    found = imaged.widen(find_landmarks(imaged.meshes))
    for side in "rl":
        femur, tibia = found[f"femur_{side}"], found[f"tibia_{side}"]
        assert (femur.side_from, tibia.side_from) == ("shape", "shape")
        hip = 1e-3 * place(bones.HIP_CENTRE, side)
        knee = 1e-3 * place(0.5 * (bones.CONDYLE_MEDIAL + bones.CONDYLE_LATERAL), side)
        assert np.linalg.norm(femur.points["hip_centre"] - hip) < 2.0 * femur.deviations["hip_centre"]
        assert np.linalg.norm(femur.points["knee_centre"] - knee) < 2.0 * femur.deviations["knee_centre"]
        tip = 1e-3 * place(bones.MALLEOLUS_MEDIAL - [0, 7, 0], side)
        assert np.linalg.norm(tibia.points["malleolus_medial"] - tip) < 3e-3
        assert min(femur.deviations.values()) > imaged.voxel


def test_an_image_that_ends_leaves_surfaces_open_there(legs: Path, tmp_path: Path) -> None:
    import nibabel

    whole = nibabel.load(legs)
    level = whole.shape[2] // 2
    file = tmp_path / "lower.nii.gz"
    nibabel.save(nibabel.Nifti1Image(np.asarray(whole.dataobj)[:, :, :level], whole.affine), file)
    (tmp_path / "lower.json").write_text(legs.with_name("legs.json").read_text())
    found = find_landmarks(read_bones({"segmentation": file}).meshes)
    assert "hip_centre" in found["femur_r"].refused
    assert "knee_centre" in found["femur_r"].points


def test_the_command_takes_a_label_map(legs: Path, tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["landmarks", str(legs), "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    document = json.loads((tmp_path / "landmarks.json").read_text())
    assert "spleen" in document["warnings"][0]
    assert document["femur_l"]["side"] == "l"
    assert document["femur_r"]["deviations_mm"]["hip_centre"] > 0.8


def test_a_folder_of_surfaces_with_names_of_others(tmp_path: Path) -> None:
    names = {"Segment_Right Femur": bones.femur(), "tibia_r": bones.tibia()}
    for name, (vertices, faces) in names.items():
        rows = [f"v {x} {y} {z}" for x, y, z in vertices] + [f"f {a} {b} {c}" for a, b, c in faces + 1]
        (tmp_path / f"{name}.obj").write_text("\n".join(rows))
    imaged = read_bones({"segmentation": tmp_path})
    assert (set(imaged.meshes), imaged.unit, imaged.voxel) == ({"femur_r", "tibia_r"}, "mm", 0.0)


def test_hip_bones_are_joined_and_a_fibula_goes_with_its_tibia() -> None:
    one = bones.metres(bones.femur())
    told, left = assemble({"hip_left": one, "hip_right": one, "sacrum": one, "fibula_l": one, "tibia_l": one})
    assert set(told) == {"pelvis", "tibia_l"}
    assert left == ("sacrum",)
    assert len(told["pelvis"][1]) == len(told["tibia_l"][1]) == 2 * len(one[1])


def test_what_does_not_say_its_side_or_is_no_bone_is_refused(tmp_path: Path) -> None:
    one = bones.metres(bones.femur())
    with pytest.raises(MeshRefused, match="does not say its side"):
        assemble({"femur": one})
    with pytest.raises(MeshRefused, match="none of its labels"):
        assemble({"liver": one})
    with pytest.raises(FileUnreadable, match="no surface and no mask"):
        read_segmentation(tmp_path)
    (tmp_path / "broken.nii").write_bytes(b"no image")
    with pytest.raises(FileUnreadable, match="cannot be read as NIfTI"):
        read_segmentation(tmp_path / "broken.nii")


def test_a_subject_may_give_a_segmentation(legs: Path) -> None:
    file = legs.with_name("subject.yaml")
    file.write_text(
        "subject: {id: S}\nmodel: lower_limb_14dof\ntrials: {static: stand.trc}\n"
        "bones: {segmentation: legs.nii.gz}\n"
    )
    (legs.parent / "stand.trc").write_text("")
    subject = load_subject(file)
    assert subject.bones == {"segmentation": legs}
    imaged, model = read_images(subject), load_builtin("lower_limb_14dof")
    assert imaged is not None
    evidence = place_images(imaged, model, model.marker_names, subject.marker_map)
    assert evidence is not None
    assert {"hip_r", "knee_l", "ankle_r"} <= evidence.centres.keys() <= evidence.deviations.keys()
    assert set(evidence.bones) == {"femur_r", "femur_l", "tibia_r", "tibia_l"}
    assert any("spleen" in note for note in map(str, imaged.notes))


@pytest.mark.parametrize("shift", [[0.03, 0.0, 0.02], [0.2, 0.0, 0.0]])
def test_markers_of_another_frame_than_the_bones_are_refused(shift: list[float]) -> None:
    model, found = load_builtin("lower_limb_14dof"), find_landmarks({"tibia_r": bones.metres(bones.tibia())})
    at = {"RFH": "fibula_head", "RLM": "malleolus_lateral", "RMM": "malleolus_medial"}
    x, y, z = shift
    markers = {
        name: ("tibia_r", (float(p[0]) + x, float(p[1]) + y, float(p[2]) + z))
        for name, point in at.items()
        for p in (found["tibia_r"].points[point],)
    }
    imaged = Imaged(landmarks=found, markers=markers)
    if x < 0.1:
        evidence = place_images(imaged, model, model.marker_names, {})
        assert evidence is not None
        assert evidence.markers == markers
    else:
        with pytest.raises(SubjectInvalid, match="its markers lie 200 mm from their landmarks"):
            place_images(imaged, model, model.marker_names, {})
