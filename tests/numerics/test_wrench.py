"""Newton-Euler against Pinocchio, d'Alembert's principle on point masses, closed forms and balances."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scaling_service.model.body import BodyModel, Coordinate, Joint, Law, Parameter, Segment
from scaling_service.model.builtin import BUILTIN_NAMES, load_builtin
from scaling_service.model.compile import list_parameter_values
from scaling_service.model.inertia import compile_mechanism, sum_mass
from scaling_service.numerics.multibody.motion import Motion, move_links, point_velocity
from scaling_service.numerics.wrench import GRAVITY as DOWN
from scaling_service.numerics.wrench import Loads, compute_inverse_dynamics, compute_root_wrench, move_moment
from tests.numerics.bodies import leg, random_tree
from tests.numerics.massive import (
    GRAVITY,
    as_point_masses,
    in_pinocchio,
    random_motion,
    slow_forces,
    with_random_masses,
)

NONE = np.zeros(0)
SEEDS = st.integers(0, 10**6)


@settings(max_examples=20)
@given(seed=SEEDS, n_segments=st.integers(1, 7))
def test_joint_forces_equal_pinocchios(seed: int, n_segments: int) -> None:
    pin = pytest.importorskip("pinocchio", reason="pinocchio is not installed")
    rng = np.random.default_rng(seed)
    model = with_random_masses(random_tree(rng, n_segments), rng)
    peer, order = in_pinocchio(pin, model)
    motion = random_motion(rng, len(order), 3)
    forces = compute_inverse_dynamics(compile_mechanism(model), motion, NONE, gravity=GRAVITY).forces
    data = peer.createData()
    for k in range(motion.n):
        expected = pin.rnea(peer, data, motion.q[order, k], motion.qdot[order, k], motion.qddot[order, k])
        scale = max(1.0, float(np.abs(expected).max()))
        np.testing.assert_allclose(forces[order, k], expected, rtol=0, atol=1e-11 * scale)


@pytest.mark.parametrize("scaled", [False, True])
def test_forces_of_spline_coupled_joints_follow_from_dalembert(scaled: bool) -> None:
    rng = np.random.default_rng(3)
    model = leg(rng, coupled=True, markers_each=5)
    model = with_glides_scaled(model, 1.7) if scaled else model
    masses = rng.uniform(0.5, 2.0, len(model.markers))
    model, n, p = as_point_masses(model, masses), 6, list_parameter_values(model)
    motion = random_motion(rng, len(model.coordinates), n)
    forces = compute_inverse_dynamics(compile_mechanism(model), motion, p, gravity=GRAVITY).forces
    for k in range(n):
        state = (motion.q[:, k], motion.qdot[:, k], motion.qddot[:, k])
        expected = slow_forces(model, masses, state, p)
        np.testing.assert_allclose(forces[:, k], expected, rtol=0, atol=1e-8 * np.abs(expected).max())


def with_glides_scaled(model: BodyModel, factor: float) -> BodyModel:
    """The knee's glides times a shared parameter."""
    glide = Parameter(
        name="glide", value=factor, unit="1", lower=0.0, upper=3.0, group="length", target="knee"
    )
    tibia = model.segment("tibia")
    joints = tuple(
        replace(j, law=Law(tuple(replace(t, parameter="glide" if t.shape else None) for t in j.law.terms)))
        for j in tibia.joints
    )
    segments = (*model.segments[:2], replace(tibia, joints=joints))
    return replace(model, segments=segments, parameters=(glide,))


def swinging(t: np.ndarray, model: BodyModel, rng: np.random.Generator) -> Motion:
    """A smooth motion of any model with its exact rates."""
    size, pace, phase = rng.uniform(0.1, 0.4, (3, len(model.coordinates), 1)) * [[[1]], [[10]], [[9]]]
    return Motion(
        size * np.sin(pace * t + phase),
        size * pace * np.cos(pace * t + phase),
        -size * pace**2 * np.sin(pace * t + phase),
    )


@pytest.mark.parametrize("name", BUILTIN_NAMES)
def test_the_net_wrench_is_the_rate_of_momentum_less_gravity(name: str) -> None:
    model = load_builtin(name)
    mechanism = compile_mechanism(model)
    step = 2e-3
    t = step * np.arange(9)
    motion = swinging(t, model, np.random.default_rng(1))
    wrench, _ = compute_root_wrench(mechanism, motion, NONE)
    state = move_links(mechanism, motion, NONE)
    inertias, axes = mechanism.inertias, state.poses.axes
    at = np.einsum("kjan,kj->kan", axes, inertias.com) + state.poses.origins
    linear = inertias.mass[:, None, None] * point_velocity(state.twists, at)
    spin = np.einsum("kjan,kji,kibn,kbn->kan", axes, inertias.tensor, axes, state.twists[:, 3:])
    angular = np.cross(at, linear, axis=1) + spin
    momentum = np.concatenate([linear, angular], axis=1).sum(axis=0)
    weights = np.array([3, -32, 168, -672, 0, 672, -168, 32, -3]) / 840.0  # central, eighth order
    rate = momentum @ weights / step
    weight = sum_mass(model) * DOWN
    pull = np.concatenate([weight, np.cross((inertias.mass[:, None] * at[..., 4]).sum(axis=0), DOWN)])
    np.testing.assert_allclose(wrench[:, 4], rate - pull, rtol=0, atol=1e-6 * np.abs(weight).max())


