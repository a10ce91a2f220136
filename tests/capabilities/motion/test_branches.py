"""One pose, written in several ways: the other triplet, full turns, and what stands nearest to the ranges."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scaling_service.capabilities.motion.branches import find_triplets, find_turning, join_branches
from scaling_service.model.compile import compile_model, list_coordinate_bounds, list_parameter_values
from scaling_service.numerics.multibody.tree import pose_markers
from tests.capabilities.motion.arms import SHOULDER, X, Y, Z, arm, swing

ORDERS = [o for o in itertools.product((X, Y, Z), repeat=3) if o[0] != o[1] != o[2]]
FREE = (np.full(11, -np.inf), np.full(11, np.inf))


@pytest.mark.parametrize("axes", ORDERS, ids=lambda a: "".join("xyz"[v.index(1.0)] for v in a))
def test_the_other_triplet_is_the_same_rotation(axes: tuple[tuple[float, float, float], ...]) -> None:
    model = arm(axes, limited=False)
    tree, p = compile_model(model), list_parameter_values(model)
    own = [model.coordinate_names.index(n) for n in SHOULDER]
    (triplet,) = [t for t in find_triplets(tree) if set(t.coordinates) == set(own)]
    q = np.random.default_rng(0).uniform(-3.0, 3.0, (20, 11))
    other = q.copy()
    other[:, triplet.coordinates] = triplet.write_otherwise(q[:, triplet.coordinates])
    np.testing.assert_allclose(pose_markers(tree, other, p), pose_markers(tree, q, p), atol=1e-12)
    again = triplet.write_otherwise(other[:, triplet.coordinates]) - q[:, triplet.coordinates]
    np.testing.assert_allclose(np.cos(again), 1.0, atol=1e-12)


@given(st.integers(0, 10_000))
@settings(max_examples=25)
def test_a_motion_cut_into_ways_of_writing_is_joined_again(seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = arm(limited=False)
    tree, p = compile_model(model), list_parameter_values(model)
    q = swing(model, dict(zip(SHOULDER, rng.uniform(-1.0, 1.0, 3), strict=True)), 0.5, seed=seed)
    cut = q.copy()
    for triplet in find_triplets(tree):
        some = rng.random(len(q)) < 0.5
        cut[np.ix_(some, triplet.coordinates)] = triplet.write_otherwise(q[some][:, triplet.coordinates])
    turning = find_turning(tree)
    cut[:, turning] += 2.0 * np.pi * rng.integers(-2, 3, (len(q), len(turning)))
    joined = join_branches(tree, cut, FREE, FREE, np.zeros(11))
    np.testing.assert_allclose(pose_markers(tree, joined, p), pose_markers(tree, q, p), atol=1e-9)
    assert np.abs(np.diff(joined, axis=0)).max() < 1.5 * np.abs(np.diff(q, axis=0)).max() + 1e-9
    np.testing.assert_allclose(joined, q, atol=1e-9)  # nearest to the default pose


def test_bounds_are_kept() -> None:
    model = arm()
    tree = compile_model(model)
    q = swing(model, {"flexion": 2.4, "adduction": -0.6, "elbow": 1.2}, 0.3)
    bounds = list_coordinate_bounds(model)
    joined = join_branches(tree, q, bounds, bounds, np.zeros(11))
    assert (joined >= bounds[0]).all()
    assert (joined <= bounds[1]).all()
    np.testing.assert_array_equal(joined, q)
