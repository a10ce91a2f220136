"""The uncertainty that the bordered least squares state, and what cannot be known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scaling_service.model.parameters import free_axis, free_marker, free_scale
from scaling_service.numerics.least_squares.blocks import compute_residuals
from scaling_service.numerics.least_squares.estimator import estimate_uncertainty, solve
from scaling_service.numerics.least_squares.problem import Settings
from tests.numerics.bodies import leg
from tests.numerics.bordered import TIGHT, case


def test_a_gauge_freedom_is_flagged_and_the_rest_is_not() -> None:
    """Turning all tibia markers about the knee's axis is the knee's own angle."""
    rng = np.random.default_rng(30)
    model = free_scale(leg(rng, coupled=False), "femur", 0.2)
    for k in range(4):
        model = free_marker(model, f"tibia{k}", "xyz", 0.2)
    this = case(30, model=model, n=20, spread=0.01)
    found = solve(this.problem, this.q0, this.p0, TIGHT)
    verdict = estimate_uncertainty(this.problem, found, this.p0)
    names = [p.name for p in model.parameters]
    turning = np.array([n.startswith("marker") and n[-1] in "xy" for n in names])
    assert (verdict.undetermined[~turning] < 1e-6).all()
    assert np.isfinite(verdict.sd[~turning]).all()
    assert np.isnan(verdict.sd[turning]).all()
    assert verdict.undetermined.sum() == pytest.approx(1.0, abs=1e-6), "one direction is free"
    local = np.array([m.nominal for m in model.markers if m.segment == "tibia"])
    shift = found.p[[names.index(f"marker.tibia{k}.{c}") for k in range(4) for c in "xyz"]].reshape(4, 3)
    about_z = np.cross([0.0, 0.0, 1.0], local + shift)
    expected = (about_z / np.linalg.norm(about_z)) ** 2
    got = verdict.undetermined[names.index("marker.tibia0.x") :].reshape(4, 3)
    np.testing.assert_allclose(got, expected, atol=1e-6)


def test_what_moves_nothing_is_undetermined_and_stays() -> None:
    rng = np.random.default_rng(31)
    model = free_scale(free_scale(leg(rng), "femur", 0.2), "tibia", 0.2)
    this = case(31, model=model)
    tibia = [k for k, m in enumerate(model.markers) if m.segment == "tibia"]
    measured = this.problem.measured.copy()
    measured[:, tibia] = np.nan
    problem = replace(this.problem, measured=measured)
    found = solve(problem, this.q0, this.p0, TIGHT)
    verdict = estimate_uncertainty(problem, found, this.p0)
    assert found.p[1] == pytest.approx(this.p0[1], abs=1e-9)
    np.testing.assert_allclose(verdict.undetermined, [0.0, 1.0], atol=1e-9)
    assert np.isnan(verdict.sd[1])
    assert np.isfinite(verdict.sd[0])


@pytest.mark.costly  # four hundred draws
def test_stated_uncertainty_covers_the_truth() -> None:
    """Draws are independent, parameters within one are not: the margin is that of the draws' mean."""
    rng = np.random.default_rng(40)
    model = free_scale(free_scale(leg(rng, coupled=False), "pelvis", 0.5), "femur", 0.5)
    model = free_axis(model, "knee", 0.5, 0.5)
    for segment in ("femur", "tibia"):
        model = free_marker(free_marker(model, f"{segment}0", "xz", 0.1), f"{segment}1", "xyz", 0.1)
    this = case(40, model=model, n=30, spread=0.02)
    this = replace(this, problem=replace(this.problem, weights=np.ones(12)))
    draws = 400
    inside, noise = np.empty((draws, len(this.p))), np.empty(draws)
    for draw in range(draws):
        problem = this.measured(np.random.default_rng([40, draw]), 0.001)
        found = solve(problem, this.q, this.p, Settings(left=1e-9))
        verdict = estimate_uncertainty(problem, found, this.p)
        inside[draw], noise[draw] = np.abs(found.p - this.p) <= 1.96 * verdict.sd, verdict.noise
    margin = 3.5 * inside.mean(axis=1).std() / np.sqrt(draws)
    assert inside.size >= 500
    assert margin < 0.015, "the draws must suffice to tell 95 % from 93.5 %"
    assert inside.mean() == pytest.approx(0.95, abs=0.01)
    assert (inside.mean(axis=0) > 0.90).all()
    assert (inside.mean(axis=0) < 0.99).all()
    assert noise.mean() == pytest.approx(0.001, rel=0.01)


def test_the_covariance_is_that_of_the_dense_problem() -> None:
    this = case(41)
    found = solve(this.problem, this.q0, this.p0, TIGHT)
    verdict = estimate_uncertainty(this.problem, found, this.p0)
    n, nq = found.q.shape
    free = len(found.p)
    rows = compute_residuals(this.problem, found.q, found.p).size
    dense = np.zeros((rows, n * nq + free))
    for k in range(n * nq + free):
        ends = []
        for sign in (1.0, -1.0):
            q, p = found.q.copy(), found.p.copy()
            if k < n * nq:
                q.ravel()[k] += sign * 1e-5
            else:
                p[k - n * nq] += sign * 1e-5
            gap = compute_residuals(this.problem, q, p) * np.sqrt(this.problem.weights)[:, None]
            ends.append(gap.ravel())
        dense[:, k] = (ends[0] - ends[1]) / 2e-5
    expected = np.linalg.inv(dense.T @ dense)[-free:, -free:] * verdict.noise**2
    np.testing.assert_allclose(verdict.covariance, expected, rtol=1e-5, atol=1e-7 * np.abs(expected).max())
    np.testing.assert_allclose(verdict.sd, np.sqrt(np.diag(expected)), rtol=1e-5)


def test_a_prior_narrows_what_it_knows() -> None:
    this = case(42)
    found = solve(this.problem, this.q0, this.p0, TIGHT)
    sharp = replace(this.problem, prior_weight=np.array([1e6, 0, 0, 0, 0, 0.0]))
    reported = solve(sharp, this.q0, this.p0, TIGHT)
    assert abs(reported.p[0] - this.p0[0]) < 1e-4 < abs(found.p[0] - this.p0[0])
    assert (
        estimate_uncertainty(sharp, reported, this.p0).sd[0]
        < 0.1 * estimate_uncertainty(this.problem, found, this.p0).sd[0]
    )
