"""Against experts' models of real bones; absent data skip."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from pyvista import PolyData
from scipy.spatial import ConvexHull

from scaling_service.bones.mesh import merge_vertices
from scaling_service.bones.results import BoneLandmarks, MeshRefused
from scaling_service.bones.whole import Mesh, find_landmarks
from scaling_service.files.mesh import read_mesh

FILES = {
    "pelvis": "pelvis_no_sacrum.stl",
    "femur_r": "femur_r.stl",
    "tibia_r": "tibia_r.stl",
    "talus_r": "talus_r.stl",
}


@dataclass(frozen=True)
class Person:
    rough: bool
    meshes: dict[str, Mesh]
    found: dict[str, BoneLandmarks]
    expert: dict[str, dict[str, object]]

    def centre(self, joint: str) -> np.ndarray:
        return np.asarray(self.expert[joint]["centre_mm"])

    def right(self, joint: str) -> np.ndarray:
        axes = self.expert[joint]["axes_in_image_frame"]
        assert isinstance(axes, dict)
        return np.asarray(axes["Z"])


PERSONS = ("bones/LHDL_CT", "bones/TLEM2_CT", "jia_mri")


@pytest.fixture(scope="module", params=[pytest.param(PERSONS[0], marks=pytest.mark.costly), *PERSONS[1:]])
def person(request: pytest.FixtureRequest, shared_data: Path) -> Person:
    folder = shared_data / request.param
    if not (folder / "reference_joints.json").is_file():
        pytest.skip(f"no bones at {folder}")
    bones = folder / "bones" if (folder / "bones").is_dir() else folder
    meshes = {}
    for name, file in FILES.items():
        if (bones / file).is_file():
            mesh = read_mesh(bones / file)
            meshes[name] = (mesh.vertices * 1e-3, mesh.faces)
    expert = json.loads((folder / "reference_joints.json").read_text())["manual"]
    return Person("mri" in request.param, meshes, find_landmarks(meshes), expert)


ONE_OF_THREE = pytest.mark.parametrize(
    "person",
    ["jia_mri", *(pytest.param(name, marks=pytest.mark.costly) for name in PERSONS if name != "jia_mri")],
    indirect=True,
)
"""The rough bone in any case; computed tomographies, which are finer, where what takes long is."""


def degrees(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.rad2deg(np.arccos(min(1.0, float(a @ b)))))


def test_hip_and_knee(person: Person) -> None:
    femur = person.found["femur_r"]
    assert (femur.side, femur.side_from, femur.refused) == ("r", "shape", {})
    hip = np.linalg.norm(femur.points["hip_centre"] * 1e3 - person.centre("hip_r"))
    assert hip <= (1.0 if person.rough else 0.5)
    offset = femur.points["knee_centre"] * 1e3 - person.centre("knee_r")
    right = person.right("knee_r")
    assert np.linalg.norm(offset) <= 4.0
    assert np.linalg.norm(offset - (offset @ right) * right) <= 3.5
    assert degrees(femur.axes["knee"], right) <= (7.0 if person.rough else 2.5)
    assert degrees(femur.cylinders["condyles"].axis, right) <= (4.0 if person.rough else 1.0)


@ONE_OF_THREE
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("share", [0.8, 1.25])
def test_a_stretched_image_is_told_by_its_heads(person: Person, share: float, axis: int) -> None:
    """As where slices stand at another distance than the file says: lengths were off by as much, unsaid."""
    assert not [said for said in person.found["femur_r"].warnings if "no ball" in said]
    vertices, faces = person.meshes["femur_r"]
    stretched = vertices * np.where(np.arange(3) == axis, share, 1.0)
    femur = find_landmarks({"femur_r": (stretched, faces)})["femur_r"]
    (said,) = [said for said in femur.warnings if "no ball" in said]
    if "knee_centre" in femur.points:  # else the other end was taken for the head, as its pelvis tells
        assert f"image's {'xyz'[axis]}" in said


def test_ankle(person: Person) -> None:
    ankle = person.found["tibia_r"].points["ankle_centre"] * 1e3 - person.centre("ankle_r")
    assert np.linalg.norm(ankle) <= 2.5
    assert degrees(person.found["talus_r"].axes["ankle"], person.right("ankle_r")) <= 5.0
    talus = person.found["talus_r"]
    off = person.centre("subtalar_r") - talus.points["subtalar_centre"] * 1e3
    beside = np.linalg.norm(np.cross(off, talus.axes["subtalar"]))
    assert beside <= 1.7e3 * np.sqrt(2.0 / 3.0) * talus.deviations["subtalar_centre"]  # across the axis
    # Experts and STAPLE differ by 2 and 3 degrees on computed tomography, by 11 on the rough bone.
    assert degrees(talus.axes["subtalar"], person.right("subtalar_r")) <= 5.0
    malleoli = person.found["tibia_r"].points["ankle_centre_malleoli"] * 1e3 - person.centre("ankle_r")
    assert 3.0 < np.linalg.norm(malleoli) < 12.0  # tips lie lateral, proximal and behind


@ONE_OF_THREE
@pytest.mark.parametrize("faces", [None, pytest.param(5000, marks=pytest.mark.costly), 2000])
@pytest.mark.parametrize("noise_mm", [pytest.param(0.0, marks=pytest.mark.costly), 0.5])
def test_the_subtalar_axis_stays_on_worse_meshes(person: Person, faces: int | None, noise_mm: float) -> None:
    """It jumped by 25 to 38 degrees on the rough bone when another hollow was taken for the facet."""
    vertices, triangles = merge_vertices(*person.meshes["talus_r"])
    if faces is not None and faces < len(triangles):
        coarse = PolyData.from_regular_faces(vertices, triangles).decimate(1.0 - faces / len(triangles))
        vertices, triangles = np.asarray(coarse.points, dtype=float), np.asarray(coarse.regular_faces)
    vertices = vertices + 1e-3 * noise_mm * np.random.default_rng(1).normal(size=vertices.shape)
    found = find_landmarks({"tibia_r": person.meshes["tibia_r"], "talus_r": (vertices, triangles)})["talus_r"]
    moved = degrees(found.axes["subtalar"], person.found["talus_r"].axes["subtalar"])
    assert moved < 3.0


@ONE_OF_THREE
def test_a_heel_bone_is_no_talus(person: Person, shared_data: Path) -> None:
    """In its own image where it lies, in others where a talus's bottom is, and pushed up to the tibia."""
    heel = shared_data / "bones/JIA_foot/calcaneus_r.stl"
    if not heel.is_file():
        pytest.skip(f"no heel bone at {heel}")
    mesh = read_mesh(heel)
    vertices = mesh.vertices * 1e-3
    tibia = person.found["tibia_r"].points
    up = tibia["fibula_head"] - tibia["malleolus_lateral"]
    up = up / np.linalg.norm(up)
    if not person.rough:
        vertices = vertices - vertices.mean(axis=0) + tibia["ankle_centre"] - 0.035 * up
    for lifted in (0.0, 0.006, 0.012, 0.018):
        bones = {"tibia_r": person.meshes["tibia_r"], "talus_r": (vertices + lifted * up, mesh.faces)}
        with pytest.raises(MeshRefused, match="another bone") as refusal:
            find_landmarks(bones)
        assert refusal.value.field == "talus_r"


