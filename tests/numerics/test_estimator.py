"""The bordered least squares: optimum, bounds, outliers, what must not matter."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from scaling_service.numerics.least_squares.blocks import compute_residuals, solve_motion_alone
from scaling_service.numerics.least_squares.estimator import compute_total_cost, estimate_uncertainty, solve
from scaling_service.numerics.least_squares.problem import Huber, Outcome, Problem, Settings
from scaling_service.numerics.multibody.sweep import SweepSettings, solve_motion
from tests.numerics.bodies import Array
from tests.numerics.bordered import TIGHT, Case, case, freed


def scipys_cost(this: Case, problem: Problem) -> float:
    """The same bordered problem, all unknowns in one vector."""
    n, nq = this.q0.shape
    free = problem.parameters

    def split(x: Array) -> tuple[Array, Array]:
        p = this.p0.copy()
        p[free] = x[n * nq :]
        return x[: n * nq].reshape(n, nq), p

    def rows(x: Array) -> Array:
        q, p = split(x)
        gap = np.nan_to_num(compute_residuals(problem, q, p)) * np.sqrt(problem.weights)[:, None]
        return np.concatenate([gap.ravel(), np.sqrt(problem.prior_weight) * (p - this.p0)[free]])

    low = np.concatenate([np.tile(problem.coordinate_bounds[0], n), problem.lower])
    high = np.concatenate([np.tile(problem.coordinate_bounds[1], n), problem.upper])
    start = np.clip(np.concatenate([this.q0.ravel(), this.p0[free]]), low + 1e-9, high - 1e-9)
    found = least_squares(rows, start, bounds=(low, high), x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    return 2.0 * float(found.cost)


@pytest.mark.parametrize("seed", range(3))
def test_the_joint_optimum_is_scipys(seed: int) -> None:
    this = case(seed)
    found = solve(this.problem, this.q0, this.p0, TIGHT)
    assert found.outcome is Outcome.CONVERGED
    assert found.cost == pytest.approx(scipys_cost(this, this.problem), rel=1e-8)
    assert found.cost == pytest.approx(compute_total_cost(this.problem, found.q, found.p, this.p0), rel=1e-12)


def test_with_priors_gaps_and_a_coupled_knee_too() -> None:
    rng = np.random.default_rng(5)
    this = case(5, model=freed(rng, coupled=True))
    measured = this.problem.measured.copy()
    measured[rng.random(measured.shape[:2]) < 0.1] = np.nan
    problem = replace(this.problem, measured=measured, prior_weight=np.linspace(0.0, 0.5, 6))
    found = solve(problem, this.q0, this.p0, TIGHT)
    assert found.cost == pytest.approx(scipys_cost(this, problem), rel=1e-8)


@pytest.mark.parametrize("seed", [11, 12])
def test_bounds_are_kept_reached_and_flagged(seed: int) -> None:
    this = case(seed)
    lower, upper = this.problem.lower.copy(), this.problem.upper.copy()
    upper[1] = this.p0[1] + 0.2 * (this.p[1] - this.p0[1])  # the femur may not grow (or shrink) enough
    lower[1] = this.p0[1] - 0.2 * (this.p[1] - this.p0[1])
    lower[1], upper[1] = sorted((lower[1], upper[1]))
    bounds = (np.full(10, -np.inf), np.full(10, np.inf))
    bounds[0][9] = -1.0  # and the knee bends further than that
    problem = replace(this.problem, lower=lower, upper=upper, coordinate_bounds=bounds)
    found = solve(problem, this.q0, this.p0, TIGHT)
    assert (found.p >= lower).all()
    assert (found.p <= upper).all()
    assert (found.q[:, 9] >= -1.0).all()
    assert (found.q[:, 9] == -1.0).any()
    assert found.cost == pytest.approx(scipys_cost(this, problem), rel=1e-6)
    verdict = estimate_uncertainty(problem, found, this.p0)
    assert verdict.at_bound[1]
    assert np.isnan(verdict.sd[1])
    assert not verdict.at_bound[[0, 2, 3]].any()
    assert np.isfinite(verdict.sd[~verdict.at_bound]).all()


def test_without_noise_every_parameter_is_recovered() -> None:
    for seed in range(4):
        this = case(20 + seed, noise=0.0, n=20)
        found = solve(this.problem, this.q0, this.p0, TIGHT)
        assert not (estimate_uncertainty(this.problem, found, this.p0).undetermined > 1e-6).any()
        np.testing.assert_allclose(found.p, this.p, rtol=0, atol=1e-6)
        np.testing.assert_allclose(found.q, this.q, rtol=0, atol=1e-6)


def test_a_robust_loss_resists_outliers() -> None:
    loss = Huber(0.01)
    this = case(50, noise=0.001, n=30)
    measured = this.problem.measured.copy()
    rng = np.random.default_rng(1)
    wild = rng.random(measured.shape[:2]) < 0.05
    measured[wild] += rng.normal(0.0, 0.15, (int(wild.sum()), 3))
    plain = replace(this.problem, measured=measured)
    naive = solve(plain, this.q0, this.p0)
    robust = solve(replace(plain, loss=loss), this.q0, this.p0)
    assert robust.outcome is Outcome.CONVERGED
    assert np.abs(robust.p - this.p).max() < 0.25 * np.abs(naive.p - this.p).max()
    gradient = _numeric_gradient(replace(plain, loss=loss), robust.q, robust.p, this.p0)
    assert np.abs(gradient).max() < 1e-4, "a stationary point of the robust cost"


def _numeric_gradient(problem: Problem, q: Array, p: Array, p0: Array) -> Array:
    step, result = 1e-6, np.empty(len(p))
    for k in range(len(p)):
        up, down = p.copy(), p.copy()
        up[k], down[k] = up[k] + step, down[k] - step
        result[k] = (compute_total_cost(problem, q, up, p0) - compute_total_cost(problem, q, down, p0)) / (
            2 * step
        )
    return result


def test_frames_without_markers_change_nothing() -> None:
    this = case(60)
    blind = np.full((3, *this.problem.measured.shape[1:]), np.nan)
    longer = replace(this.problem, measured=np.concatenate([blind, this.problem.measured]))
    q0 = np.concatenate([this.q0[:3], this.q0])
    found, alone = solve(longer, q0, this.p0, TIGHT), solve(this.problem, this.q0, this.p0, TIGHT)
    np.testing.assert_allclose(found.p, alone.p, rtol=0, atol=1e-8)
    np.testing.assert_array_equal(found.q[:3], q0[:3])
    assert found.cost == pytest.approx(alone.cost, rel=1e-10)


def test_moving_the_ground_changes_no_parameter() -> None:
    this = case(61)
    turn, shift = Rotation.from_euler("y", 1.0), np.array([3.0, 0.0, -2.0])
    moved = turn.apply(this.problem.measured.reshape(-1, 3)).reshape(this.problem.measured.shape) + shift
    q0 = this.q0.copy()
    q0[:, :3] = turn.apply(q0[:, :3]) + shift
    q0[:, 3] += 1.0  # the root turns about the vertical first
    here = solve(this.problem, this.q0, this.p0, TIGHT)
    there = solve(replace(this.problem, measured=moved), q0, this.p0, TIGHT)
    np.testing.assert_allclose(there.p, here.p, rtol=0, atol=1e-7)
    assert there.cost == pytest.approx(here.cost, rel=1e-9)


def test_blocks_and_forgetting_them_make_no_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    this = case(62, n=300)
    few = Settings(max_steps=3)
    usual = solve(this.problem, this.q0, this.p0, few)
    for name, value in (("problem._BLOCK", 10_000), ("problem._BLOCK", 7), ("border._KEEP", 0)):
        with monkeypatch.context() as patch:
            patch.setattr(f"scaling_service.numerics.least_squares.{name}", value)
            other = solve(this.problem, this.q0, this.p0, few)
        np.testing.assert_allclose(other.p, usual.p, rtol=0, atol=1e-10)
        np.testing.assert_allclose(other.q, usual.q, rtol=0, atol=1e-10)


def test_without_parameters_it_is_inverse_kinematics() -> None:
    this = case(63)
    none = np.zeros(0)
    still = replace(
        this.problem,
        parameters=np.zeros(0, dtype=np.intp),
        scale=none,
        lower=none,
        upper=none,
        prior_weight=none,
    )
    found = solve(still, this.q0, this.p, TIGHT)
    sweeps = solve_motion(
        still.tree,
        still.measured,
        still.weights,
        this.q0,
        this.p,
        settings=SweepSettings(left=1e-13),
    )
    assert found.cost == pytest.approx(sweeps.cost.sum(), rel=1e-9)
    np.testing.assert_allclose(found.q, sweeps.q, rtol=0, atol=1e-5)


@pytest.mark.parametrize(("coupled", "limited"), [(False, False), (True, False), (True, True)])
def test_frames_that_end_by_themselves_end_where_they_do_together(coupled: bool, limited: bool) -> None:
    """Also with coordinates that several links follow, a marker not seen, a frame not seen and bounds."""
    this = case(69, n=40, model=freed(np.random.default_rng(69), coupled=coupled))
    none = np.zeros(0)
    bounds = [bound.copy() for bound in this.problem.coordinate_bounds]
    if limited:
        knee = int(this.problem.coordinates[-1])
        bounds[1][knee] = np.quantile(this.q[:, knee], 0.7)
    measured = this.problem.measured.copy()
    measured[3:9, 0], measured[20] = np.nan, np.nan
    still = replace(
        this.problem,
        measured=measured,
        parameters=np.zeros(0, dtype=np.intp),
        scale=none,
        lower=none,
        upper=none,
        prior_weight=none,
        coordinate_bounds=(bounds[0], bounds[1]),
    )
    together = solve(still, this.q0, this.p, TIGHT)
    alone = solve_motion_alone(still, this.q0, this.p, TIGHT)
    assert alone.outcome is Outcome.CONVERGED
    assert alone.cost == pytest.approx(together.cost, rel=1e-9)
    assert alone.cost == pytest.approx(compute_total_cost(still, alone.q, alone.p, this.p), rel=1e-12)
    np.testing.assert_allclose(alone.q, together.q, rtol=0, atol=1e-6)


def test_some_parameters_and_coordinates_may_be_held() -> None:
    this = case(64)
    chosen = np.array([4, 1])
    problem = replace(
        this.problem,
        coordinates=np.arange(9),
        parameters=chosen,
        scale=this.problem.scale[chosen],
        lower=this.problem.lower[chosen],
        upper=this.problem.upper[chosen],
        prior_weight=np.zeros(2),
    )
    found = solve(problem, this.q0, this.p0, TIGHT)
    held = np.setdiff1d(np.arange(6), chosen)
    np.testing.assert_array_equal(found.p[held], this.p0[held])
    np.testing.assert_array_equal(found.q[:, 9], this.q0[:, 9])
    assert (found.p[chosen] != this.p0[chosen]).all()


def test_parameters_alone_are_what_scipy_finds() -> None:
    this = case(65)
    found = solve(this.problem.hold_motion(), this.q0, this.p0, TIGHT)

    def rows(p: Array) -> Array:
        gap = compute_residuals(this.problem, this.q0, p) * np.sqrt(this.problem.weights)[:, None]
        return gap.ravel()

    peer = least_squares(
        rows, this.p0, bounds=(this.problem.lower, this.problem.upper), xtol=1e-15, ftol=1e-15
    )
    assert found.cost == pytest.approx(2.0 * peer.cost, rel=1e-8)
    np.testing.assert_array_equal(found.q, this.q0)


def test_the_scale_of_the_variables_does_not_matter() -> None:
    this = case(66)
    usual = solve(this.problem, this.q0, this.p0, TIGHT)
    coarse = replace(this.problem, scale=np.geomspace(1e-2, 1.0, 6))
    other = solve(coarse, this.q0, this.p0, TIGHT)
    np.testing.assert_allclose(other.p, usual.p, rtol=0, atol=1e-6)
    np.testing.assert_allclose(
        estimate_uncertainty(coarse, other, this.p0).covariance,
        estimate_uncertainty(this.problem, usual, this.p0).covariance,
        rtol=1e-3,
        atol=1e-12,
    )


def test_running_out_of_steps_is_said() -> None:
    this = case(67)
    assert solve(this.problem, this.q0, this.p0, Settings(max_steps=1)).outcome is Outcome.MAX_STEPS


def test_progress_reports_falling_cost() -> None:
    this, reported = case(68), []
    solve(this.problem, this.q0, this.p0, TIGHT, progress=lambda step, cost: reported.append((step, cost)))
    assert len(reported) > 1
    assert all(a[0] < b[0] and a[1] >= b[1] for a, b in pairwise(reported))


@pytest.mark.parametrize("seed", range(4))
def test_bounds_that_bind_in_many_frames_do_not_stop_it(seed: int) -> None:
    this = case(seed, n=60, noise=0.005)
    knee = int(this.problem.coordinates[-1])
    limit = float(np.quantile(this.q[:, knee], 0.6))
    lower, upper = (bound.copy() for bound in this.problem.coordinate_bounds)
    upper[knee] = limit
    bounded = replace(this.problem, coordinate_bounds=(lower, upper))
    found = solve(bounded, this.q0, this.p0)
    tight = solve(bounded, found.q, this.p0, TIGHT, start=found.p)
    assert found.outcome is Outcome.CONVERGED
    assert found.steps < 60
    assert found.cost == pytest.approx(tight.cost, rel=1e-5)
    assert (found.q[:, knee] <= limit + 1e-12).all()
    assert (found.q[:, knee] >= limit - 1e-12).mean() > 0.2
