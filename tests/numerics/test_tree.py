"""Forward kinematics and Jacobians against a slow recursion and against Pinocchio."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scaling_service.model.body import BodyModel
from scaling_service.model.compile import compile_model, list_parameter_values
from scaling_service.model.parameters import free_axis, free_marker, free_scale
from scaling_service.numerics.multibody.tree import (
    Tree,
    compute_jacobian,
    place_tree_markers,
    pose_links,
    pose_markers,
)
from tests.numerics.bodies import (
    Array,
    all_names,
    leg,
    leg_motion,
    random_tree,
    slow_batch,
    slow_jacobian,
)

SEEDS = st.integers(0, 10_000)


def fast_jacobian(tree: Tree, q: Array, p: Array) -> Array:
    """(n_frames, n_markers, 3, n_variables)."""
    poses = pose_links(tree, np.ascontiguousarray(q.T), p)
    variables = np.arange(tree.n_coordinates + tree.n_parameters)
    return np.moveaxis(
        compute_jacobian(tree, poses, place_tree_markers(tree, poses), variables), (0, 3), (3, 0)
    )


def freed_leg(rng: np.random.Generator) -> BodyModel:
    """A leg with spline-coupled knee, scale factors, a tilted axis and free markers, off their start."""
    model = leg(rng)
    for segment in ("pelvis", "femur", "tibia"):
        model = free_scale(model, segment, 0.2)
    model = free_axis(model, "knee", 0.3, 0.5)
    model = free_marker(model, "tibia0", "xyz", 0.05)
    model = free_marker(model, "pelvis1", "xz", 0.05)
    moved = (replace(p, value=p.value + rng.uniform(-0.05, 0.05)) for p in model.parameters)
    return replace(model, parameters=tuple(moved))


@settings(max_examples=25)
@given(seed=SEEDS, n_segments=st.integers(1, 6))
def test_random_trees_stand_where_the_slow_recursion_puts_them(seed: int, n_segments: int) -> None:
    rng = np.random.default_rng(seed)
    model = random_tree(rng, n_segments)
    q = rng.uniform(-2.0, 2.0, (3, len(model.coordinates)))
    found = pose_markers(compile_model(model), q, np.zeros(0))
    np.testing.assert_allclose(found, slow_batch(model, q, np.zeros(0)), rtol=0.0, atol=1e-13)


@settings(max_examples=15)
@given(seed=SEEDS, n_segments=st.integers(1, 5))
def test_jacobians_of_random_trees_equal_the_complex_step(seed: int, n_segments: int) -> None:
    rng = np.random.default_rng(seed)
    model = random_tree(rng, n_segments)
    q = rng.uniform(-2.0, 2.0, (2, len(model.coordinates)))
    slow = slow_jacobian(model, q, np.zeros(0), all_names(model))
    np.testing.assert_allclose(
        fast_jacobian(compile_model(model), q, np.zeros(0)), slow, rtol=0.0, atol=1e-12
    )


@settings(max_examples=15)
@given(seed=SEEDS)
def test_freed_numbers_and_coupled_joints_move_markers_as_they_should(seed: int) -> None:
    rng = np.random.default_rng(seed)
    model, p = (m := freed_leg(rng)), list_parameter_values(m)
    q = leg_motion(rng, 4)
    tree = compile_model(model)
    np.testing.assert_allclose(pose_markers(tree, q, p), slow_batch(model, q, p), rtol=0.0, atol=1e-13)
    slow = slow_jacobian(model, q, p, all_names(model))
    assert (np.abs(slow).max(axis=(0, 1, 2)) > 1e-3).all(), "every variable moves some marker"
    np.testing.assert_allclose(fast_jacobian(tree, q, p), slow, rtol=0.0, atol=1e-12)


def test_a_batch_of_four_equals_four_single_calls() -> None:
    rng = np.random.default_rng(3)
    model, p = (m := freed_leg(rng)), list_parameter_values(m)
    tree, q = compile_model(model), leg_motion(rng, 4)
    together, derivatives = pose_markers(tree, q, p), fast_jacobian(tree, q, p)
    for k in range(4):
        np.testing.assert_allclose(pose_markers(tree, q[k : k + 1], p)[0], together[k], rtol=0, atol=1e-15)
        np.testing.assert_allclose(
            fast_jacobian(tree, q[k : k + 1], p)[0], derivatives[k], rtol=0, atol=1e-15
        )


def test_only_the_variables_asked_for_are_derived_in_the_order_asked_for() -> None:
    rng = np.random.default_rng(4)
    model, p = (m := freed_leg(rng)), list_parameter_values(m)
    tree, q = compile_model(model), leg_motion(rng, 2)
    poses = pose_links(tree, np.ascontiguousarray(q.T), p)
    placed = place_tree_markers(tree, poses)
    some = np.array([12, 3, 9])
    every = compute_jacobian(tree, poses, placed, np.arange(tree.n_coordinates + tree.n_parameters))
    np.testing.assert_array_equal(compute_jacobian(tree, poses, placed, some), every[some])
    moving = np.asarray((every[: tree.n_coordinates] != 0.0).any(axis=(2, 3))).T
    np.testing.assert_array_equal(tree.followed, moving)


def test_moving_the_ground_origin_moves_every_marker_alike() -> None:
    rng = np.random.default_rng(5)
    model = leg(rng)
    tree, q, ground = compile_model(model), leg_motion(rng, 3), rng.normal(size=(3, 3))
    p = np.zeros(0)
    moved = place_tree_markers(tree, pose_links(tree, np.ascontiguousarray(q.T), p, ground=ground))
    np.testing.assert_allclose(
        np.moveaxis(moved, -1, 0), pose_markers(tree, q, p) + ground.T[:, None], rtol=0, atol=1e-14
    )


@settings(max_examples=15)
@given(seed=SEEDS, n_segments=st.integers(1, 6))
def test_positions_and_velocities_equal_pinocchios(seed: int, n_segments: int) -> None:
    pin = pytest.importorskip("pinocchio", reason="pinocchio is not installed")
    rng = np.random.default_rng(seed)
    model = random_tree(rng, n_segments)
    peer, order, frames = _in_pinocchio(pin, model)
    q, qdot = rng.uniform(-2.0, 2.0, (2, len(order)))
    data = peer.createData()
    pin.forwardKinematics(peer, data, q[order], qdot[order])
    pin.updateFramePlacements(peer, data)
    expected = np.array([data.oMf[f].translation for f in frames])
    speed = [pin.getFrameVelocity(peer, data, f, pin.LOCAL_WORLD_ALIGNED).linear for f in frames]
    tree = compile_model(model)
    np.testing.assert_allclose(pose_markers(tree, q[None], np.zeros(0))[0], expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(fast_jacobian(tree, q[None], np.zeros(0))[0] @ qdot, speed, rtol=0, atol=1e-12)


def _in_pinocchio(pin, model: BodyModel):  # type: ignore[no-untyped-def]  # pinocchio has no stubs
    """The same tree in Pinocchio, which coordinate each of its joints is, and the markers' frames."""
    peer, carrier, order = pin.Model(), {"ground": (0, pin.SE3.Identity())}, []
    for segment in model.segments:
        joint_id, placement = carrier[segment.parent]
        for joint in segment.joints:
            axis = np.array(joint.axis)
            if joint.law.is_constant:
                value = joint.law.constant_part
                turn = pin.exp3(axis * value) if joint.kind == "rotation" else np.eye(3)
                shift = axis * value if joint.kind == "translation" else np.zeros(3)
                placement = placement * pin.SE3(turn, shift)
                continue
            kind = (
                pin.JointModelRevoluteUnaligned
                if joint.kind == "rotation"
                else pin.JointModelPrismaticUnaligned
            )
            name = joint.law.terms[0].coordinate
            joint_id = peer.addJoint(joint_id, kind(axis), placement, name)
            placement = pin.SE3.Identity()
            order.append(model.coordinate_names.index(name))
        carrier[segment.name] = (joint_id, placement)
    frames = []
    for marker in model.markers:
        joint_id, placement = carrier[marker.segment]
        at = placement * pin.SE3(np.eye(3), np.array(marker.nominal))
        frames.append(peer.addFrame(pin.Frame(marker.name, joint_id, at, pin.FrameType.OP_FRAME)))
    return peer, np.array(order), frames
