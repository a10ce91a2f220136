"""What is no bone, not that bone, or too little of it, is refused with the reason."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import trimesh

from scaling_service.bones.results import MeshRefused
from scaling_service.bones.whole import check_joined, find_landmarks, find_unit
from scaling_service.files.mesh import FINE_FACES, read_mesh
from tests.bones import bones

Make = Callable[[], bones.Mesh]

CUBE = partial(bones.meshed, [lambda p: np.abs(p).max(axis=1) - 50], [-60] * 3, [60] * 3, step=4.0)
BEAM = partial(
    bones.meshed, [lambda p: (np.abs(p) - [30, 200, 40]).max(axis=1)], [-40, -210, -50], [40, 210, 50], step=4
)
SPHERE = partial(bones.meshed, [bones.ball([0, 0, 0], 100)], [-110] * 3, [110] * 3, step=4.0)
FOOT = partial(
    bones.meshed,
    [lambda p: (np.linalg.norm(p / [125, 45, 40], axis=1) - 1) * 40],
    [-130, -50, -50],
    [130, 50, 50],
    step=3.0,
)
ROD = partial(bones.meshed, [bones.rod([0, -200, 0], [0, 200, 0], 24)], [-30, -230, -30], [30, 230, 30])


@pytest.mark.parametrize("bone", ["femur_r", "tibia_r", "pelvis"])
@pytest.mark.parametrize(
    "make", [CUBE, BEAM, SPHERE, FOOT, ROD], ids=["cube", "beam", "sphere", "foot", "rod"]
)
def test_no_bone(make: Make, bone: str) -> None:
    with pytest.raises(MeshRefused) as refusal:
        find_landmarks({bone: bones.metres(make())})
    assert refusal.value.field == bone
    assert refusal.value.remedy


@pytest.mark.parametrize(
    ("bone", "make"),
    [
        ("femur_r", bones.tibia),
        ("tibia_r", bones.femur),
        ("pelvis", bones.femur),
        ("femur_r", bones.talus),
        ("femur_l", bones.femur),
        ("tibia_l", bones.tibia),
        ("femur_r", lambda: bones.joined(bones.femur(), (bones.femur()[0] + [0, 0, 150], bones.femur()[1]))),
        ("talus_r", bones.talus),
    ],
    ids=["tibia", "femur", "pelvis", "talus", "left femur", "left tibia", "two femurs", "talus alone"],
)
def test_another_bone_than_it_is_called(bone: str, make: Make) -> None:
    with pytest.raises(MeshRefused) as refusal:
        find_landmarks({bone: bones.metres(make())})
    assert refusal.value.field == bone


def test_the_wrong_side_is_named() -> None:
    with pytest.raises(MeshRefused, match="right femur, but is given as a left"):
        find_landmarks({"femur_l": bones.metres(bones.femur())})


def test_a_talus_of_another_place() -> None:
    vertices, faces = bones.talus()
    with pytest.raises(MeshRefused, match="mm from the tibia"):
        find_landmarks(
            {"tibia_r": bones.metres(bones.tibia()), "talus_r": bones.metres((vertices + 200.0, faces))}
        )


def test_half_a_femur_gives_its_half() -> None:
    top = find_landmarks({"femur_r": bones.metres(bones.above(bones.femur(), 150.0))})["femur_r"]
    assert top.points["hip_centre"] * 1e3 == pytest.approx(bones.HIP_CENTRE, abs=0.1)
    assert "knee_centre" in top.refused
    assert top.side_from == "name"
    bottom = find_landmarks({"femur_r": bones.metres(bones.above(bones.femur(), 200.0, -1.0))})["femur_r"]
    middle = 0.5 * (bones.CONDYLE_MEDIAL + bones.CONDYLE_LATERAL)
    assert bottom.points["knee_centre"] * 1e3 == pytest.approx(middle, abs=0.1)
    assert "hip_centre" in bottom.refused
    assert any("open" in warning for warning in bottom.warnings)


@pytest.mark.parametrize("side", ["r", "l"])
def test_a_femur_without_its_shaft_gives_both_ends(side: str) -> None:
    """As where the field of an image ends above the knee and begins again below the hip."""
    turned = bones.femur() if side == "r" else bones.mirrored(bones.femur())
    whole = find_landmarks({f"femur_{side}": bones.metres(turned)})[f"femur_{side}"]
    both = bones.joined(bones.above(turned, 310.0), bones.above(turned, 110.0, -1.0))
    ends = find_landmarks({f"femur_{side}": bones.metres(both)})[f"femur_{side}"]
    assert ends.side_from == "name"
    assert any("shaft is missing" in warning for warning in ends.warnings)
    for point, at in whole.points.items():
        assert np.linalg.norm(ends.points[point] - at) < 1e-3, point
    assert abs(float(ends.axes["knee"] @ whole.axes["knee"])) > np.cos(np.deg2rad(1.0))


def test_half_a_tibia_has_no_ankle() -> None:
    found = find_landmarks({"tibia_r": bones.metres(bones.above(bones.tibia(), -250.0))})["tibia_r"]
    assert "ankle_centre" not in found.points
    assert "cut off" in found.refused["ankle_centre"]
    assert "fibula_head" in found.points


@pytest.mark.parametrize(
    ("vertices", "faces", "said"),
    [
        (np.zeros((0, 3)), np.zeros((0, 3), dtype=int), "empty"),
        (np.eye(3), np.array([[0, 1, 2]]), "too few"),
        (np.eye(3), np.array([[0, 1, 5]]), "do not exist"),
        (np.full((3, 3), np.nan), np.array([[0, 1, 2]]), "not finite"),
        (np.eye(3), np.array([[0.0, 1.0, 2.0]]), "whole numbers"),
        (np.eye(4), np.array([[0, 1, 2]]), "no triangles"),
    ],
)
def test_no_mesh(vertices: np.ndarray, faces: np.ndarray, said: str) -> None:
    with pytest.raises(MeshRefused, match=said):
        find_landmarks({"femur_r": (vertices, faces)})


@pytest.mark.parametrize(("factor", "unit"), [(1.0, "m"), (100.0, "cm"), (1000.0, "mm")])
def test_the_unit_follows_from_the_size(factor: float, unit: str) -> None:
    assert find_unit({"femur_r": 0.44 * factor, "talus_r": 0.06 * factor, "pelvis": 0.28 * factor}) == unit


def test_mixed_units_are_refused() -> None:
    with pytest.raises(MeshRefused, match="in no unit"):
        find_unit({"femur_r": 440.0, "tibia_r": 0.39})


@pytest.mark.parametrize(
    ("size", "shift", "said"),
    [
        ([1.0, 1.0, 1.0], [0.0, 0.0, 0.0], "^$"),
        (
            [1.0, 1.0, 1.0],
            [0.0, -25.0, 0.0],
            "of the condyles of the right femur: other poses",
        ),
        ([0.7, 0.7, 0.7], [0.0, 0.0, 0.0], "wide, the right femur .* check that they are of one person"),
        ([1.0, 1.0, 1.0], [500.0, 0.0, 0.0], "^tibia_r: Export all bones in the frame of one image"),
        ([1.0, 1.0, -1.0], [0.0, 0.0, 0.0], "^tibia_r: Give it as tibia_l; if the export mirrored it"),
        ([0.1, 0.1, 0.1], [0.0, 0.0, 0.0], "^tibia_r: .*heck the unit"),
    ],
    ids=["its own", "pulled away", "of a child", "half a metre away", "mirrored", "in cm"],
)
def test_a_tibia_that_does_not_belong_to_its_femur(size: list[float], shift: list[float], said: str) -> None:
    vertices, faces = bones.tibia()
    pair = {"femur_r": bones.metres(bones.femur()), "tibia_r": bones.metres((vertices * size + shift, faces))}
    try:
        reported = " ".join(check_joined(find_landmarks(pair)))
    except MeshRefused as refusal:
        reported = f"{refusal.field}: {refusal.remedy}"
    assert re.search(said, reported), reported


MOST_S = 20.0  # of CPU time, reading included
SAME = 1e-4  # m; landmarking's own resolution


@pytest.mark.costly
def test_a_surface_of_millions_of_faces_takes_its_time_and_changes_no_centre(tmp_path: Path) -> None:
    coarse = trimesh.Trimesh(*bones.femur(), process=False)
    fine = coarse.subdivide().subdivide().subdivide()
    assert len(fine.faces) > 4 * FINE_FACES
    fine.export(tmp_path / "femur_r.stl")
    start = time.process_time()
    read = read_mesh(tmp_path / "femur_r.stl")
    found, usual = (
        find_landmarks({"femur_r": (np.asarray(mesh.vertices) * 1e-3, np.asarray(mesh.faces))})["femur_r"]
        for mesh in (read, coarse)
    )
    assert time.process_time() - start < MOST_S
    assert read.thinned_from == len(fine.faces)
    for name in ("hip_centre", "knee_centre"):
        assert np.linalg.norm(found.points[name] - usual.points[name]) < SAME, name


@pytest.mark.parametrize("reach", [90.0, 110.0, 150.0])
def test_a_knee_of_a_clinical_image_stands_alone(reach: float) -> None:
    """A piece hardly longer than thick, whose longest axis is not its shaft's."""
    found = find_landmarks({"femur_r": bones.metres(bones.above(bones.femur(), reach, -1.0))})["femur_r"]
    middle = 0.5 * (bones.CONDYLE_MEDIAL + bones.CONDYLE_LATERAL)
    assert found.points["knee_centre"] * 1e3 == pytest.approx(middle, abs=0.5)
    assert "hip_centre" in found.refused