def pendulum() -> BodyModel:
    bob = Segment(
        name="bob",
        parent="ground",
        joint_name="pin",
        joints=(Joint("rotation", (0.0, 0.0, 1.0), Law.of("angle")),),
    )
    bob = replace(bob, mass=2.0, com=(0.0, -0.7, 0.0), inertia=(0.1, 0.2, 0.3, 0.0, 0.0, 0.0))
    return BodyModel(name="pendulum", segments=(bob,), coordinates=(Coordinate(name="angle"),))


def test_a_pendulum_needs_the_torque_of_its_closed_form() -> None:
    motion = random_motion(np.random.default_rng(0), 1, 5)
    result = compute_inverse_dynamics(compile_mechanism(pendulum()), motion, NONE)
    torque = (0.3 + 2.0 * 0.7**2) * motion.qddot + 2.0 * 9.80665 * 0.7 * np.sin(motion.q)
    np.testing.assert_allclose(result.forces, torque, rtol=0, atol=1e-12)
    np.testing.assert_allclose(result.residual[5], torque[0], rtol=0, atol=1e-12)  # the pin is the origin
    pull = 2.0 * 0.7 * motion.qdot[0] ** 2 + 2.0 * 9.80665 * np.cos(motion.q[0])
    towards_pin = -np.sin(motion.q[0]) * result.residual[0] + np.cos(motion.q[0]) * result.residual[1]
    np.testing.assert_allclose(towards_pin, pull, rtol=0, atol=1e-12)


def test_a_load_that_bears_the_weight_leaves_no_residual_and_acts_through_the_joints() -> None:
    rng = np.random.default_rng(8)
    model = with_random_masses(leg(rng, coupled=False), rng)
    mechanism, n = compile_mechanism(model), 4
    still = Motion(rng.normal(size=(10, n)), np.zeros((10, n)), np.zeros((10, n)))
    needed, root = compute_root_wrench(mechanism, still, NONE)
    loads = Loads(np.array([2]), needed[None])
    borne, free = (
        compute_inverse_dynamics(mechanism, still, NONE, loads),
        compute_inverse_dynamics(mechanism, still, NONE),
    )
    np.testing.assert_allclose(borne.residual, 0.0, rtol=0, atol=1e-12)
    np.testing.assert_allclose(borne.forces[:6], 0.0, rtol=0, atol=1e-12)
    knee = move_moment(needed, move_links(mechanism, still, NONE).poses.origins[2])[3:]
    axis = move_links(mechanism, still, NONE).poses.axes[2, 2]
    np.testing.assert_allclose(
        free.forces[9] - borne.forces[9], (axis * knee).sum(axis=0), rtol=0, atol=1e-12
    )
    np.testing.assert_allclose(free.residual, move_moment(needed, root), rtol=0, atol=1e-12)


def test_power_of_the_joint_forces_is_the_rate_of_energy() -> None:
    rng = np.random.default_rng(5)
    model = with_random_masses(leg(rng, coupled=True), rng)
    mechanism, step = compile_mechanism(model), 1e-3
    motion = swinging(step * np.arange(9), model, rng)
    power = (compute_inverse_dynamics(mechanism, motion, NONE).forces * motion.qdot).sum(axis=0)
    state = move_links(mechanism, motion, NONE)
    inertias, axes = mechanism.inertias, state.poses.axes
    at = np.einsum("kjan,kj->kan", axes, inertias.com) + state.poses.origins
    spin = np.einsum("kjan,kan->kjn", axes, state.twists[:, 3:])
    energy = 0.5 * np.einsum("kjn,kji,kin->n", spin, inertias.tensor, spin)
    energy += np.einsum("k,kan->n", 0.5 * inertias.mass, point_velocity(state.twists, at) ** 2)
    energy -= np.einsum("k,kan,a->n", inertias.mass, at, DOWN)
    weights = np.array([3, -32, 168, -672, 0, 672, -168, 32, -3]) / 840.0
    assert power[4] == pytest.approx(energy @ weights / step, rel=1e-7)


def test_blocks_and_batches_change_nothing_and_a_missing_frame_stays_alone() -> None:
    rng = np.random.default_rng(2)
    model = load_builtin("full_body_35dof")
    mechanism = compile_mechanism(model)
    q, qdot, qddot = rng.uniform(-0.5, 0.5, (3, 4, 5, 35))  # samples, frames, coordinates
    together = compute_inverse_dynamics(mechanism, Motion.of_frames(q, qdot, qddot), NONE)
    q[2, 3, 11] = np.nan
    for k in range(4):
        alone = compute_inverse_dynamics(mechanism, Motion.of_frames(q[k], qdot[k], qddot[k]), NONE)
        rows = slice(5 * k, 5 * k + 5)
        whole = np.array([k != 2 or frame != 3 for frame in range(5)])
        np.testing.assert_allclose(alone.forces[:, whole], together.forces[:, rows][:, whole], atol=1e-10)
        np.testing.assert_allclose(alone.residual[:, whole], together.residual[:, rows][:, whole], atol=1e-10)
        assert np.isnan(alone.residual[:, ~whole]).all()
