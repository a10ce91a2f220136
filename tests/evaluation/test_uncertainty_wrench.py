"""The wrench from positions against inverse dynamics and a spinning body; its derivatives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scaling_service.capabilities.dynamics.uncertainty.linear import LAGS, compute_wrench_jacobians
from scaling_service.capabilities.dynamics.uncertainty.reference import (
    HALO,
    LowPass,
    Reference,
    difference_twice,
)
from scaling_service.capabilities.kinetics.inverse_dynamics import evaluate_residuals, solve_inverse_dynamics
from scaling_service.capabilities.motion.kinematic_error import kinematic_error
from scaling_service.core.errors import InputError, TrialUnusable
from scaling_service.model.body import BodyModel, Coordinate, Joint, Law, Segment, Tensor
from scaling_service.numerics.signals.filters import filter_butterworth
from scaling_service.numerics.wrench import GRAVITY
from scaling_service.studies.muller2017.points import PointBody, compute_residual
from tests.evaluation.uncertain import recording


def test_the_residual_of_a_recording_is_that_of_inverse_dynamics() -> None:
    given = recording()
    reference = Reference.of(given)
    error, residual = reference.residual(reference.q)
    dynamics = solve_inverse_dynamics(given.model, given.motion, given.loads)
    weight = dynamics.mass * -GRAVITY[1]
    apart = residual[:, reference.used] - dynamics.residual[reference.used].T
    # the finite difference and the splines differ by this much in accelerations that were smoothed at 5 Hz
    assert np.abs(apart[:3]).max() < 1e-4 * weight
    assert np.abs(apart[3:]).max() < 1e-4 * weight * given.height_m
    expected = evaluate_residuals(dynamics, given.height_m, frames=reference.used).dr
    np.testing.assert_allclose(reference.indicator(residual), expected, rtol=1e-3)
    # the filter hardly moves a model that moves slowly
    assert error == pytest.approx(kinematic_error(given.motion, given.model).mean, rel=0.01)


def test_perturbed_motions_have_the_residual_of_inverse_dynamics() -> None:
    given = recording()
    reference = Reference.of(given)
    noise = np.random.default_rng(0).standard_normal((len(reference.varied), reference.n_frames))
    q = reference.perturb(noise, 0.1)
    shaken = given.motion.q.copy()
    shaken[:, reference.varied] += 0.1 * noise.T
    dynamics = solve_inverse_dynamics(given.model, replace(given.motion, q=shaken), given.loads)
    np.testing.assert_allclose(q.T, dynamics.motion.q, atol=1e-6)
    expected = evaluate_residuals(dynamics, given.height_m, frames=reference.used).dr
    np.testing.assert_allclose(reference.indicator(reference.residual(q)[1]), expected, rtol=3e-3)


def test_points_need_the_wrench_of_newton_and_euler() -> None:
    given = recording()
    reference = Reference.of(given)
    body = PointBody.of(given.model, given.motion.markers)
    (error, residual), (other, wanted) = (
        compute_residual(body, reference, reference.q),
        reference.residual(reference.q),
    )
    assert error == pytest.approx(other, rel=1e-12)
    weight = reference.scale[0]
    np.testing.assert_allclose(residual[:, reference.used], wanted[:, reference.used], atol=1e-5 * weight)


def spinning(inertia: Tensor) -> BodyModel:
    joint = Joint("rotation", (0.0, 0.0, 1.0), Law.of("angle"))
    segment = Segment(
        name="top",
        parent="ground",
        joint_name="spin",
        joints=(joint,),
        mass=2.0,
        com=(0.3, 0.0, 0.0),
        inertia=inertia,
    )
    return BodyModel(name="top", segments=(segment,), coordinates=(Coordinate(name="angle"),))


@pytest.mark.parametrize("inertia", [(0.1, 0.2, 0.3, 0.0, 0.0, 0.02), (0.1, 0.1, 0.5, 0.0, 0.0, 0.0)])
def test_a_spinning_body_needs_its_centripetal_force_and_euler_moment(inertia: Tensor) -> None:
    """The second tensor breaks the triangle inequality: one second moment is negative."""
    times, rate, pace = np.arange(60) / 200, 2.0, 3.0
    angle = rate * times + 0.5 * pace * times**2
    body = PointBody.of(spinning(inertia), ())
    poses = body.poses(angle[None])
    found = body.wrench(body.move(poses), poses.frames[poses.plan.link_node[0], 3], 1 / 200)
    inner = slice(HALO, -HALO)
    speed = (rate + pace * times)[inner]
    along = np.array([np.cos(angle[inner]), np.sin(angle[inner])])
    across = np.array([-along[1], along[0]])
    force = 2.0 * 0.3 * (pace * across - speed**2 * along)
    force[1] += 2.0 * 9.80665
    np.testing.assert_allclose(found[:2], force, atol=1e-6)
    np.testing.assert_allclose(found[2], 0.0, atol=1e-9)
    lifted = 2.0 * 9.80665 * 0.3 * np.cos(angle[inner])
    np.testing.assert_allclose(found[5], (inertia[2] + 2.0 * 0.3**2) * pace + lifted, atol=1e-6)
    # the product of inertia tips the body: omega x I omega about its x, I alpha about its y
    local = np.einsum("an,an->n", found[3:5], along), np.einsum("an,an->n", found[3:5], across)
    np.testing.assert_allclose(local[0], -inertia[5] * speed**2, atol=1e-6)
    np.testing.assert_allclose(local[1], inertia[5] * pace, atol=1e-6)


def test_the_difference_is_exact_for_polynomials() -> None:
    x = np.linspace(-1.0, 1.0, 41)
    step = x[1] - x[0]
    for degree in range(2, 10):
        expected = degree * (degree - 1) * x[HALO:-HALO] ** (degree - 2)
        np.testing.assert_allclose(difference_twice(x**degree, step), expected, atol=1e-9)


def test_derivatives_are_those_of_the_residual() -> None:
    """Of Newton and Euler's wrench against that from positions alone, both along filtered noise."""
    given = recording()
    reference, body = Reference.of(given, "all"), PointBody.of(given.model, given.motion.markers)
    block = next(compute_wrench_jacobians(reference))
    rng = np.random.default_rng(2)
    for row, k in enumerate(reference.varied.tolist()):
        if row % 3:
            continue
        course = np.zeros((len(reference.varied), reference.n_frames))
        course[row] = rng.standard_normal(reference.n_frames)
        size = 1e-5
        shifted = (reference.perturb(course, sign * size) for sign in (1.0, -1.0))
        ends = [compute_residual(body, reference, q)[1] for q in shifted]
        numeric = ((ends[0] - ends[1]) / (2.0 * size))[:, block.rows]
        noise = (reference.perturb(course, 1.0) - reference.q)[k]
        around = np.stack([noise[block.rows + lag] for lag in LAGS])
        found = np.einsum("ln,lcn->cn", around, block.by_lag[:, row])
        # differences of coordinates and of points err alike, by 3e-8 at 5 Hz and more above
        np.testing.assert_allclose(found, numeric, atol=2e-5 * (1.0 + np.abs(numeric).max()))


