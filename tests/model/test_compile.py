"""From names to arrays."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from scaling_service.model.body import BodyModel, Coordinate, Joint, Law, Marker, Segment
from scaling_service.model.compile import (
    compile_model,
    free_coordinates,
    list_coordinate_bounds,
    list_parameter_values,
    repeat_default_pose,
)
from scaling_service.model.parameters import free_scale
from scaling_service.model.poses import pose_neutral_frames
from scaling_service.numerics.multibody.laws import Fixed, Shift, Turn
from scaling_service.numerics.multibody.rigid import rotate_about
from scaling_service.numerics.multibody.tree import pose_markers
from tests.numerics.bodies import leg, leg_motion, random_tree, slow_batch


def test_markers_come_in_the_order_asked_for() -> None:
    rng = np.random.default_rng(0)
    model, q = leg(rng), leg_motion(rng, 2)
    every = pose_markers(compile_model(model), q, np.zeros(0))
    some = ("tibia2", "pelvis0", "femur3")
    columns = [model.marker_names.index(name) for name in some]
    found = pose_markers(compile_model(model, some), q, np.zeros(0))
    np.testing.assert_allclose(found, every[:, columns], rtol=0, atol=1e-15)


def test_segments_without_markers_are_left_out_but_never_the_ones_that_carry_them() -> None:
    model = leg(np.random.default_rng(0))
    assert len(compile_model(model, ("pelvis0",)).links) == 1
    assert len(compile_model(model, ("tibia0",)).links) == 3
    tree = compile_model(model, ("pelvis0",))
    assert (tree.n_coordinates, tree.n_markers) == (10, 1), "variables keep their numbers"


def test_an_unknown_marker_is_an_error() -> None:
    with pytest.raises(KeyError, match="nose"):
        compile_model(leg(np.random.default_rng(0)), ("nose",))


@settings(max_examples=20)
@given(seed=st.integers(0, 10_000))
def test_merging_constant_moves_moves_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = random_tree(rng, 3)
    constants = [
        Joint("rotation" if rng.random() < 0.5 else "translation", joint.axis, Law.constant(rng.normal()))
        for _, joint in model.joints()
    ]
    segments = tuple(
        replace(s, joints=(*constants[k : k + 4], *s.joints, *constants[k + 1 : k + 3]))
        for k, s in enumerate(model.segments)
    )
    model = replace(model, segments=segments)
    q = rng.uniform(-2.0, 2.0, (2, len(model.coordinates)))
    tree = compile_model(model)
    np.testing.assert_allclose(
        pose_markers(tree, q, np.zeros(0)), slow_batch(model, q, np.zeros(0)), rtol=0, atol=1e-13
    )
    for link in tree.links:
        kinds = [type(move) for move in link.moves]
        assert all((a, b) not in ((Fixed, Fixed), (Shift, Shift)) for a, b in pairwise(kinds))


def test_turns_about_coordinate_axes_need_no_constant_rotation() -> None:
    tree = compile_model(leg(np.random.default_rng(0), coupled=False))
    moves = [move for link in tree.links for move in link.moves]
    assert not any(isinstance(move, Fixed) for move in moves)
    assert sum(isinstance(move, Turn) for move in moves) == 7


def test_a_turn_about_a_negative_axis_turns_the_other_way() -> None:
    joint = Joint("rotation", (0.0, 0.0, -1.0), Law.of("a", 2.0, 0.1))
    model = BodyModel(
        name="one",
        segments=(Segment(name="s", parent="ground", joint_name="j", joints=(joint,)),),
        coordinates=(Coordinate(name="a"),),
        markers=(Marker.at("m", "s", (1.0, 0, 0)),),
    )
    found = pose_markers(compile_model(model), np.array([[0.3]]), np.zeros(0))[0, 0]
    np.testing.assert_allclose(found, [np.cos(0.7), -np.sin(0.7), 0.0], atol=1e-15)


def test_the_neutral_pose_is_that_of_the_plain_recursion() -> None:
    model = leg(np.random.default_rng(1))
    frames = pose_neutral_frames(model)
    found = pose_markers(compile_model(model), repeat_default_pose(model, 1), list_parameter_values(model))[0]
    for marker, at in zip(model.markers, found, strict=True):
        rotation, origin = frames[marker.segment]
        np.testing.assert_allclose(at, rotation @ np.array(marker.nominal) + origin, atol=1e-14)


@given(seed=st.integers(0, 1000), angle=st.floats(-7.0, 7.0))
def test_rotation_about_an_axis_equals_scipys(seed: int, angle: float) -> None:
    axis = np.random.default_rng(seed).normal(size=3)
    axis /= np.linalg.norm(axis)
    expected = Rotation.from_rotvec(axis * angle).as_matrix()
    np.testing.assert_allclose(rotate_about(axis, angle), expected, atol=1e-13)


def test_bounds_bind_only_where_clamped_and_locked_is_not_free() -> None:
    coordinates = (
        Coordinate(name="a", lower=-1.0, upper=2.0, clamped=True, default=0.5),
        Coordinate(name="b", lower=-1.0, upper=2.0),
        Coordinate(name="c", locked=True),
    )
    model = BodyModel(name="m", segments=(), coordinates=coordinates)
    low, high = list_coordinate_bounds(model)
    assert low.tolist() == [-1.0, -np.inf, -np.inf]
    assert high.tolist() == [2.0, np.inf, np.inf]
    assert free_coordinates(model).tolist() == [True, True, False]
    assert repeat_default_pose(model, 2).tolist() == [[0.5, 0.0, 0.0]] * 2


def test_parameters_come_in_order() -> None:
    model = free_scale(free_scale(leg(np.random.default_rng(0)), "tibia", 0.1), "pelvis", 0.1)
    assert [p.name for p in model.parameters] == ["scale.tibia", "scale.pelvis"]
    assert list_parameter_values(model).tolist() == [1.0, 1.0]
