"""The built-in models: structure, symmetry, proportions, signs, inertia."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import yaml

from scaling_service.core.errors import InputError
from scaling_service.model.body import BodyModel, Shape
from scaling_service.model.builtin import BUILTIN_NAMES, expand, load_builtin, load_generic_person
from scaling_service.model.compile import compile_model, evaluate_shape, list_parameter_values
from scaling_service.model.poses import pose_neutral_frames, pose_neutral_markers
from scaling_service.model.reference import find_reference_folder
from scaling_service.numerics.multibody.tree import pose_markers

models = pytest.mark.parametrize("name", BUILTIN_NAMES)
legs = pytest.mark.parametrize("name", ["lower_limb_14dof", "lower_limb_feet_18dof", "full_body_35dof"])


def compared(model: BodyModel) -> list[str]:
    return [m.name for m in model.markers if m.weight > 0]


@pytest.mark.parametrize(
    ("name", "segments", "dof", "markers"),
    [
        ("lower_limb_14dof", 5, 14, 14),
        ("lower_limb_feet_18dof", 7, 18, 22),
        ("full_body_35dof", 16, 35, 47),
        ("squat_4dof", 5, 4, 13),
    ],
)
def test_counts_of_the_papers(name: str, segments: int, dof: int, markers: int) -> None:
    model = load_builtin(name)
    assert len(model.segments) == segments  # the squat's fifth is the fixed foot
    assert len(model.coordinates) == dof
    assert len(compared(model)) == markers


def test_unknown_name_lists_the_names() -> None:
    with pytest.raises(InputError) as caught:
        load_builtin("upper_limb")
    assert all(name in str(caught.value) for name in BUILTIN_NAMES)


@models
def test_every_number_has_a_source(name: str) -> None:
    document = yaml.safe_load((find_reference_folder() / f"{name}.yaml").read_text())
    places = document["markers"] + document.get("landmarks", [])
    places += [s["inertia"] for s in document["segments"]]
    places += [s["centre"] for s in document["segments"] if "centre" in s]
    assert all(len(place["source"]) > 5 for place in places)


@legs
def test_puchaud_markers_sit_on_the_segments_of_table_1(name: str) -> None:
    table = {
        "PSIS": "pelvis",
        "ASIS": "pelvis",
        "LFE": "femur",
        "MFE": "femur",
        "FH": "tibia",
        "LM": "tibia",
        "MM": "tibia",
    }
    for side in "RL":
        for marker, segment in table.items():
            expected = segment if segment == "pelvis" else f"{segment}_{side.lower()}"
            assert load_builtin(name).marker(side + marker).segment == expected


def test_lengths_are_the_mean_of_the_images() -> None:
    """Puchaud 2019, table 2, column EB, and the ratios to the mean stature."""
    frames = pose_neutral_frames(load_builtin("lower_limb_14dof"))
    markers = pose_neutral_markers(load_builtin("lower_limb_14dof"))
    femur = np.linalg.norm(frames["femur_r"][1] - frames["tibia_r"][1])
    shank = np.linalg.norm(frames["tibia_r"][1] - markers["RAJC"])
    hips = np.linalg.norm(frames["femur_r"][1] - frames["femur_l"][1])
    assert femur == pytest.approx((0.4318 + 0.4331) / 2)
    assert shank == pytest.approx((0.4157 + 0.4147) / 2)
    assert hips == pytest.approx(0.1735)
    height = load_generic_person("lower_limb_14dof").height_m
    assert np.array([femur, shank, hips]) / height == pytest.approx([0.2454, 0.2356, 0.0985], abs=1e-4)


def test_ankle_landmark_is_between_the_malleoli() -> None:
    markers = pose_neutral_markers(load_builtin("lower_limb_14dof"))
    for side in "RL":
        middle = (markers[f"{side}LM"] + markers[f"{side}MM"]) / 2
        np.testing.assert_allclose(markers[f"{side}AJC"], middle, atol=1e-12)


def mirrored_name(name: str) -> str:
    if name.endswith(("_r", "_l")):
        return name[:-1] + {"r": "l", "l": "r"}[name[-1]]
    return (
        {"R": "L", "L": "R"}[name[0]] + name[1:] if name not in ("L3", "C7", "T10", "CLAV", "STRN") else name
    )


@legs
def test_mirror(name: str) -> None:
    """Exchanging the coordinates of both sides gives the mirror image of the posture."""
    model = load_builtin(name)
    rng = np.random.default_rng(3)
    odd = ("pelvis_tz", "pelvis_rotation", "pelvis_list")
    odd += tuple(f"{part}_{kind}" for part in ("lumbar", "neck") for kind in ("bending", "rotation"))
    values = {c: float(rng.uniform(-0.6, 0.6)) for c in model.coordinate_names}
    reflected = {
        mirrored_name(c) if c.endswith(("_r", "_l")) else c: -v if c in odd else v for c, v in values.items()
    }
    here, there = pose_neutral_markers(model, values), pose_neutral_markers(model, reflected)
    for marker, place in here.items():
        np.testing.assert_allclose(there[mirrored_name(marker)], place * [1, 1, -1], atol=1e-12)
    for segment in model.segments:
        other = model.segment(mirrored_name(segment.name)) if segment.name.endswith(("_r", "_l")) else None
        if other is not None:
            assert other.com == (segment.com[0], segment.com[1], -segment.com[2])
            assert np.array(other.inertia) == pytest.approx(np.array(segment.inertia) * [1, 1, 1, 1, -1, -1])


@legs
def test_looks_like_a_person(name: str) -> None:
    at = pose_neutral_markers(load_builtin(name))
    for marker, place in at.items():
        if marker[0] in "RL" and marker != "L3":
            assert (place[2] > 0) == (marker[0] == "R"), marker
    assert at["RASIS"][0] > at["RPSIS"][0]
    assert at["RLFE"][2] > at["RMFE"][2]
    assert at["RLM"][2] > at["RMM"][2]
    assert at["RMM"][0] > at["RLM"][0]
    heights = [at[m][1] for m in ("RASIS", "RLFE", "RFH", "RMM", "RLM")]
    assert heights == sorted(heights, reverse=True)
    assert 0.0 < heights[-1] < 0.1


def test_whole_body_proportions() -> None:
    """Against Winter's fractions of stature, which are independent of the tables used."""
    model, person = load_builtin("full_body_35dof"), load_generic_person("full_body_35dof")
    at = pose_neutral_markers(model)
    origin = {segment: frame[1] for segment, frame in pose_neutral_frames(model).items()}
    height = person.height_m

    def apart(a: np.ndarray, b: np.ndarray) -> float:
        return float(np.linalg.norm(a - b)) / height

    assert apart(origin["humerus_r"], origin["ulna_r"]) == pytest.approx(0.186, abs=0.035)
    assert apart(origin["ulna_r"], origin["hand_r"]) == pytest.approx(0.146, abs=0.015)
    trunk = (origin["humerus_r"] + origin["humerus_l"] - origin["femur_r"] - origin["femur_l"]) / 2
    assert np.linalg.norm(trunk) / height == pytest.approx(0.288, abs=0.01)
    assert at["RFHD"][1] == pytest.approx(0.95 * height, abs=0.02)
    assert at["RTOE"][1] > 0.0
    assert sum(s.mass for s in model.segments) == pytest.approx(
        person.mass_kg, rel=0.003
    )  # table sums to 100.2 %


