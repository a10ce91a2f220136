"""The regressor against inverse dynamics."""

from __future__ import annotations

import numpy as np
import pytest

from scaling_service.model.builtin import BUILTIN_NAMES, load_builtin
from scaling_service.model.inertia import compile_mechanism, gather_inertias, with_inertias
from scaling_service.numerics.multibody.motion import Inertias
from scaling_service.numerics.wrench import compute_inverse_dynamics, compute_regressor_blocks
from tests.numerics.bodies import leg
from tests.numerics.massive import random_motion, with_random_masses

NONE = np.zeros(0)


@pytest.mark.parametrize("name", BUILTIN_NAMES)
def test_regressor_times_parameters_is_the_wrench(name: str) -> None:
    mechanism = compile_mechanism(load_builtin(name))
    motion = random_motion(np.random.default_rng(0), mechanism.tree.n_coordinates, 11)
    parameters = mechanism.inertias.parameters().ravel()
    known = compute_inverse_dynamics(mechanism, motion, NONE)
    scale = np.abs(known.forces).max()
    for rows, regressor in compute_regressor_blocks(mechanism, motion, NONE, size=4):
        ground = known.residual[:, rows].T
        np.testing.assert_allclose(regressor @ parameters, ground, rtol=0, atol=1e-11 * scale)


def test_the_regressor_of_coupled_joints_gives_their_wrench() -> None:
    rng = np.random.default_rng(3)
    mechanism = compile_mechanism(with_random_masses(leg(rng, coupled=True), rng))
    motion = random_motion(rng, 10, 5)
    known = compute_inverse_dynamics(mechanism, motion, NONE)
    ((_, regressor),) = compute_regressor_blocks(mechanism, motion, NONE)
    given = regressor @ mechanism.inertias.parameters().ravel()
    np.testing.assert_allclose(given, known.residual.T, rtol=0, atol=1e-11 * np.abs(known.forces).max())


def test_parameters_and_inertias_are_inverse_to_each_other() -> None:
    model = load_builtin("full_body_35dof")
    there = Inertias.of_parameters(gather_inertias(model).parameters())
    back = gather_inertias(with_inertias(model, there))
    for ours, known in zip((back.mass, back.com, back.tensor), vars_of(gather_inertias(model)), strict=True):
        np.testing.assert_allclose(ours, known, rtol=0, atol=1e-12)


def vars_of(inertias: Inertias) -> tuple[np.ndarray, ...]:
    return inertias.mass, inertias.com, inertias.tensor
