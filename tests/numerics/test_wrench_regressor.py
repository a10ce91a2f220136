"""The regressor against inverse dynamics, and its base parameters against Pinocchio and closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from scaling_service.model.builtin import BUILTIN_NAMES, builtin
from scaling_service.model.inertia import inertias_of, mechanism_of, with_inertias
from scaling_service.numerics.multibody.mechanism import Inertias
from scaling_service.numerics.wrench.base_parameters import base_parameters, triangular_factor
from scaling_service.numerics.wrench.ground_wrench import inverse_dynamics
from scaling_service.numerics.wrench.regressor import regressor_blocks
from tests.numerics.bodies import leg, random_tree
from tests.numerics.massive import GRAVITY, in_pinocchio, random_motion, with_random_masses
from tests.numerics.test_wrench import pendulum

NONE = np.zeros(0)


@pytest.mark.parametrize("name", BUILTIN_NAMES)
def test_regressor_times_parameters_is_the_wrench_and_the_joint_forces(name: str) -> None:
    mechanism = mechanism_of(builtin(name))
    motion = random_motion(np.random.default_rng(0), mechanism.tree.n_coordinates, 11)
    parameters = mechanism.inertias.parameters().ravel()
    known = inverse_dynamics(mechanism, motion, NONE)
    scale = np.abs(known.forces).max()
    for block in regressor_blocks(mechanism, motion, NONE, joints=True, size=4):
        ground = known.residual[:, block.rows].T
        np.testing.assert_allclose(block.ground @ parameters, ground, rtol=0, atol=1e-11 * scale)
        assert block.joints is not None
        joints = known.forces[:, block.rows].T
        np.testing.assert_allclose(block.joints @ parameters, joints, rtol=0, atol=1e-11 * scale)


def test_the_regressor_of_coupled_joints_gives_their_forces() -> None:
    rng = np.random.default_rng(3)
    mechanism = mechanism_of(with_random_masses(leg(rng, coupled=True), rng))
    motion = random_motion(rng, 10, 5)
    known = inverse_dynamics(mechanism, motion, NONE)
    (block,) = regressor_blocks(mechanism, motion, NONE, joints=True)
    assert block.joints is not None
    given = block.joints @ mechanism.inertias.parameters().ravel()
    np.testing.assert_allclose(given, known.forces.T, rtol=0, atol=1e-11 * np.abs(known.forces).max())


def stacked(mechanism, motion, joints):  # type: ignore[no-untyped-def]  # blocks of either kind
    blocks = regressor_blocks(mechanism, motion, NONE, joints=joints, gravity=GRAVITY)
    return triangular_factor((b.joints if joints else b.ground) for b in blocks)


def test_the_structural_rank_is_pinocchios() -> None:
    pin = pytest.importorskip("pinocchio", reason="pinocchio is not installed")
    rng = np.random.default_rng(6)
    model = with_random_masses(random_tree(rng, 5), rng)
    peer, order = in_pinocchio(pin, model)
    motion, data = random_motion(rng, len(order), 40), peer.createData()
    rows = [
        pin.computeJointTorqueRegressor(
            peer, data, motion.q[order, k], motion.qdot[order, k], motion.qddot[order, k]
        ).copy()
        for k in range(motion.n)
    ]
    massive = np.repeat([inertia.mass > 0 for inertia in list(peer.inertias)[1:]], 10)
    ours = base_parameters(stacked(mechanism_of(model), motion, True))
    assert ours.rank == np.linalg.matrix_rank(np.concatenate(rows)[:, massive], tol=1e-8)


def test_a_pendulum_has_three_base_parameters() -> None:
    mechanism = mechanism_of(pendulum())
    motion = random_motion(np.random.default_rng(1), 1, 20)
    base = base_parameters(stacked(mechanism, motion, True))
    # m c_x and m c_y through gravity, and the moment about the pin
    assert base.independent.tolist() == [1, 2, 6]
    np.testing.assert_allclose(
        base.combinations @ mechanism.inertias.parameters().ravel(), [0.0, -1.4, 1.28], atol=1e-12
    )


def test_ground_wrench_and_joint_forces_of_a_free_body_tell_the_same() -> None:
    # Ayusawa, Venture & Nakamura 2014: the base link's equations hold every base parameter
    mechanism = mechanism_of(builtin("full_body_35dof"))
    motion = random_motion(np.random.default_rng(2), 35, 60)
    ground, joints = (base_parameters(stacked(mechanism, motion, kind)) for kind in (False, True))
    assert ground.rank == joints.rank < 160


def test_base_parameters_predict_the_forces_of_another_motion() -> None:
    rng = np.random.default_rng(7)
    mechanism = mechanism_of(with_random_masses(leg(rng, coupled=False), rng))
    base = base_parameters(stacked(mechanism, random_motion(rng, 10, 40), False))
    (block,) = regressor_blocks(mechanism, random_motion(rng, 10, 5), NONE)
    parameters = mechanism.inertias.parameters().ravel()
    short = block.ground[..., base.independent] @ (base.combinations @ parameters)
    np.testing.assert_allclose(short, block.ground @ parameters, rtol=0, atol=1e-9)


def test_a_recording_at_rest_determines_fewer_combinations_than_the_structure_allows() -> None:
    mechanism = mechanism_of(builtin("lower_limb_14dof"))
    motion = random_motion(np.random.default_rng(3), 14, 60)
    still = type(motion)(motion.q, 0 * motion.q, 0 * motion.q)
    assert (
        base_parameters(stacked(mechanism, still, False)).rank
        < base_parameters(stacked(mechanism, motion, False)).rank
    )


def test_a_missing_frame_tells_nothing_and_an_empty_recording_is_refused() -> None:
    rng = np.random.default_rng(4)
    rows = rng.normal(size=(9, 4))
    spoilt = np.concatenate([rows, np.full((1, 4), np.nan)])
    np.testing.assert_allclose(triangular_factor([spoilt]), triangular_factor([rows]))
    with pytest.raises(ValueError, match="no complete row"):
        triangular_factor([np.full((3, 4), np.nan)])


def test_parameters_and_inertias_are_inverse_to_each_other() -> None:
    model = builtin("full_body_35dof")
    there = Inertias.of_parameters(inertias_of(model).parameters())
    back = inertias_of(with_inertias(model, there))
    for ours, known in zip((back.mass, back.com, back.tensor), vars_of(inertias_of(model)), strict=True):
        np.testing.assert_allclose(ours, known, rtol=0, atol=1e-12)


def vars_of(inertias: Inertias) -> tuple[np.ndarray, ...]:
    return inertias.mass, inertias.com, inertias.tensor