@pytest.mark.parametrize(
    ("coordinate", "marker", "relative", "direction"),
    [
        ("hip_flexion", "LFE", "ASIS", (1, 0, 0)),
        ("hip_adduction", "LFE", "ASIS", (0, 0, -1)),
        ("knee_angle", "LM", "LFE", (-1, 0, 0)),
        ("arm_flex", "ELB", "SHO", (1, 0, 0)),
        ("arm_add", "ELB", "SHO", (0, 0, -1)),
        ("elbow_flex", "WRA", "ELB", (1, 0, 0)),
        ("ankle_angle", "TOE", "HEE", (0, 1, 0)),
        ("wrist_flex", "MH2", "WRA", (0, 0, -1)),
        ("wrist_dev", "MH2", "WRA", (-1, 0, 0)),
    ],
)
@pytest.mark.parametrize("side", ["r", "l"])
def test_signs(coordinate: str, marker: str, relative: str, direction: tuple[int, ...], side: str) -> None:
    """A positive angle moves the far end as its name says; inward is -z on the right."""
    model, letter = load_builtin("full_body_35dof"), side.upper()
    outward = np.array(direction) * [1, 1, 1 if side == "r" else -1]
    before, after = pose_neutral_markers(model), pose_neutral_markers(model, {f"{coordinate}_{side}": 0.2})
    moved = (after[letter + marker] - after[letter + relative]) - (
        before[letter + marker] - before[letter + relative]
    )
    assert moved @ outward > 0.8 * np.linalg.norm(moved)


def test_rotation_inward_turns_the_toes_inward() -> None:
    model = load_builtin("full_body_35dof")
    for side, inward in (("r", -1), ("l", 1)):
        moved = pose_neutral_markers(model, {f"hip_rotation_{side}": 0.2})[f"{side.upper()}TOE"]
        assert inward * (moved - pose_neutral_markers(model)[f"{side.upper()}TOE"])[2] > 0


@pytest.mark.parametrize(("side", "inward"), [("r", -1.0), ("l", 1.0)])
def test_inversion_turns_the_sole_inward(side: str, inward: float) -> None:
    model = load_builtin("lower_limb_feet_18dof")
    turned = pose_neutral_frames(model, {f"ankle_inversion_{side}": 0.3})[f"calcn_{side}"][0]
    sole = turned @ np.array([0.0, -1.0, 0.0])
    assert inward * sole[2] == pytest.approx(math.sin(0.3))


