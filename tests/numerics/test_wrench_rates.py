"""Derivatives of wrench and markers along a motion, against central differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scaling_service.core.arrays import Array
from scaling_service.model.body import BodyModel, Coordinate, Joint, Law, Shape, Surface, Term
from scaling_service.model.builtin import load_builtin
from scaling_service.model.compile import compile_model
from scaling_service.model.inertia import compile_mechanism
from scaling_service.numerics.multibody.marker_rates import (
    MarkerShifts,
    compute_marker_motion,
    form_normal_equations,
    list_twist_rows,
    shift_normal,
)
from scaling_service.numerics.multibody.motion import Mechanism, Motion, list_screws, move_links
from scaling_service.numerics.multibody.tree import Tree
from scaling_service.numerics.wrench import compute_root_wrench, differentiate_wrench

STEP, FRAMES = 1e-5, 3
RNG = np.random.default_rng(11)


def _coupled() -> BodyModel:
    """The squat with a knee that glides and turns inward by curves of its angle, and a locked hip."""
    model = load_builtin("squat_4dof")
    curve = Shape((-2.0, 0.1, 2.0), ((0.03, -0.02, 0.01, 0.0), (-0.01, 0.04, 0.02, 0.03)))
    extra = (
        Joint("translation", (1.0, 0.0, 0.0), Law((Term(1.0, coordinate="knee_angle", shape=curve),))),
        Joint("rotation", (0.0, 1.0, 0.0), Law((Term(5.0, coordinate="knee_angle", shape=curve),))),
    )
    segments = tuple(
        replace(s, joints=(*s.joints, *extra)) if s.name == "thigh" else s for s in model.segments
    )
    locked = tuple(replace(c, locked=c.name == "hip_angle") for c in model.coordinates)
    return replace(model, segments=segments, coordinates=locked)


def _gliding() -> BodyModel:
    """The squat with a thigh that glides along surfaces of knee and hip."""
    model, both = load_builtin("squat_4dof"), ("knee_angle", "hip_angle")
    surfaces = (
        Surface("arc_x", both, (0.1, 0.2)),
        Surface("normal_y", both),
        Surface("powers", both, (2.0, 3.0)),
    )
    axes = ((0.6, 0.8, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    extra = tuple(
        Joint("translation", axis, Law((Term(0.3, surface=surface),)))
        for axis, surface in zip(axes, surfaces, strict=True)
    )
    twist = Joint("rotation", (0.0, 1.0, 0.0), Law((Term(0.3, surface=surfaces[0]),)))
    segments = tuple(
        replace(s, joints=(*s.joints, *extra, twist)) if s.name == "thigh" else s for s in model.segments
    )
    return replace(model, segments=segments)


MODELS = {
    "coupled squat": _coupled(),
    "gliding squat": _gliding(),
    "full body": load_builtin("full_body_35dof"),
}


def _motion(model: BodyModel) -> tuple[Array, Array, Array]:
    q, qdot, qddot = (0.4 * RNG.normal(size=(len(model.coordinates), FRAMES)) for _ in range(3))
    return q, qdot, qddot


def _differences(model: BodyModel, state: tuple[Array, Array, Array], compute, free: Array) -> Array:  # type: ignore[no-untyped-def]
    """Central differences of ``compute(motion)`` by order and free coordinate, stacked last."""
    columns = []
    for order in range(3):
        for c in free.tolist():
            ends = []
            for sign in (1, -1):
                moved = [x.copy() for x in state]
                moved[order][c] += sign * STEP
                ends.append(compute(Motion(*moved)))
            columns.append((ends[0] - ends[1]) / (2 * STEP))
    return np.stack(columns, axis=-1).reshape(*columns[0].shape, 3, len(free))


def _free(model: BodyModel) -> Array:
    coordinates: tuple[Coordinate, ...] = model.coordinates
    return np.array([k for k, c in enumerate(coordinates) if not c.locked])


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_the_wrench_changes_as_differences_say(model: BodyModel) -> None:
    mechanism, p, state, free = compile_mechanism(model), np.zeros(0), _motion(model), _free(model)
    wrench, by = differentiate_wrench(mechanism, list_screws(mechanism, Motion(*state), p, free), len(free))
    np.testing.assert_allclose(wrench, compute_root_wrench(mechanism, Motion(*state), p)[0], atol=1e-9)
    expected = _differences(model, state, lambda m: compute_root_wrench(mechanism, m, p)[0].T, free)
    assert np.abs(by - expected).max() < 1e-6 * np.abs(expected).max()


def _tree(model: BodyModel, mechanism: Mechanism) -> Tree:
    tree = compile_model(model)
    assert len(tree.links) == mechanism.n_links
    return tree


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_normal_equations_of_markers_are_those_of_differences(model: BodyModel) -> None:
    mechanism, p, state, free = compile_mechanism(model), np.zeros(0), _motion(model), _free(model)
    tree = _tree(model, mechanism)
    count = tree.n_markers
    shifts = MarkerShifts(
        marker=RNG.integers(count, size=6),
        axis=RNG.integers(3, size=6),
        signal=RNG.integers(2, size=6),
        sd=RNG.uniform(0.01, 0.03, 6),
        signals=RNG.normal(size=(3, FRAMES, 2)),
    )
    x = RNG.normal(size=6)

    def moved(motion: Motion, shared: Array = x) -> Array:
        at = move_links(mechanism, motion, p)
        return compute_marker_motion(tree, p, at) + shifts.move(shifts.columns(tree, at), shared, count)

    motion = Motion(*state)
    gap, weights = RNG.normal(size=(3, FRAMES, count, 3)), RNG.random((3, FRAMES, count))
    screws = list_screws(mechanism, motion, p, free)
    columns, rows = shifts.columns(tree, screws.state), list_twist_rows(moved(motion))
    gradient, curvature = form_normal_equations(mechanism, tree, screws, rows, gap, weights, len(free))
    found = shift_normal(shifts, mechanism, tree, screws, rows, columns, gap, weights, len(free))
    J = _differences(model, state, moved, free)  # (3, n, markers, 3, order, m)
    X = np.stack([moved(motion, x + e) - moved(motion, x) for e in np.eye(6)], axis=-1)
    for ours, expected in (
        (gradient, -np.einsum("onm,onma,onmaic->nic", weights, gap, J)),
        (curvature, np.einsum("onm,onmaic,onmajd->nijcd", weights, J, J)),
        (found[0], -np.einsum("onm,onma,onmak->k", weights, gap, X)),
        (found[1], np.einsum("onm,onmak,onmal->kl", weights, X, X)),
        (found[2], np.einsum("onm,onmaic,onmak->nick", weights, J, X)),
    ):
        assert np.abs(ours - expected).max() < 1e-6 * max(np.abs(expected).max(), 1e-3)