def test_pelvis(person: Person) -> None:
    if "pelvis" not in person.found:
        pytest.skip("no pelvis of this person")
    pelvis = person.found["pelvis"]
    middle = pelvis.points["mid_asis"] * 1e3
    assert np.linalg.norm(middle - person.centre("ground_pelvis")) <= 4.0
    assert degrees(pelvis.axes["asis"], person.right("ground_pelvis")) <= 2.0
    socket = pelvis.points["acetabulum_r"] * 1e3
    assert np.linalg.norm(socket - person.centre("hip_r")) <= 2.0


def test_a_knee_whose_femur_was_not_imaged_stands_over_its_plateaus(person: Person) -> None:
    """The place is the mean of these three persons; each is within 1.9 mm of what the other two give."""
    alone = find_landmarks({"tibia_r": person.meshes["tibia_r"]})["tibia_r"]
    off = np.linalg.norm(alone.points["knee_centre"] - person.found["femur_r"].points["knee_centre"])
    assert off <= 1.7 * alone.deviations["knee_centre"]
    assert "knee_centre" not in person.found["tibia_r"].points
    left = find_landmarks(
        {"tibia_l": (person.meshes["tibia_r"][0] * [-1.0, 1, 1], person.meshes["tibia_r"][1])}
    )
    mirrored = left["tibia_l"].points["knee_centre"] * [-1.0, 1, 1]
    assert mirrored == pytest.approx(alone.points["knee_centre"], abs=1e-4)


def test_a_millimetre_of_noise_moves_hip_and_knee_by_half_at_most(person: Person) -> None:
    """Condyles of a rough bone are no spheres: which part of them is fitted then hangs on the noise."""
    vertices, faces = merge_vertices(*person.meshes["femur_r"])  # STL repeats a vertex for every face
    noisy = vertices + 1e-3 * np.random.default_rng(11).normal(size=vertices.shape)
    found = find_landmarks({"femur_r": (noisy, faces)})["femur_r"]
    assert any("scatter" in warning for warning in found.warnings)
    for name in ("hip_centre", "knee_centre"):
        moved = np.linalg.norm(found.points[name] - person.found["femur_r"].points[name])
        assert moved <= (1.5e-3 if person.rough and name == "knee_centre" else 5e-4), name


@ONE_OF_THREE
def test_pose_and_side(person: Person) -> None:
    rng = np.random.default_rng(7)
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    R, shift = q * np.sign(np.linalg.det(q)), rng.normal(size=3)
    turned = find_landmarks(
        {n: ((v @ R.T + shift).astype(np.float32), f) for n, (v, f) in person.meshes.items()}
    )
    for bone, landmarks in person.found.items():
        for name, point in landmarks.points.items():
            back = (turned[bone].points[name] - shift) @ R
            assert np.linalg.norm(back - point) <= 5e-5, (bone, name)
    left = {n.replace("_r", "_l"): (v * [-1.0, 1, 1], f) for n, (v, f) in person.meshes.items()}
    assert find_landmarks(left)["femur_l"].side == "l"


def test_sacrum_in(person: Person) -> None:
    if "pelvis" not in person.found:
        pytest.skip("no pelvis of this person")
    points = person.found["pelvis"].points
    rear = 0.5 * (points["psis_r"] + points["psis_l"])
    centre = rear + 0.15 * (points["mid_asis"] - rear)
    rng = np.random.default_rng(8)
    cloud = rng.normal(size=(3000, 3))
    cloud *= [0.045, 0.05, 0.03] / np.linalg.norm(cloud, axis=1)[:, None]
    sacrum = centre + cloud, ConvexHull(cloud).simplices
    vertices, faces = person.meshes["pelvis"]
    both = np.vstack([vertices, sacrum[0]]), np.vstack([faces, sacrum[1] + len(vertices)])
    found = find_landmarks({"pelvis": both})["pelvis"]
    for name in ("acetabulum_r", "acetabulum_l", "mid_asis"):
        assert np.linalg.norm(found.points[name] - points[name]) < 2e-3, name