def test_feet_are_the_whole_bodys() -> None:
    feet, whole = load_builtin("lower_limb_feet_18dof"), load_builtin("full_body_35dof")
    for name in ("RHEE", "RTOE", "RMT1", "RMT5", "LMT5"):
        assert feet.marker(name) == whole.marker(name)
    ours, theirs = feet.segment("calcn_l"), whole.segment("calcn_l")
    assert (ours.mass, ours.com, ours.inertia) == (theirs.mass, theirs.com, theirs.inertia)
    bent = {"ankle_angle_r": 0.3, "knee_angle_r": 0.5}
    np.testing.assert_allclose(
        pose_neutral_markers(feet, bent)["RTOE"], pose_neutral_markers(whole, bent)["RTOE"]
    )


@models
def test_inertia_can_exist(name: str) -> None:
    """Positive masses; principal moments obey the triangle inequality."""
    for segment in load_builtin(name).segments:
        xx, yy, zz, xy, xz, yz = segment.inertia
        moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        assert segment.mass > 0
        assert moments[0] > 0
        assert moments[0] + moments[1] > moments[2], segment.name


def test_inertia_follows_the_table() -> None:
    """Dumas 2007, male thigh, written out by hand."""
    thigh, mass, length = load_builtin("lower_limb_14dof").segment("femur_r"), 0.123 * 67.3, 0.43245
    assert thigh.mass == pytest.approx(mass)
    assert thigh.com == pytest.approx((-0.041 * length, -0.429 * length, 0.033 * length))
    radii = np.array([0.29, 0.15, 0.30, 0.07, 0.02, 0.07])
    assert thigh.inertia == pytest.approx(mass * (radii * length) ** 2 * [1, 1, 1, 1, -1, -1])


def test_squat_stays_in_its_plane_on_a_fixed_ankle() -> None:
    model = load_builtin("squat_4dof")
    bent = {"ankle_angle": -0.4, "knee_angle": 1.8, "hip_angle": -1.7, "shoulder_angle": 1.5}
    frames, markers = pose_neutral_frames(model, bent), pose_neutral_markers(model, bent)
    assert all(place[2] == 0 for place in markers.values())
    np.testing.assert_array_equal(frames["shank"][1], np.zeros(3))
    assert frames["thigh"][1][0] > 0.1  # knee forward
    assert frames["torso"][1][0] < 0.0  # hip backward
    assert frames["torso"][1][1] < 0.55  # and low


def test_squat_torso_is_the_whole_bodys_in_the_sagittal_plane() -> None:
    squat, whole = load_builtin("squat_4dof"), load_builtin("full_body_35dof")
    at, frames = pose_neutral_markers(whole), pose_neutral_frames(whole)
    hip, shoulder = frames["femur_r"][1], frames["humerus_r"][1]
    tilt = math.atan2(shoulder[0] - hip[0], shoulder[1] - hip[1])
    turn = np.array([[math.cos(tilt), -math.sin(tilt)], [math.sin(tilt), math.cos(tilt)]])
    pairs = {
        "ASI": "RASIS",
        "PSI": "RPSIS",
        "T10": "T10",
        "STRN": "STRN",
        "C7": "C7",
        "CLAV": "CLAV",
        "SHO": "RSHO",
    }
    for planar, name in pairs.items():
        expected = turn @ (at[name] - hip)[:2] * 1.68 / 1.762
        np.testing.assert_allclose(
            squat.marker(planar).nominal[:2], expected, atol=1.5e-4
        )  # rounded to 0.1 mm


@models
def test_kernels_agree_with_the_plain_evaluation(name: str) -> None:
    model, rng = load_builtin(name), np.random.default_rng(1)
    q = rng.uniform(-1.0, 1.0, (3, len(model.coordinates)))
    markers = pose_markers(compile_model(model), q, list_parameter_values(model))
    for row, frame in zip(q, markers, strict=True):
        expected = pose_neutral_markers(
            model, dict(zip(model.coordinate_names, map(float, row), strict=True))
        )
        np.testing.assert_allclose(frame, [expected[m] for m in model.marker_names], atol=1e-12)


def test_shape_continues_with_its_end_slopes() -> None:
    parabola = Shape((0.0, 1.0, 2.0), ((1.0, 0.0, 0.0), (1.0, 2.0, 1.0)))  # x squared, in two pieces
    assert [evaluate_shape(parabola, x) for x in (0.0, 0.5, 1.0, 1.5, 2.0)] == [0.0, 0.25, 1.0, 2.25, 4.0]
    assert evaluate_shape(parabola, 3.0) == 8.0
    assert evaluate_shape(parabola, -1.0) == 0.0


def test_compact_form_is_strict(tmp_path: Path) -> None:
    document = yaml.safe_load((find_reference_folder() / "squat_4dof.yaml").read_text())
    document["segments"][1]["inertia"]["mas_pct"] = 3
    with pytest.raises(InputError, match="mas_pct") as caught:
        expand(document, file="squat.yaml")
    assert caught.value.file == "squat.yaml"
    del document["segments"][1]["inertia"]["mas_pct"], document["segments"][2]["centre"]["source"]
    with pytest.raises(InputError, match="source"):
        expand(document, file="squat.yaml")