@pytest.mark.parametrize("n", [40, 300, 1111, 4000])
def test_the_band_matrix_is_the_filter(n: int) -> None:
    noise = np.random.default_rng(n).normal(size=(3, n))
    expected = filter_butterworth(noise.T, rate_hz=100.0, cutoff_hz=5.0).values.T
    np.testing.assert_allclose(LowPass(100.0, 5.0, 4).apply(noise), expected, atol=5e-6)


def test_the_autocovariance_is_that_of_filtered_noise() -> None:
    noise = np.random.default_rng(1).normal(size=(1, 400_000))
    slow = LowPass(100.0, 5.0, 4).apply(noise)[0]
    expected = [np.mean(slow[: len(slow) - lag] * slow[lag:]) for lag in range(5)]
    np.testing.assert_allclose(LowPass(100.0, 5.0, 4).autocovariance(4), expected, rtol=0.03)


def test_a_missing_frame_costs_its_neighbours_only() -> None:
    given = recording()
    q = given.motion.q.copy()
    q[400] = np.nan
    reference = Reference.of(replace(given, motion=replace(given.motion, q=q)))
    left_out = np.flatnonzero(~reference.used)
    assert {*range(400 - HALO, 401 + HALO)} <= set(left_out.tolist())
    assert reference.used.sum() == Reference.of(given).used.sum() - 2 * HALO - 1
    _, residual = reference.residual(reference.q)
    assert np.isfinite(reference.indicator(residual)).all()


def test_clocks_and_heights_are_checked() -> None:
    given = recording()
    late = replace(given.loads, times=given.loads.times + 0.5)
    with pytest.raises(TrialUnusable, match="one clock"):
        Reference.of(replace(given, loads=late))
    with pytest.raises(InputError, match="height"):
        Reference.of(replace(given, height_m=180.0))
    nobody = np.zeros(len(given.motion.times), dtype=bool)
    with pytest.raises(TrialUnusable, match="no frame"):
        Reference.of(replace(given, frames=nobody))
