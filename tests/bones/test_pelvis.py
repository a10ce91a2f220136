"""Which way a pelvis lies, where people's pelves differ; absent data skip."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scaling_service.bones.constellation import MOST_UNLIKE, measure_unlikeness
from scaling_service.bones.pelvis import find_pelvis_landmarks
from scaling_service.bones.results import BoneLandmarks
from scaling_service.bones.whole import Mesh
from scaling_service.files.mesh import read_mesh

FILES = ("bones/LHDL_CT/pelvis_no_sacrum.stl", "jia_mri/bones/pelvis_no_sacrum.stl")
SURE = 10.0  # powers of ten; real pelves have 24 and more


@pytest.fixture(scope="module", params=FILES)
def pelvis(request: pytest.FixtureRequest, shared_data: Path) -> tuple[Mesh, BoneLandmarks]:
    file = shared_data / request.param
    if not file.is_file():
        pytest.skip(f"no pelvis at {file}")
    mesh = read_mesh(file)
    bone = 1e-3 * mesh.vertices, mesh.faces
    return bone, find_pelvis_landmarks(*bone)


class Axes:
    """Forward, up and right of a pelvis in units of half its sockets' distance."""

    def __init__(self, points: dict[str, np.ndarray]) -> None:
        across = points["acetabulum_r"] - points["acetabulum_l"]
        self.half = 0.5 * float(np.linalg.norm(across))
        self.middle = 0.5 * (points["acetabulum_r"] + points["acetabulum_l"])
        z = across / (2 * self.half)
        up = points["mid_asis"] - 0.5 * (points["pubic_tubercle_r"] + points["pubic_tubercle_l"])
        up = up - up @ z * z
        y = up / np.linalg.norm(up)
        self.rows = np.stack([np.cross(y, z), y, z])

    def widen(self, points: np.ndarray, share: float, below: float) -> np.ndarray:
        """Wider by a share below a height, as women's pelves are, and the same above."""
        q = (points - self.middle) @ self.rows.T / self.half
        w = share / (1.0 + np.exp((q[..., 1] - below) / 0.08))
        return np.asarray(points + self.half * (w * q[..., 2])[..., None] * self.rows[2])


def test_landmarks_lie_as_in_people_and_no_other_pose_is_as_likely(
    pelvis: tuple[Mesh, BoneLandmarks],
) -> None:
    found = pelvis[1]
    assert found.pose_odds is not None
    assert found.pose_odds > SURE
    assert measure_unlikeness(found.points) < MOST_UNLIKE
    upside_down = {
        name: found.points[name.replace("asis", "x").replace("psis", "asis").replace("x", "psis")]
        for name in found.points
        if name != "mid_asis"
    }
    assert measure_unlikeness(upside_down) > measure_unlikeness(found.points) + 2 * np.log(10) * SURE


@pytest.mark.parametrize(
    "pelvis", [FILES[0], pytest.param(FILES[1], marks=pytest.mark.costly)], indirect=True
)
@pytest.mark.parametrize(("share", "below"), [(0.12, -0.1), (0.2, -0.1), (0.25, 0.3), (0.2, -0.4)])
def test_wide_pelves_lie_as_they_did(pelvis: tuple[Mesh, BoneLandmarks], share: float, below: float) -> None:
    (vertices, faces), plain = pelvis
    axes = Axes(dict(plain.points))
    found = find_pelvis_landmarks(axes.widen(vertices, share, below), faces)
    assert found.pose_odds is not None
    assert found.pose_odds > SURE
    for name, point in plain.points.items():
        moved = axes.widen(point, share, below)
        assert np.linalg.norm(found.points[name] - moved) < 0.012, name


def test_spines_on_a_cut_edge_are_refused_and_the_rest_is_given(pelvis: tuple[Mesh, BoneLandmarks]) -> None:
    (vertices, faces), plain = pelvis
    axes = Axes(dict(plain.points))
    level = (vertices - axes.middle) @ axes.rows[0] / axes.half
    kept = level < (plain.points["mid_asis"] - axes.middle) @ axes.rows[0] / axes.half - 0.1
    found = find_pelvis_landmarks(vertices, faces[kept[faces].all(axis=1)])
    assert {"asis_r", "asis_l"} <= found.refused.keys()
    assert "mid_asis" not in found.points
    assert "asis" not in found.axes
    for name in ("acetabulum_r", "acetabulum_l", "psis_r", "psis_l"):
        assert np.linalg.norm(found.points[name] - plain.points[name]) < 2 * found.deviations[name], name


def test_tubercles_lie_as_far_apart_as_in_people(pelvis: tuple[Mesh, BoneLandmarks]) -> None:
    points = pelvis[1].points
    apart = 1e3 * np.linalg.norm(points["pubic_tubercle_r"] - points["pubic_tubercle_l"])
    assert 45.0 < apart < 70.0