@pytest.mark.parametrize("level", [330.0, 300.0])
def test_a_hip_of_a_clinical_image_stands_alone(level: float) -> None:
    found = find_landmarks({"femur_l": bones.metres(bones.mirrored(bones.above(bones.femur(), level)))})
    assert found["femur_l"].points["hip_centre"] * 1e3 == pytest.approx(
        bones.HIP_CENTRE * [1, 1, -1], abs=0.1
    )
    assert "knee_centre" in found["femur_l"].refused


def test_a_tibia_back_to_front_is_refused() -> None:
    vertices, faces = bones.tibia()
    pair = {
        "femur_r": bones.metres(bones.femur()),
        "tibia_r": bones.metres((vertices * [-1.0, 1.0, -1.0], faces)),
    }
    with pytest.raises(MeshRefused, match=r"turned by 1[78]\d degrees") as refusal:
        check_joined(find_landmarks(pair))
    assert refusal.value.field == "tibia_r"


def test_legs_of_two_persons_are_told() -> None:
    vertices, faces = bones.mirrored(bones.femur())
    pair = {
        "femur_r": bones.metres(bones.femur()),
        "femur_l": bones.metres((vertices * 0.92 - [0, 0, 200], faces)),
    }
    notes = check_joined(find_landmarks(pair))
    assert any("of one person" in note for note in notes)
