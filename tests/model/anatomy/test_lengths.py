"""Joint centres and lengths of built-in models, of a hand-made one, and of OpenSim's."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from scaling_service.files.osim.models import read_osim
from scaling_service.model.anatomy.lengths import find_joint_centres, find_segment, measure_segment_lengths
from scaling_service.model.body import (
    BodyModel,
    Coordinate,
    Joint,
    Law,
    Marker,
    Parameter,
    Segment,
    Shape,
    Term,
)
from scaling_service.model.builtin import load_builtin

# not importorskip: importing opensim here would write its log into the working directory
needs_opensim = pytest.mark.skipif(
    find_spec("opensim") is None, reason="the opensim library is not installed"
)


def test_lower_limb() -> None:
    model = load_builtin("lower_limb_14dof")
    expected = {
        "inter_hip": 0.1735,
        "femur_r": 0.43245,
        "shank_r": 0.4152,
        "femur_l": 0.43245,
        "shank_l": 0.4152,
    }
    assert measure_segment_lengths(model) == pytest.approx(expected)
    centres = find_joint_centres(model)
    assert set(centres) == {f"{j}_{s}" for j in ("hip", "knee", "ankle") for s in "rl"}
    assert centres["hip_l"] == ("pelvis", (-0.0471, -0.0831, -0.08675))
    assert centres["ankle_r"] == ("tibia_r", (0.0, -0.4152, 0.0))


def test_whole_body_takes_the_ankle_from_its_joint() -> None:
    model = load_builtin("full_body_35dof")
    lengths = measure_segment_lengths(model)
    assert {k: lengths[k] for k in ("femur_r", "shank_l", "inter_hip")} == pytest.approx(
        {"femur_r": 0.43245, "shank_l": 0.4152, "inter_hip": 0.1735}
    )
    assert lengths["upper_arm_r"] == pytest.approx(0.2698)
    assert lengths["forearm_l"] == pytest.approx(0.2817)
    moved = replace(model, markers=())
    assert measure_segment_lengths(moved) == lengths


def test_planar_squat_has_lengths_without_side() -> None:
    """The chain runs upward from the foot there, so parents and children are exchanged."""
    model = load_builtin("squat_4dof")
    lengths = measure_segment_lengths(model)
    assert lengths["shank"] == pytest.approx(0.4133)
    assert lengths["femur"] == pytest.approx(0.4116)
    assert find_joint_centres(model)["knee"] == ("thigh", (0.0, 0.0, 0.0))
    assert find_joint_centres(model)["hip"][0] == "torso"


def test_malleoli_serve_where_there_is_no_landmark() -> None:
    model = load_builtin("lower_limb_14dof")
    without = replace(model, markers=tuple(m for m in model.markers if m.weight > 0))
    assert measure_segment_lengths(without) == pytest.approx(measure_segment_lengths(model))
    renamed = replace(
        without,
        markers=tuple(
            replace(m, name={"RLM": "RANK", "RMM": "RMMA"}.get(m.name, m.name)) for m in without.markers
        ),
    )
    assert measure_segment_lengths(renamed) == pytest.approx(measure_segment_lengths(model))
    bare = replace(without, markers=())
    assert "shank_r" not in measure_segment_lengths(bare)
    assert "femur_r" in measure_segment_lengths(bare)


def gliding_knee(default: float) -> BodyModel:
    """A femur of 0.4 m whose knee glides with flexion, with an offset frame in the tibia, scaled by 1.5."""
    glide = Shape((0.0, 2.0), ((0.02, -0.1, 0.03),))
    along, turn = (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)
    hip = (Joint("rotation", (0.0, 0.0, 1.0), Law.of("hip_flexion_r")),)
    knee = (
        Joint("translation", along, Law((Term(-0.43, parameter="size"),)), "femur_r"),
        Joint(
            "translation",
            along,
            Law((Term(1.0, parameter="size", coordinate="knee_angle_r", shape=glide),)),
            "femur_r",
        ),
        Joint("rotation", turn, Law.of("knee_angle_r")),
        Joint("translation", along, Law.constant(0.01)),
    )
    return BodyModel(
        name="gliding",
        segments=(
            Segment(name="pelvis", parent="ground", joint_name="root", joints=()),
            Segment(name="femur_r", parent="pelvis", joint_name="hip_r", joints=hip),
            Segment(name="tibia_r", parent="femur_r", joint_name="knee_r", joints=knee),
        ),
        coordinates=(
            Coordinate(name="hip_flexion_r", default=0.7),
            Coordinate(name="knee_angle_r", kind="translation", default=default),
        ),
        markers=(Marker.at("RAJC", "tibia_r", (0.0, -0.41, 0.0), weight=0.0),),
        parameters=(
            Parameter(
                name="size", value=1.5, unit="1", lower=0.8, upper=2.0, group="length", target="femur_r"
            ),
        ),
    )


@pytest.mark.parametrize("default", [0.0, 0.9])
def test_gliding_knee_is_measured_straight(default: float) -> None:
    """Also where OpenSim calls the coordinate coupled, hence not of kind rotation, or its default is bent."""
    lengths = measure_segment_lengths(gliding_knee(default))
    assert lengths["femur_r"] == pytest.approx(1.5 * (0.43 - 0.03))
    assert lengths["shank_r"] == pytest.approx(
        0.41 - 0.01
    )  # the joint centre lies 10 mm below the tibia's origin


def test_segments_are_known_by_several_names() -> None:
    model = load_builtin("lower_limb_14dof")
    for name in ("thigh_r", "r_femur", "R_Thigh"):
        other = replace(
            model,
            segments=tuple(
                replace(s, name=name)
                if s.name == "femur_r"
                else replace(s, parent=name)
                if s.parent == "femur_r"
                else s
                for s in model.segments
            ),
            markers=tuple(m for m in model.markers if m.segment != "femur_r"),
        )
        assert find_segment(other, "femur", "r") == name
        assert measure_segment_lengths(other)["femur_r"] == pytest.approx(0.43245)


@needs_opensim
@pytest.mark.parametrize(
    ("file", "expected"),
    [
        # distances between the published file's joint offsets on each body, by hand
        ("rajagopal_walk/Rajagopal2016.osim", {"inter_hip": 0.15452, "femur_r": 0.40805, "shank_l": 0.39647}),
        # tibia: its ankle is 0.43 m below its origin; femur: knee splines at zero flexion (-.00525, -.396)
        ("gait2354/gait2354_simbody.osim", {"inter_hip": 0.167, "femur_l": 0.39603, "shank_r": 0.43}),
    ],
)
def test_opensim_models(shared_data: Path, file: str, expected: dict[str, float]) -> None:
    lengths = measure_segment_lengths(read_osim(shared_data / file))
    assert {name: lengths[name] for name in expected} == pytest.approx(expected, abs=5e-4)


@needs_opensim
def test_expert_model_of_one_leg(shared_data: Path) -> None:
    """Right leg only, with image-based offset frames: lengths equal the distances of the expert's centres."""
    folder = shared_data / "jia_mri"
    joints = json.loads((folder / "reference_joints.json").read_text())["manual"]
    centre = {name: np.array(joints[name]["centre_mm"]) / 1000 for name in ("hip_r", "knee_r", "ankle_r")}
    lengths = measure_segment_lengths(read_osim(folder / "manual_model.osim"))
    assert "inter_hip" not in lengths
    assert lengths["femur_r"] == pytest.approx(np.linalg.norm(centre["hip_r"] - centre["knee_r"]), abs=1e-4)
    assert lengths["shank_r"] == pytest.approx(np.linalg.norm(centre["knee_r"] - centre["ankle_r"]), abs=1e-4)
