"""Noise told from residuals: how large, and how often it says the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scaling_service.model.compile import compile_model
from scaling_service.model.parameters import free_marker
from scaling_service.numerics.least_squares.estimator import estimate_repetition, estimate_residual_variance
from scaling_service.numerics.least_squares.problem import Problem
from scaling_service.numerics.multibody.tree import pose_markers
from tests.numerics.bodies import leg, leg_motion

NONE = np.zeros(0)


def known(noise: np.ndarray, seed: int = 0) -> tuple[Problem, np.ndarray]:
    """A problem whose residuals at the true motion are exactly ``noise`` (n_frames, 12, 3)."""
    rng = np.random.default_rng(seed)
    model, q = leg(rng), leg_motion(rng, len(noise))
    tree = compile_model(model)
    nothing = np.zeros(0, dtype=np.intp)
    open_ended = (np.full(q.shape[1], -np.inf), np.full(q.shape[1], np.inf))
    problem = Problem(
        tree=tree,
        measured=pose_markers(tree, q, NONE) + noise,
        weights=np.ones(12),
        coordinates=nothing,
        parameters=nothing,
        scale=NONE,
        lower=NONE,
        upper=NONE,
        prior_weight=NONE,
        coordinate_bounds=open_ended,
    )
    return problem, q


def test_white_noise_is_measured() -> None:
    problem, q = known(np.random.default_rng(1).normal(0.0, 0.002, (400, 12, 3)))
    assert np.sqrt(estimate_residual_variance(problem, q, NONE)) == pytest.approx(0.002, rel=0.02)


def test_what_the_fit_used_up_is_not_counted() -> None:
    problem, q = known(np.random.default_rng(3).normal(0.0, 0.002, (50, 12, 3)))
    fitted = replace(problem, coordinates=np.arange(q.shape[1]))
    ratio = estimate_residual_variance(fitted, q, NONE) / estimate_residual_variance(problem, q, NONE)
    assert ratio == pytest.approx(36.0 / (36.0 - q.shape[1]))


def test_markers_not_seen_do_not_lower_it() -> None:
    problem, q = known(np.random.default_rng(4).normal(0.0, 0.002, (400, 12, 3)))
    hidden = problem.measured.copy()
    hidden[::2, 3:] = np.nan
    variance = estimate_residual_variance(replace(problem, measured=hidden), q, NONE)
    assert np.sqrt(variance) == pytest.approx(0.002, rel=0.03)


def test_a_perfect_fit_is_not_certainty() -> None:
    problem, q = known(np.zeros((20, 12, 3)))
    assert estimate_residual_variance(problem, q, NONE) == pytest.approx(1e-12)


def shifted(noise: np.ndarray, seed: int = 0) -> tuple[Problem, np.ndarray]:
    """As ``known``, with every marker's local position free."""
    rng = np.random.default_rng(seed)
    model, q = leg(rng), leg_motion(rng, len(noise))
    for name in model.marker_names:
        model = free_marker(model, name, "xyz", 0.05)
    tree, count = compile_model(model), len(model.parameters)
    open_ended = (np.full(q.shape[1], -np.inf), np.full(q.shape[1], np.inf))
    problem = Problem(
        tree=tree,
        measured=pose_markers(tree, q, np.zeros(count)) + noise,
        weights=np.ones(12),
        coordinates=np.arange(q.shape[1]),
        parameters=np.arange(count),
        scale=np.full(count, 0.05),
        lower=np.full(count, -0.05),
        upper=np.full(count, 0.05),
        prior_weight=np.zeros(count),
        coordinate_bounds=open_ended,
    )
    return problem, q


def test_independent_frames_repeat_nothing() -> None:
    found = []
    for seed in range(8):
        noise = np.random.default_rng(seed).normal(0.0, 0.002, (160, 12, 3))
        problem, q = shifted(noise, seed)
        blocks = np.arange(160) // 20
        p = np.zeros(len(problem.parameters))
        found.append(estimate_repetition(problem, q, p, blocks, 0.002**2))
    assert np.mean(found) == pytest.approx(1.1, abs=0.15)  # never below one, so a little above it on average


@pytest.mark.parametrize("times", [4, 10])
def test_frames_that_say_the_same_are_counted(times: int) -> None:
    """Every frame recorded several times over, motion and noise alike: so often is it repeated."""
    found = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        problem, q = shifted(rng.normal(0.0, 0.002, (160, 12, 3)), seed)
        many = replace(problem, measured=np.repeat(problem.measured, times, axis=0))
        blocks = np.repeat(np.arange(160) // 20, times)
        p = np.zeros(len(problem.parameters))
        q = np.repeat(q, times, axis=0)
        found.append(estimate_repetition(many, q, p, blocks, 0.002**2))
    assert np.mean(found) == pytest.approx(times, rel=0.2)


def test_one_block_says_nothing_of_repetition() -> None:
    problem, q = shifted(np.random.default_rng(5).normal(0.0, 0.002, (20, 12, 3)))
    assert estimate_repetition(problem, q, np.zeros(36), np.zeros(20, dtype=int), 4e-6) == 1.0
