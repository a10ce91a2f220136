"""The overlay: numbers arrive as they are, surfaces keep their shape, flat views show the same."""

from __future__ import annotations

import base64
import re

import numpy as np
import pytest
import trimesh

from scaling_service.model.trial import Bone
from scaling_service.report.scene import Body, Scene, coarsen
from tests.report.reading import data, read


def scene(**changes: object) -> Scene:
    rng = np.random.default_rng(1)
    points = rng.normal(size=(3, 2, 3)) + np.array([0.0, 1.0, 0.0])
    body = Body(
        name="MB",
        colour="#E69F00",
        points=points,
        centres=[(0, "hip")],
        sticks=[(0, 1)],
        markers=[(1, "R<1>", 0)],
        bones={"femur": np.tile(np.append(np.eye(3).ravel(), [0.0, 1.0, 0.0]), (3, 1))},
    )
    sphere = trimesh.creation.icosphere(subdivisions=2, radius=0.1)
    known = {
        "caption": "walk",
        "description": "One model.",
        "times": np.array([0.0, 0.1, 0.2]),
        "labels": ["R<1>"],
        "measured": points[:, 1:] + 0.01,
        "bodies": [body],
        "surfaces": {"femur": Bone(np.array(sphere.vertices), np.array(sphere.faces))},
    }
    return Scene(**(known | changes))  # type: ignore[arg-type]


def unpacked(text: str, kind: str = "<f4") -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), kind)


def test_points_and_bones_arrive() -> None:
    shown = scene()
    (content,) = data(read(shown.html()))
    (method,) = content["methods"]
    points = unpacked(method["points"]).reshape(3, method["count"], 3)
    np.testing.assert_allclose(points, shown.bodies[0].points, atol=3e-7)  # 32 bit
    measured = unpacked(content["measured"]["points"]).reshape(3, 1, 3)
    np.testing.assert_allclose(measured, shown.measured, atol=3e-7)
    faces = unpacked(content["bones"]["femur"]["faces"], "<u2").reshape(-1, 3)
    np.testing.assert_array_equal(faces, shown.surfaces["femur"].faces)
    pose = unpacked(method["bones"][0]["pose"]).reshape(3, 12)
    np.testing.assert_array_equal(pose[1, 9:], [0.0, 1.0, 0.0])


def test_labels_are_not_markup() -> None:
    (content,) = data(read(scene().html()))
    assert content["measured"]["labels"] == ["R&lt;1&gt;"]  # plotly shows entities as characters
    assert content["methods"][0]["markers"] == [[1, "R&lt;1&gt;", 0]]


def test_gaps_stay_gaps() -> None:
    measured = scene().measured.copy()
    measured[1] = np.nan
    shown = scene(measured=measured)
    (content,) = data(read(shown.html()))
    assert np.isnan(unpacked(content["measured"]["points"]).reshape(3, 3)[1]).all()
    assert "nan" not in re.sub(r"<script.*", "", shown.html())


def test_the_box_holds_all_and_up_is_up() -> None:
    shown = scene()
    (content,) = data(read(shown.html()))
    box, points = content["box"], shown.bodies[0].points
    assert box["x"][0] < points[..., 0].min() < points[..., 0].max() < box["x"][1]
    assert box["y"][0] < -points[..., 2].max() < -points[..., 2].min() < box["y"][1]
    assert box["z"][0] < points[..., 1].min() < points[..., 1].max() < box["z"][1]


def test_controls_are_labelled() -> None:
    root = read(scene().html())
    labels = [label.text for label in root.all("label")]
    assert labels == ["MB", "bones", "lines to measured markers", "knee axes"]
    (slider,) = [i for i in root.all("input") if i.attributes["type"] == "range"]
    assert (slider.attributes["max"], slider.attributes["aria-label"]) == ("2", "Frame")
    assert [b.attributes["type"] for b in root.all("button")] == ["button"] * 4


def test_the_flat_view_from_the_right_keeps_proportions() -> None:
    """Distances between the two points of the stick: 400 px are 1 m in the plane of the drawing."""
    shown = scene()
    (svg,) = read(shown.html()).all("svg")
    (stick,) = [
        p for p in svg.all("path") if p.attributes.get("stroke-width") == "2.5" and p.attributes["d"]
    ][:1]
    x0, y0, x1, y1 = (float(v) for v in re.findall(r"-?\d+\.\d", stick.attributes["d"] or ""))
    a, b = shown.bodies[0].points[1]
    assert (x1 - x0) / 400 == pytest.approx(b[0] - a[0], abs=6e-4)  # written with 0.1 px
    assert (y0 - y1) / 400 == pytest.approx(b[1] - a[1], abs=6e-4)


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
    assert coarsen(fine) is fine
