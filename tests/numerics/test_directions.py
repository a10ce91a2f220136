"""Directions: markers at infinity, which turn with their link and know nothing of where it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from scaling_service.model.body import Marker
from scaling_service.model.builtin import load_builtin
from scaling_service.model.compile import (
    compile_model,
    free_coordinates,
    list_parameter_values,
    repeat_default_pose,
)
from scaling_service.model.poses import pose_segments
from scaling_service.numerics.least_squares.blocks import solve_motion_alone
from scaling_service.numerics.least_squares.problem import Problem
from scaling_service.numerics.multibody.sweep import solve_motion
from scaling_service.numerics.multibody.tree import (
    compute_jacobian,
    place_tree_markers,
    pose_links,
    pose_markers,
)

ARM = 0.2  # m


def make():
    """The legs with three directions on every segment, beside their markers, in some poses."""
    model = load_builtin("lower_limb_14dof")
    tips = [
        replace(Marker.at(f"{name}@{k}", name, tuple(ARM * np.eye(3)[k])), is_direction=True)
        for name in model.segment_names
        for k in range(3)
    ]
    model = model.with_markers((*model.markers, *tips))
    rng = np.random.default_rng(4)
    q = repeat_default_pose(model, 7) + rng.normal(0.0, 0.2, (7, len(model.coordinates)))
    return model, compile_model(model), q, list_parameter_values(model)


def test_directions_are_the_axes_of_their_segments():
    model, tree, q, p = make()
    poses = pose_segments(model, q)
    axes = Rotation.from_quat(poses[..., 3:].reshape(-1, 4)).as_matrix().reshape(7, -1, 3, 3)
    found = pose_markers(tree, q, p)[:, len(tree.marker_link) - 15 :].reshape(7, 5, 3, 3)
    np.testing.assert_allclose(found, ARM * axes.swapaxes(2, 3), atol=1e-12)


def test_jacobian_is_the_finite_difference():
    model, tree, q, p = make()
    variables = np.flatnonzero(free_coordinates(model))
    poses = pose_links(tree, np.ascontiguousarray(q.T), p)
    rates = compute_jacobian(tree, poses, place_tree_markers(tree, poses), variables)
    step = 1e-6
    for k, variable in enumerate(variables):
        moved = [pose_markers(tree, q + side * step * np.eye(q.shape[1])[variable], p) for side in (1, -1)]
        slope = (moved[0] - moved[1]) / (2.0 * step)
        np.testing.assert_allclose(np.moveaxis(rates[k], -1, 0), slope, atol=1e-8)


def test_sweeps_and_estimator_agree_on_markers_beside_directions():
    model, tree, q, p = make()
    rng = np.random.default_rng(5)
    measured = pose_markers(tree, q, p) + rng.normal(0.0, 0.01, (7, tree.n_markers, 3))
    measured[2, 3], measured[4, -3:] = np.nan, np.nan
    weights = rng.uniform(0.5, 2.0, tree.n_markers)
    free = free_coordinates(model)
    start = q + rng.normal(0.0, 0.02, q.shape) * free
    swept = solve_motion(tree, measured, weights, start, p, free=free)
    none, nothing = np.zeros(0), np.zeros(0, dtype=np.intp)
    problem = Problem(
        tree=tree,
        measured=measured,
        weights=weights,
        coordinates=np.flatnonzero(free),
        parameters=nothing,
        scale=none,
        lower=none,
        upper=none,
        prior_weight=none,
        coordinate_bounds=(np.full(q.shape[1], -np.inf), np.full(q.shape[1], np.inf)),
    )
    dense = solve_motion_alone(problem, start, p)
    np.testing.assert_allclose(swept.q, dense.q, atol=1e-5)
    np.testing.assert_allclose(swept.cost.sum(), dense.cost, rtol=1e-7)


def test_directions_alone_give_the_turns_wherever_the_body_is():
    model, _, q, p = make()
    tree = compile_model(model, [m.name for m in model.markers if m.is_direction])
    shifts = [k for k, c in enumerate(model.coordinates) if c.kind == "translation"]
    elsewhere = q.copy()
    elsewhere[:, shifts] += 5.0
    measured = pose_markers(tree, q, p)
    np.testing.assert_allclose(pose_markers(tree, elsewhere, p), measured, atol=1e-12)
    start = repeat_default_pose(model, len(q))
    found = solve_motion(tree, measured, np.ones(tree.n_markers), start, p, free=free_coordinates(model))
    turns = [k for k, c in enumerate(model.coordinates) if c.kind == "rotation" and not c.locked]
    np.testing.assert_allclose(found.q[:, turns], q[:, turns], atol=1e-6)
