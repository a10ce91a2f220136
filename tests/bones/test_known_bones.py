"""Landmarks of bones whose centres are known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scaling_service.bones.results import BoneLandmarks
from scaling_service.bones.whole import find_landmarks
from tests.bones import bones


def one(mesh: bones.Mesh, name: str = "femur_r") -> BoneLandmarks:
    return find_landmarks({name: bones.metres(mesh)})[name]


@pytest.fixture(scope="module")
def femur() -> BoneLandmarks:
    return one(bones.femur())


def knee_centre() -> np.ndarray:
    return 0.5 * (bones.CONDYLE_MEDIAL + bones.CONDYLE_LATERAL)


def knee_axis() -> np.ndarray:
    axis = bones.CONDYLE_LATERAL - bones.CONDYLE_MEDIAL
    return axis / np.linalg.norm(axis)


def test_femur(femur: BoneLandmarks) -> None:
    assert (femur.side, femur.side_from, femur.refused, femur.warnings) == ("r", "shape", {}, ())
    assert femur.points["hip_centre"] * 1e3 == pytest.approx(bones.HIP_CENTRE, abs=0.05)
    assert femur.points["knee_centre"] * 1e3 == pytest.approx(knee_centre(), abs=0.05)
    assert femur.axes["knee"] == pytest.approx(knee_axis(), abs=2e-3)
    assert femur.spheres["head"].radius * 1e3 == pytest.approx(bones.RADII["head"], abs=0.05)
    assert femur.spheres["condyle_medial"].radius * 1e3 == pytest.approx(bones.RADII["medial"], abs=0.05)
    assert femur.spheres["condyle_lateral"].radius * 1e3 == pytest.approx(bones.RADII["lateral"], abs=0.05)
    assert femur.points["epicondyle_lateral"][2] * 1e3 == pytest.approx(45, abs=2)
    assert femur.points["epicondyle_medial"][2] * 1e3 == pytest.approx(-45, abs=2)


def test_tibia() -> None:
    tibia = one(bones.tibia(), "tibia_r")
    assert (tibia.side, tibia.side_from, tibia.refused) == ("r", "shape", {})
    # The axis along which tips are sought is the shaft's, 2 degrees off y: up to 0.5 mm on a ball of 7 mm.
    tips = {
        "malleolus_medial": bones.MALLEOLUS_MEDIAL - [0, 7, 0],
        "malleolus_lateral": bones.MALLEOLUS_LATERAL - [0, 7, 0],
        "malleolus_medial_prominence": bones.MALLEOLUS_MEDIAL - [0, 0, 7],
        "malleolus_lateral_prominence": np.add(bones.MALLEOLUS_LATERAL, [0, 0, 7]),
        "fibula_head": np.add(bones.FIBULA_HEAD, [0, 11, 0]),
    }
    for name, point in tips.items():
        if "prominence" in name:
            assert tibia.points[name][2] * 1e3 == pytest.approx(point[2], abs=1.0), name
        else:
            assert tibia.points[name] * 1e3 == pytest.approx(point, abs=1.0), name
    middle = 0.5 * (tips["malleolus_medial"] + tips["malleolus_lateral"])
    assert tibia.points["ankle_centre"] * 1e3 == pytest.approx(middle, abs=0.7)


def test_a_fibula_grown_to_the_tibia_is_parted() -> None:
    apart = one(bones.tibia(), "tibia_r")
    found = one(bones.tibia(grown_together=True), "tibia_r")
    assert found.side == "r"
    assert any("parted" in warning for warning in found.warnings)
    assert "grown" in found.refused["fibula_head"]
    for name in ("ankle_centre", "malleolus_lateral", "malleolus_medial"):
        assert np.linalg.norm(found.points[name] - apart.points[name]) < 1e-3, name


def test_a_talus_gives_the_ankle() -> None:
    found = find_landmarks({"tibia_r": bones.metres(bones.tibia()), "talus_r": bones.metres(bones.talus())})
    assert found["tibia_r"].points["ankle_centre"] * 1e3 == pytest.approx(bones.TALUS_POINT, abs=0.3)
    assert "malleoli" in found["tibia_r"].definitions["ankle_centre_malleoli"]
    assert found["talus_r"].cylinders["trochlea"].radius * 1e3 == pytest.approx(bones.TALUS_RADIUS, abs=0.1)
    assert found["talus_r"].axes["ankle"] == pytest.approx([0.0499, 0, 0.9988], abs=2e-3)


@pytest.mark.costly  # one pose of a real person's bones is looked at in test_real_bones.py
@given(st.integers(0, 2**32 - 1))
@settings(max_examples=4)
def test_any_pose_gives_the_same_points(seed: int) -> None:
    mesh, back = bones.turned(bones.metres(bones.femur()), np.random.default_rng(seed))
    found = find_landmarks({"femur_r": mesh})["femur_r"]
    plain = one(bones.femur())
    assert found.side == "r"
    for name, point in plain.points.items():
        assert np.linalg.norm(back(found.points[name]) - point) < 5e-5, name


def test_a_mirrored_bone_is_a_left_one(femur: BoneLandmarks) -> None:
    left = one(bones.mirrored(bones.femur()), "femur_l")
    assert left.side == "l"
    for name, point in femur.points.items():
        assert left.points[name] * [1, 1, -1] == pytest.approx(point, abs=1e-6), name
    # Both axes point to the subject's right.
    assert left.axes["knee"] == pytest.approx(femur.axes["knee"] * [-1, -1, 1], abs=1e-6)
    assert one(bones.mirrored(bones.tibia()), "tibia_l").side == "l"


def test_inverted_normals_are_turned_and_said(femur: BoneLandmarks) -> None:
    vertices, faces = bones.femur()
    found = one((vertices, faces[:, ::-1]))
    assert found.points["hip_centre"] == pytest.approx(femur.points["hip_centre"], abs=1e-9)
    assert any("inwards" in warning for warning in found.warnings)


def test_faces_wound_at_random_are_turned_and_said(femur: BoneLandmarks) -> None:
    vertices, faces = bones.femur()
    wrong = np.random.default_rng(0).random(len(faces)) < 0.2
    found = one((vertices, np.where(wrong[:, None], faces[:, ::-1], faces)))
    assert found.points["knee_centre"] == pytest.approx(femur.points["knee_centre"], abs=1e-9)
    assert any("wound" in warning for warning in found.warnings)


def test_stray_and_inner_shells_change_nothing(femur: BoneLandmarks) -> None:
    stray = bones.meshed([bones.ball([90, 100, 0], 6)], [80, 90, -10], [100, 110, 10])
    marrow = bones.meshed([bones.rod([16, 300, 2], [16, 100, 0], 9)], [0, 80, -15], [32, 320, 15])
    found = one(bones.joined(bones.femur(), stray, (marrow[0], marrow[1][:, ::-1])))
    assert found.points["hip_centre"] == pytest.approx(femur.points["hip_centre"], abs=2e-5)
    assert found.points["knee_centre"] == pytest.approx(femur.points["knee_centre"], abs=2e-5)
    assert any("stray" in warning for warning in found.warnings)
    assert any("inside" in warning for warning in found.warnings)


def test_noise_of_a_millimetre_moves_centres_little(femur: BoneLandmarks) -> None:
    vertices, faces = bones.femur()
    noisy = vertices + np.random.default_rng(5).normal(size=vertices.shape)
    found = one((noisy, faces))
    for name in ("hip_centre", "knee_centre"):
        assert np.linalg.norm(found.points[name] - femur.points[name]) < 5e-4, name


def test_holes_are_said_and_do_no_harm(femur: BoneLandmarks) -> None:
    vertices, faces = bones.femur()
    found = one((vertices, faces[np.random.default_rng(6).random(len(faces)) < 0.98]))
    assert any("open" in warning for warning in found.warnings)
    assert np.linalg.norm(found.points["hip_centre"] - femur.points["hip_centre"]) < 2e-4


MADE = {"femur_r": bones.femur, "tibia_r": bones.tibia}


@pytest.fixture(scope="module")
def entire() -> dict[str, BoneLandmarks]:
    return {name: one(make(), name) for name, make in MADE.items()}


@pytest.mark.parametrize(
    ("name", "at"),
    [
        ("tibia_r", np.add(bones.MALLEOLUS_LATERAL, [0, 100, 0])),  # the fibula's end is off
        ("tibia_r", np.add(bones.FIBULA_HEAD, [0, 8, 0])),
        ("tibia_r", np.add(bones.MALLEOLUS_MEDIAL, [0, -7, 0])),
        ("femur_r", np.add(bones.CONDYLE_LATERAL, [0, 0, 25])),
        ("femur_r", np.add(bones.HIP_CENTRE, [0, 24, 0])),
    ],
)
@pytest.mark.parametrize("radius", [8.0, 14.0, 20.0])
def test_what_a_hole_may_have_taken_is_not_told(
    entire: dict[str, BoneLandmarks], name: str, at: np.ndarray, radius: float
) -> None:
    vertices, faces = MADE[name]()
    left = faces[np.linalg.norm(vertices[faces].mean(axis=1) - at, axis=1) > radius]
    whole, found = entire[name], one((vertices, left), name)
    assert found.refused.keys() | found.points.keys() >= whole.points.keys() - {
        "knee_centre"
    }  # over plateaus
    for point, place in found.points.items():
        assert np.linalg.norm(place - whole.points[point]) < 2.0 * found.deviations[point], point
