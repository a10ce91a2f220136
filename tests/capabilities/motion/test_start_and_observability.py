"""First guesses of the pose, and which coordinates the markers determine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scaling_service.capabilities.motion.ranges import (
    list_prior_sds,
    measure_left,
    weigh_ranges,
)
from scaling_service.capabilities.motion.solving import guess_start
from scaling_service.capabilities.motion.task import Task
from scaling_service.capabilities.motion.uncertainty import find_determined
from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import load_builtin
from scaling_service.model.compile import (
    compile_model,
    free_coordinates,
    list_coordinate_ranges,
    list_parameter_values,
    repeat_default_pose,
)
from scaling_service.numerics.multibody.tree import pose_markers
from tests.numerics.bodies import leg, leg_motion, random_tree

NONE = np.zeros(0)


def follow(model: BodyModel, measured: np.ndarray, weights: np.ndarray | None = None) -> Task:
    """A model's markers, all coordinates free, whether or not any is seen."""
    tree, n = compile_model(model), len(model.coordinates)
    heavy = np.ones(tree.n_markers) if weights is None else weights
    free, bounds = np.ones(n, dtype=bool), (np.full(n, -np.inf), np.full(n, np.inf))
    return Task(
        model=model,
        tree=tree,
        markers=model.marker_names,
        measured=measured,
        weights=heavy,
        free=free,
        bounds=bounds,
        p=NONE,
        ranges=weigh_ranges(model, tree, measured, heavy, free, NONE),
    )


