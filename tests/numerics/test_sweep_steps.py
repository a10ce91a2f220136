"""The steps of the sweeps: dense algebra gives the same ones, few are enough, and they end when told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scaling_service.model.compile import compile_model
from scaling_service.numerics.multibody.sweep import SweepSettings, solve_motion
from scaling_service.numerics.multibody.tree import (
    Tree,
    compute_jacobian,
    place_tree_markers,
    pose_links,
    pose_markers,
)
from tests.numerics.bodies import Array, leg, leg_motion, random_tree, slow_jacobian
from tests.numerics.swept import SEEDS, Case, case

# Every frame ends with its first step, which is taken whether or not it lowers the cost
ONE_STEP = SweepSettings(max_steps=1, left=np.inf, damping=0.0)
TINY = 1e-10  # the share of the total weight that the sweep adds to every pivot


@settings(max_examples=20)
@given(seed=SEEDS, n_segments=st.integers(1, 5))
def test_an_undamped_step_is_the_dense_gauss_newton_step(seed: int, n_segments: int) -> None:
    rng = np.random.default_rng(seed)
    model = random_tree(rng, n_segments, markers_each=4)
    n = len(model.coordinates)
    truth = rng.uniform(-1.0, 1.0, (2, n))
    tree, none = compile_model(model), np.zeros(0)
    measured = pose_markers(tree, truth, none) + rng.normal(0.0, 1e-4, (2, len(model.markers), 3))
    start = truth + rng.normal(0.0, 1e-3, truth.shape)
    weights = rng.uniform(0.5, 2.0, len(model.markers))
    found = solve_motion(tree, measured, weights, start, none, settings=ONE_STEP)
    slow = slow_jacobian(model, start, none, model.coordinate_names)
    for k in range(2):
        rates = slow[k].reshape(-1, n)
        heavy = np.repeat(weights, 3)
        gap = (measured[k] - pose_markers(tree, start[k : k + 1], none)[0]).ravel()
        normal = rates.T @ (heavy[:, None] * rates)
        if np.linalg.cond(normal) > 1e6:
            return  # rounding then exceeds what is asked for
        step = np.linalg.solve(normal + TINY * weights.sum() * np.eye(n), rates.T @ (heavy * gap))
        np.testing.assert_allclose(
            found.q[k] - start[k], step, rtol=0.0, atol=1e-9 * np.abs(step).max() + 1e-14
        )


def test_undamped_step_of_a_spline_coupled_knee_with_priors_is_dense_too() -> None:
    this = case(14, n=3)
    this = Case(this.model, this.truth, this.truth + 1e-3, this.measured, this.weights, {})
    pull = np.linspace(0.1, 1.0, 10)
    this.options["prior"] = (this.truth, pull)
    found = this.solve(ONE_STEP)
    slow = slow_jacobian(this.model, this.start, np.zeros(0), this.model.coordinate_names)
    heavy = np.repeat(this.weights, 3)
    for k in range(3):
        rates, gap = slow[k].reshape(-1, 10), -this.rows(this.start[k], k)[:36] / np.sqrt(heavy)
        normal = rates.T @ (heavy[:, None] * rates) + np.diag(pull + TINY * this.weights.sum())
        step = np.linalg.solve(normal, rates.T @ (heavy * gap) + pull * (this.truth[k] - this.start[k]))
        np.testing.assert_allclose(found.q[k] - this.start[k], step, rtol=0, atol=1e-9 * np.abs(step).max())


def curvature_and_slope(tree: Tree, q: Array, measured: Array, weights: Array) -> tuple[Array, Array]:
    """The exact Hessian of half the cost by differences of the Jacobian, and the way down, at one pose."""
    n, none = q.shape[1], np.zeros(0)

    def rates(at: Array) -> Array:
        poses = pose_links(tree, np.ascontiguousarray(at.T), none)
        return (
            compute_jacobian(tree, poses, place_tree_markers(tree, poses), np.arange(n))[..., 0]
            .reshape(n, -1)
            .T
        )

    heavy, jac = np.repeat(weights, 3), rates(q)
    gap = (measured - pose_markers(tree, q, none)).ravel()
    steps = 1e-5 * np.eye(n)
    bend = np.array([(rates(q + h) - rates(q - h)).T @ (heavy * gap) / 2e-5 for h in steps])
    return jac.T @ (heavy[:, None] * jac) - bend, jac.T @ (heavy * gap)


@settings(max_examples=20)
@given(seed=SEEDS, n_segments=st.integers(1, 5))
def test_near_the_minimum_a_step_is_newtons(seed: int, n_segments: int) -> None:
    """Residuals are large, so that it differs from Gauss-Newton's."""
    rng = np.random.default_rng(seed)
    model = random_tree(rng, n_segments, markers_each=4)
    n = len(model.coordinates)
    q, tree, none = rng.uniform(-1.0, 1.0, (1, n)), compile_model(model), np.zeros(0)
    measured = pose_markers(tree, q, none) + rng.normal(0.0, 0.01, (1, len(model.markers), 3))
    weights = rng.uniform(0.5, 2.0, len(model.markers))
    hessian, slope = curvature_and_slope(tree, q, measured, weights)
    if np.linalg.eigvalsh(hessian)[0] < 1e-3:
        return  # the sweep takes pivots at their size there
    expected = np.linalg.solve(hessian + TINY * weights.sum() * np.eye(n), slope)
    found = solve_motion(tree, measured, weights, q, none, settings=replace(ONE_STEP, close=True))
    if np.abs(expected).max() > 0.5:
        return  # beyond the longest step allowed
    np.testing.assert_allclose((found.q - q)[0], expected, rtol=0, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("seed", range(4))
def test_newton_steps_are_fewer_where_residuals_stay(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(seed)
    model, q = leg(rng), leg_motion(rng, 50)
    tree, none = compile_model(model), np.zeros(0)
    measured = pose_markers(tree, q, none) + rng.normal(0.0, 0.03, (50, 12, 3))
    how = SweepSettings(left=1e-12, max_steps=300)
    newton = solve_motion(tree, measured, np.ones(12), q, none, settings=how)
    monkeypatch.setattr("scaling_service.numerics.least_squares.descent.NEAR", 0.0)
    plain = solve_motion(tree, measured, np.ones(12), q, none, settings=how)
    assert np.median(newton.steps) <= 9 < np.median(plain.steps)
    np.testing.assert_allclose(newton.cost, plain.cost, rtol=1e-7)


@pytest.mark.parametrize("left", [1e-4, 1e-6, 1e-8])
def test_what_the_last_step_leaves_is_as_little_as_asked(left: float) -> None:
    this = case(17, n=200)
    least = this.solve().cost
    found = this.solve(SweepSettings(left=left, step_tolerance=0.0))
    true = np.array([(this.rows(q, frame) ** 2).sum() for frame, q in enumerate(found.q)])
    assert found.converged.all()
    too_much = (true - least) / least
    assert (
        np.quantile(too_much, 0.9) <= left
    )  # an extrapolation: right for most, the order of it for nearly all
    assert np.quantile(too_much, 0.99) <= 10.0 * left
    assert found.steps.mean() < this.solve().steps.mean()


def test_a_quorum_ends_the_solve_and_tells_who_stayed_behind() -> None:
    this = case(18, n=100, noise=0.03)
    whole, half = this.solve(SweepSettings()), this.solve(SweepSettings(quorum=0.5))
    assert half.steps.max() < whole.steps.max()
    assert 50 <= half.converged.sum() < 100
    done = half.frames(half.converged)
    np.testing.assert_allclose(done.q, whole.q[half.converged], rtol=0, atol=1e-12)
    assert (half.cost[~half.converged] >= whole.cost[~half.converged]).all()


def test_no_coordinate_moves_by_more_than_the_longest_step() -> None:
    this = case(19, n=20)
    this = Case(this.model, this.truth, this.truth + 0.5, this.measured, this.weights, {})
    found = this.solve(SweepSettings(max_steps=2, longest=0.05))
    assert np.abs(found.q - this.start).max() <= 2 * 0.05 + 1e-12


@pytest.mark.parametrize("seed", range(4))
def test_a_step_knows_of_a_coordinate_that_it_takes_to_its_bound(seed: int) -> None:
    """Whether it goes past the bound by itself or by what carries it: the others' step is the dense one."""
    rng = np.random.default_rng(seed)
    model = random_tree(rng, 4, markers_each=4)
    n, tree, none = len(model.coordinates), compile_model(model), np.zeros(0)
    truth = rng.uniform(-1.0, 1.0, (1, n))
    measured = pose_markers(tree, truth, none) + rng.normal(0.0, 1e-3, (1, len(model.markers), 3))
    weights, q = rng.uniform(0.5, 2.0, len(model.markers)), truth + rng.normal(0.0, 1e-2, truth.shape)
    hessian, slope = curvature_and_slope(tree, q, measured, weights)
    hessian += TINY * weights.sum() * np.eye(n)
    if np.linalg.eigvalsh(hessian)[0] < 1e-3:
        return  # the sweep takes pivots at their size there
    how = replace(ONE_STEP, close=True)
    for k, free in enumerate(np.linalg.solve(hessian, slope)):
        low, high = np.full(n, -np.inf), np.full(n, np.inf)
        (high if free > 0.0 else low)[k] = q[0, k] + 0.5 * free
        found = solve_motion(tree, measured, weights, q, none, bounds=(low, high), settings=how).q[0] - q[0]
        rest = np.arange(n) != k
        others = np.linalg.solve(hessian[np.ix_(rest, rest)], slope[rest] - hessian[rest, k] * 0.5 * free)
        np.testing.assert_allclose(found[k], 0.5 * free, rtol=1e-5)
        np.testing.assert_allclose(found[rest], others, rtol=0, atol=1e-5 * np.abs(found).max())


def test_half_a_step_is_tried_before_a_stronger_damping() -> None:
    this = case(20, n=200, noise=0.03)
    this = replace(this, start=this.truth + np.random.default_rng(0).normal(0.0, 0.6, this.truth.shape))
    half = this.solve(SweepSettings())
    damped = this.solve(SweepSettings(halvings=0))
    assert half.steps.mean() < damped.steps.mean()
    assert np.median(half.cost) <= np.median(damped.cost) * (1.0 + 1e-6)
