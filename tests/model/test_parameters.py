"""Freeing numbers of a model and folding them back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from scaling_service.model.body import BodyModel
from scaling_service.model.compile import compile_model, list_parameter_values
from scaling_service.model.parameters import fold, free_axis, free_marker, free_scale, free_scale_axes
from scaling_service.model.poses import pose_neutral_frames
from scaling_service.model.scaling import scale_model
from scaling_service.numerics.multibody.tree import pose_markers
from tests.numerics.bodies import leg, leg_motion

FACTORS = st.floats(0.8, 1.2)
ANGLES = st.floats(-0.5, 0.5)


def body() -> BodyModel:
    return leg(np.random.default_rng(0))


def placed(model: BodyModel, q: np.ndarray) -> np.ndarray:
    return pose_markers(compile_model(model), q, list_parameter_values(model))


@pytest.mark.parametrize(
    "freed",
    [
        free_scale(body(), "femur", 0.2),
        free_axis(body(), "knee", 0.3, 0.5),
        free_axis(body(), "hip", 0.3, 0.5),
        free_marker(body(), "tibia1", "xyz", 0.05),
    ],
    ids=lambda model: model.parameters[0].group + "." + model.parameters[0].target,
)
def test_freeing_alone_moves_nothing(freed: BodyModel) -> None:
    q = leg_motion(np.random.default_rng(1), 5)
    np.testing.assert_allclose(placed(freed, q), placed(body(), q), rtol=0, atol=1e-14)


@given(factor=FACTORS)
def test_a_scale_factor_multiplies_what_lies_in_the_segment_and_nothing_else(factor: float) -> None:
    plain, scaled = body(), fold(free_scale(body(), "femur", 0.2), {"scale.femur": factor})
    for a, b in zip(plain.markers, scaled.markers, strict=True):
        ratio = factor if a.segment == "femur" else 1.0
        np.testing.assert_allclose(b.nominal, np.array(a.nominal) * ratio, rtol=1e-14)
    before, after = pose_neutral_frames(plain), pose_neutral_frames(scaled)
    length, scaled_length = (frames["tibia"][1] - frames["femur"][1] for frames in (before, after))
    np.testing.assert_allclose(scaled_length, factor * length, rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(after["femur"][1], before["femur"][1], atol=1e-15)


def test_markers_that_do_not_follow_the_size_stay() -> None:
    model = body()
    still = replace(model.marker("femur0"), follows_size=False)
    model = model.with_markers(tuple(still if m.name == still.name else m for m in model.markers))
    scaled = fold(free_scale(model, "femur", 0.2), {"scale.femur": 1.1})
    assert scaled.marker("femur0").nominal == pytest.approx(model.marker("femur0").nominal)
    assert scaled.marker("femur1").nominal != pytest.approx(model.marker("femur1").nominal)


@given(factor=FACTORS, shift=st.floats(-0.05, 0.05), scale_first=st.booleans())
def test_a_marker_shift_is_not_scaled(factor: float, shift: float, scale_first: bool) -> None:
    model = body()
    model = free_scale(model, "femur", 0.2) if scale_first else free_marker(model, "femur0", "y", 0.05)
    model = free_marker(model, "femur0", "y", 0.05) if scale_first else free_scale(model, "femur", 0.2)
    folded = fold(model, {"scale.femur": factor, "marker.femur0.y": shift})
    expected = np.array(body().marker("femur0").nominal) * factor + [0.0, shift, 0.0]
    np.testing.assert_allclose(folded.marker("femur0").nominal, expected, atol=1e-15)


@settings(max_examples=30)
@given(x=ANGLES, y=ANGLES)
def test_a_tilt_turns_the_axis_and_leaves_the_neutral_pose(x: float, y: float) -> None:
    plain = leg(np.random.default_rng(0), coupled=False)
    tilted = fold(free_axis(plain, "knee", 0.6, 0.6), {"axis.knee.x": x, "axis.knee.y": y})
    for name, (rotation, origin) in pose_neutral_frames(plain).items():
        np.testing.assert_allclose(pose_neutral_frames(tilted)[name][0], rotation, atol=1e-14)
        np.testing.assert_allclose(pose_neutral_frames(tilted)[name][1], origin, atol=1e-14)
    bent = pose_neutral_frames(tilted, {"knee": -1.0})
    turn = Rotation.from_matrix(bent["femur"][0].T @ bent["tibia"][0]).as_rotvec()
    axis = Rotation.from_euler("y", y).as_matrix() @ Rotation.from_euler("x", x).as_matrix() @ [0.0, 0.0, 1.0]
    np.testing.assert_allclose(turn, -1.0 * axis, atol=1e-12)


def test_folding_gives_the_same_body_without_parameters() -> None:
    rng = np.random.default_rng(2)
    model = free_marker(free_axis(free_scale(body(), "femur", 0.2), "knee", 0.3, 0.3), "tibia0", "xz", 0.05)
    values = {p.name: p.value + rng.uniform(-0.05, 0.05) for p in model.parameters}
    moved = replace(model, parameters=tuple(replace(p, value=values[p.name]) for p in model.parameters))
    q = leg_motion(rng, 4)
    np.testing.assert_allclose(placed(fold(moved), q), placed(moved, q), rtol=0, atol=1e-14)
    np.testing.assert_allclose(placed(fold(model, values), q), placed(moved, q), rtol=0, atol=1e-14)
    assert fold(moved).parameters == ()
    np.testing.assert_allclose(placed(fold(model), q), placed(body(), q), rtol=0, atol=1e-14)


def test_parameters_say_what_they_are() -> None:
    model = free_marker(free_axis(free_scale(body(), "femur", 0.2), "knee", 0.3, 0.5), "tibia0", "xz", 0.05)
    described = {p.name: (p.unit, p.lower, p.upper, p.group, p.target) for p in model.parameters}
    assert described == {
        "scale.femur": ("1", 0.8, 1.2, "length", "femur"),
        "axis.knee.x": ("rad", -0.3, 0.3, "axis", "knee"),
        "axis.knee.y": ("rad", -0.5, 0.5, "axis", "knee"),
        "marker.tibia0.x": ("m", -0.05, 0.05, "marker", "tibia0"),
        "marker.tibia0.z": ("m", -0.05, 0.05, "marker", "tibia0"),
    }


def test_a_number_is_freed_once() -> None:
    with pytest.raises(ValueError, match="one parameter"):
        free_scale(_scaled_twice_ready(), "femur", 0.2)


def _scaled_twice_ready() -> BodyModel:
    once = free_scale(body(), "femur", 0.2)
    return replace(once, parameters=())


def test_a_joint_without_a_turn_has_no_axis() -> None:
    root = body().segments[0]
    still = replace(root, joints=root.joints[:3])
    with pytest.raises(ValueError, match="no rotation"):
        free_axis(replace(body(), segments=(still, *body().segments[1:])), "root", 0.1, 0.1)


@given(y=FACTORS, z=FACTORS)
def test_factors_along_axes_are_those_of_scaling(y: float, z: float) -> None:
    model = body()
    freed = free_scale_axes(model, "femur", "yz", 0.2)
    folded = fold(freed, {"scale.femur.y": y, "scale.femur.z": z})
    q = leg_motion(np.random.default_rng(1), 4)
    expected = scale_model(model, {"femur": (0.5 * (y + z), y, z)})
    np.testing.assert_allclose(placed(folded, q), placed(expected, q), rtol=0, atol=1e-13)
    np.testing.assert_allclose(placed(freed, q), placed(model, q), rtol=0, atol=1e-13)


def test_three_axes_alike_are_one_factor() -> None:
    freed = free_scale_axes(body(), "tibia", "xyz", 0.2)
    assert [p.name for p in freed.parameters] == [f"scale.tibia.{a}" for a in "xyz"]
    q = leg_motion(np.random.default_rng(1), 4)
    apart = fold(freed, {f"scale.tibia.{a}": 1.1 for a in "xyz"})
    together = fold(free_scale(body(), "tibia", 0.2), {"scale.tibia": 1.1})
    np.testing.assert_allclose(placed(apart, q), placed(together, q), rtol=0, atol=1e-13)