@settings(max_examples=30)
@given(seed=st.integers(0, 10_000))
def test_the_guess_puts_the_root_where_its_markers_are(seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = leg(rng)
    tree = compile_model(model)
    q = np.zeros((4, 10))
    q[:, :3], q[:, [3, 5]] = rng.uniform(-3.0, 3.0, (4, 3)), rng.uniform(-3.0, 3.0, (4, 2))
    q[:, 4] = rng.uniform(-1.4, 1.4, 4)
    q[:, 6:] = rng.uniform(-1.0, 1.0, (4, 4))
    measured = pose_markers(tree, q, NONE)
    guess = guess_start(follow(model, measured), np.zeros(10))
    own = tree.marker_rows[0]
    np.testing.assert_allclose(pose_markers(tree, guess, NONE)[:, own], measured[:, own], rtol=0, atol=1e-9)
    np.testing.assert_array_equal(guess[:, 6:], 0.0)


def test_frames_without_markers_take_the_nearest_guess() -> None:
    rng = np.random.default_rng(1)
    model = leg(rng)
    tree, q = compile_model(model), leg_motion(rng, 6)
    measured = pose_markers(tree, q, NONE)
    measured[[0, 3]] = np.nan
    guess = guess_start(follow(model, measured), np.zeros(10))
    np.testing.assert_array_equal(guess[0], guess[1])
    assert (guess[3] == guess[2]).all() or (guess[3] == guess[4]).all()


def test_with_two_root_markers_the_whole_body_places_the_root() -> None:
    rng = np.random.default_rng(2)
    model = leg(rng)
    tree = compile_model(model)
    q = np.tile(leg_motion(rng, 1), (3, 1))
    q[:, 6:] = 0.0
    measured = pose_markers(tree, q, NONE)
    measured[:, tree.marker_rows[0][:2]] = np.nan
    guess = guess_start(follow(model, measured), np.zeros(10))
    np.testing.assert_allclose(guess, q, rtol=0, atol=1e-9)


def test_a_root_that_is_not_free_is_left_alone() -> None:
    rng = np.random.default_rng(3)
    model = leg(rng)
    tree = compile_model(model)
    free = np.array([False] * 6 + [True] * 4)
    neutral = rng.normal(size=10)
    task = replace(follow(model, np.zeros((2, tree.n_markers, 3))), free=free)
    guess = guess_start(task, neutral)
    np.testing.assert_array_equal(guess, np.tile(neutral, (2, 1)))


def verdict(seen: list[str], *, weights: np.ndarray | None = None) -> dict[str, bool]:
    rng = np.random.default_rng(4)
    model = leg(rng)
    tree, q = compile_model(model), leg_motion(rng, 2)
    measured = pose_markers(tree, q, NONE)
    measured[:, [k for k, n in enumerate(model.marker_names) if n not in seen]] = np.nan
    found = find_determined(follow(model, measured, weights), q)
    assert (found == found[0]).all()
    return dict(zip(model.coordinate_names, found[0].tolist(), strict=True))


def test_everything_seen_everything_determined() -> None:
    assert all(verdict([f"{s}{k}" for s in ("pelvis", "femur", "tibia") for k in range(4)]).values())


@pytest.mark.parametrize(
    ("seen", "lost"),
    [
        (["pelvis0", "pelvis1", "pelvis2", "femur0", "femur1"], {"knee"}),
        (["pelvis0", "pelvis1", "pelvis2"], {"hip_z", "hip_x", "hip_y", "knee"}),
        ([], {*leg(np.random.default_rng(0)).coordinate_names}),
    ],
)
def test_what_no_marker_hangs_on_is_lost(seen: list[str], lost: set[str]) -> None:
    assert {name for name, known in verdict(seen).items() if not known} == lost


def test_one_marker_on_a_ball_joint_leaves_turns_open() -> None:
    found = verdict(["pelvis0", "pelvis1", "pelvis2", "femur0"])
    assert all(found[name] for name in found if name.startswith("root"))
    assert not all(found[name] for name in ("hip_z", "hip_x", "hip_y"))


def test_markers_of_weight_zero_do_not_count() -> None:
    weights = np.array([1.0] * 8 + [0.0] * 4)
    every = [f"{s}{k}" for s in ("pelvis", "femur", "tibia") for k in range(4)]
    assert not verdict(every, weights=weights)["knee"]


@settings(max_examples=20)
@given(seed=st.integers(0, 10_000))
def test_the_verdict_is_that_of_the_rank(seed: int) -> None:
    """A coordinate is determined if no null vector of the Jacobian moves it."""
    rng = np.random.default_rng(seed)
    model = random_tree(rng, 3, markers_each=1)
    tree, n = compile_model(model), len(model.coordinates)
    q = rng.uniform(-1.0, 1.0, (1, n))
    measured = pose_markers(tree, q, NONE)
    rates = np.empty((3 * tree.n_markers, n))
    for k in range(n):
        up, down = q.copy(), q.copy()
        up[0, k], down[0, k] = q[0, k] + 1e-5, q[0, k] - 1e-5
        rates[:, k] = ((pose_markers(tree, up, NONE) - pose_markers(tree, down, NONE)) / 2e-5).ravel()
    values, vectors = np.linalg.eigh(rates.T @ rates)
    if ((values > 1e-9) & (values < 1e-5)).any():
        return  # neither clearly determined nor clearly not
    loose = (vectors[:, values < 1e-7] ** 2).sum(axis=1)
    if ((loose > 1e-4) & (loose < 0.05)).any():
        return
    found = find_determined(follow(model, measured), q)[0]
    np.testing.assert_array_equal(found, loose < 1e-2)


def test_what_markers_leave_of_the_ranges_is_the_posterior_of_their_differences() -> None:
    model = load_builtin("lower_limb_14dof")
    tree, p, free = compile_model(model), list_parameter_values(model), free_coordinates(model)
    told = np.random.default_rng(5).integers(0, 2, (4, tree.n_markers)).astype(float)
    found = measure_left(model, tree, told, free, p)
    spread, neutral = list_prior_sds(model), repeat_default_pose(model, 1)[0]
    asked = np.flatnonzero(free & np.isfinite(spread))
    middle = neutral.copy()
    middle[asked] = np.array(list_coordinate_ranges(model))[:, asked].mean(axis=0)
    step = 1e-6 * np.eye(len(neutral))
    prior = np.full(len(neutral), 1e-4)
    prior[asked] = spread[asked] ** -2.0
    for pattern, left in zip(told, found, strict=True):
        shares = []
        for q in (neutral, 0.5 * (neutral + middle)):
            rates = (pose_markers(tree, q + step, p) - pose_markers(tree, q - step, p)) / 2e-6
            seen = (rates * pattern[:, None]).reshape(len(neutral), -1)[free] / 0.010  # SD of a marker, m
            share = np.zeros(len(neutral))
            share[free] = np.diag(np.linalg.inv(seen @ seen.T + np.diag(prior[free]))) * prior[free]
            shares.append(share)
        expected = np.min(shares, axis=0)
        np.testing.assert_allclose(left[asked], expected[asked], rtol=1e-5, atol=1e-8)
        assert not left[np.setdiff1d(np.arange(len(left)), asked)].any()
    assert (found[:, asked] > 0.5).any()
    assert (found[:, asked] < 0.1).any()
