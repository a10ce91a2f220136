"""Imported public models against OpenSim: the same markers at the same poses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scaling_service.files.osim.models import read_osim
from scaling_service.model.compile import compile_model
from scaling_service.numerics.multibody.tree import pose_markers

MODELS = [
    ("rajagopal_walk/Rajagopal2016.osim", None),
    ("rajagopal_walk/Rajagopal2016.osim", "rajagopal_walk/markerset_walk_preScale.xml"),
    ("gait2354/gait2354_simbody.osim", "gait2354/gait2354_Scale_MarkerSet.xml"),
    ("jia_mri/manual_model.osim", None),
    ("opencap_squat/unscaled_generic.osim", None),
    ("opencap_squat/manually_scaled.osim", None),
]
NO_PARAMETERS = np.zeros(0)


@pytest.mark.parametrize(("file", "marker_set"), MODELS)
def test_markers_are_where_opensim_has_them(
    shared_data, oracle, random_poses, slow_positions, file, marker_set
):
    path = shared_data / file
    markers = shared_data / marker_set if marker_set else None
    model = read_osim(path, markers)
    q = random_poses(model, 100)
    answer = oracle(
        {
            "operation": "positions",
            "file": str(path),
            "marker_set": str(markers) if markers else None,
            "coordinates": model.coordinate_names,
            "markers": model.marker_names,
            "poses": q.tolist(),
        }
    )
    wanted = np.array(answer["positions"])
    ours = pose_markers(compile_model(model), q, NO_PARAMETERS)
    np.testing.assert_allclose(ours, wanted, rtol=0, atol=1e-9)  # m: rounding only, both are exact
    np.testing.assert_allclose(slow_positions(model, q[:5]), wanted[:5], rtol=0, atol=1e-9)


def test_coupled_coordinates_are_no_coordinates(shared_data):
    model = read_osim(shared_data / "rajagopal_walk/Rajagopal2016.osim")
    assert {c.dependent for c in model.couplers} == {"knee_angle_r_beta", "knee_angle_l_beta"}
    assert not {c.dependent for c in model.couplers} & set(model.coordinate_names)
    assert model.coordinate("subtalar_angle_r").locked
    assert model.coordinate("pelvis_tx").kind == "translation"
    assert model.coordinate("knee_angle_r").kind == "rotation"
    assert model.coordinate("knee_angle_r").upper == pytest.approx(2.0944)


def test_a_marker_set_replaces_and_adds(shared_data, tmp_path):
    model = shared_data / "jia_mri/manual_model.osim"
    plain = read_osim(model)
    name, other = plain.marker_names[0], "new_one"
    markers = tmp_path / "markers.xml"
    markers.write_text(_marker_set(20302, {name: (0.1, 0.2, 0.3), other: (0.4, 0.5, 0.6)}, plain))
    both = read_osim(model, markers)
    assert set(both.marker_names) == {*plain.marker_names, other}
    assert both.marker(name).nominal == pytest.approx((0.1, 0.2, 0.3))
    assert both.marker(other).nominal == pytest.approx((0.4, 0.5, 0.6))
    assert both.marker(plain.marker_names[1]) == plain.marker(plain.marker_names[1])
    assert both.marker(other).anatomical


def _marker_set(version: int, positions: dict, model) -> str:
    body = model.segment_names[0]
    items = "".join(
        f'<Marker name="{name}"><body>{body}</body><location>{x} {y} {z}</location>'
        "<fixed>true</fixed></Marker>"
        for name, (x, y, z) in positions.items()
    )
    return (
        f'<?xml version="1.0"?><OpenSimDocument Version="{version}"><MarkerSet name="m"><objects>'
        f"{items}</objects><groups/></MarkerSet></OpenSimDocument>"
    )


def test_a_changed_file_is_read_again(shared_data, tmp_path):
    text = (shared_data / "jia_mri/manual_model.osim").read_text()
    path: Path = tmp_path / "model.osim"
    path.write_text(text)
    first = read_osim(path)
    path.write_text(text.replace(f'<Model name="{first.name}"', '<Model name="another_name"'))
    assert read_osim(path).name == "another_name"
