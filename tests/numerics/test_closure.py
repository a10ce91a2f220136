"""Loops that a tree does not close: equations, their rates, and how poses are brought to obey them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scaling_service.core.arrays import Array
from scaling_service.model.body import BodyModel, Constraint, Law, Marker, Parameter, Term
from scaling_service.model.compile import compile_constraints
from scaling_service.numerics.multibody.closure import Closure
from scaling_service.numerics.multibody.rigid import convert_rotation_to_vector
from tests.numerics.bodies import random_tree, slow_markers

KINDS = ("point", "weld", "distance", "line", "law")


def constrain(seed: int, kinds: tuple[str, ...] = KINDS) -> BodyModel:
    """A tree with a constraint of each kind, one end of which is on the ground or moves with a parameter."""
    rng = np.random.default_rng(seed)
    model = random_tree(rng, 4)
    names = model.coordinate_names
    found = []
    for number, kind in enumerate(kinds):
        x, y, z = (Law.constant(v) for v in rng.uniform(-0.2, 0.2, 3))
        ends = (
            Marker(name="a", segment="s3", laws=(x + Law((Term(1.0, parameter="shift"),)), y, z)),
            Marker.at("b", "ground" if number % 2 else "s1", tuple(rng.uniform(-0.2, 0.2, 3).tolist())),
        )
        found.append(
            Constraint(
                name=kind,
                kind=kind,
                ends=() if kind == "law" else ends,
                turns=tuple(tuple(t) for t in rng.uniform(-1.0, 1.0, (2, 3)).tolist()),
                distance=0.3,
                direction=tuple(rng.normal(size=3).tolist()),
                law=Law.of(names[0]) + Law.of(names[-1], -0.7, 0.1) if kind == "law" else Law(),
            )
        )
    shift = Parameter(name="shift", value=0.05, unit="m", lower=-1, upper=1, group="marker", target="a")
    return replace(model, constraints=tuple(found), parameters=(shift,))


def compiled(model: BodyModel) -> Closure:
    closure = compile_constraints(model)
    assert closure is not None
    return closure


def test_a_model_without_constraints_has_none() -> None:
    assert compile_constraints(random_tree(np.random.default_rng(1), 2)) is None


@pytest.mark.parametrize("kind", KINDS)
def test_equations_are_what_the_slow_recursion_says(kind: str) -> None:
    model = constrain(3, (kind,))
    (item,), q = model.constraints, np.random.default_rng(4).uniform(-1, 1, (1, len(model.coordinates)))
    found = compiled(model).evaluate(q, np.array([0.05]))[0]
    values = dict(zip(model.coordinate_names, q[0], strict=True)) | {"shift": 0.05}
    if kind == "law":
        expected = values[model.coordinate_names[0]] - 0.7 * values[model.coordinate_names[-1]] + 0.1
        np.testing.assert_allclose(found, [expected, 0.0, 0.0], atol=1e-15)
        return
    a, b = slow_markers(replace(model, markers=item.ends), values).real
    if kind == "distance":
        np.testing.assert_allclose(found, [np.linalg.norm(a - b) - 0.3], atol=1e-14)
    elif kind == "line":
        tip = item.ends[0].laws
        moved = tuple(law + Law.constant(d) for law, d in zip(tip, item.direction, strict=True))
        ahead = slow_markers(replace(model, markers=(replace(item.ends[0], laws=moved),)), values).real[0]
        along = (ahead - a) / np.linalg.norm(ahead - a)
        off = (b - a) - along * (along @ (b - a))
        np.testing.assert_allclose(np.linalg.norm(found), np.linalg.norm(off), atol=1e-14)
    else:
        np.testing.assert_allclose(found[:3], a - b, atol=1e-14)
        assert len(found) == (9 if kind == "weld" else 3)


def test_rates_are_those_of_differences() -> None:
    model, step = constrain(5), 1e-6
    closure, count = compiled(model), len(model.coordinates)
    q, p = np.random.default_rng(6).uniform(-1, 1, (3, count)), np.array([0.05])
    missed, rates = closure.linearise(q, p, np.arange(count + 1))
    np.testing.assert_array_equal(missed, closure.evaluate(q, p))
    for k in range(count + 1):
        by, also = step * (np.arange(count) == k), np.array([step * (k == count)])
        expected = (closure.evaluate(q + by, p + also) - closure.evaluate(q - by, p - also)) / (2 * step)
        np.testing.assert_allclose(rates[:, k], expected, rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("kind", KINDS)
def test_poses_near_are_brought_to_obey(kind: str) -> None:
    """A pose that obeys, by construction, is found again from beside it, and bounds hold."""
    model = constrain(7, (kind,))
    q0 = np.random.default_rng(8).uniform(-0.5, 0.5, len(model.coordinates))
    model = replace(model, constraints=tuple(obeying(model, item, q0) for item in model.constraints))
    closure, p = compiled(model), np.array([0.05])
    np.testing.assert_allclose(closure.evaluate(q0[None], p), 0.0, atol=1e-12)
    q = q0 + np.random.default_rng(9).normal(0.0, 0.05, (5, len(q0)))
    free, bound = np.arange(len(q0)), np.full(len(q0), 3.0)
    fixed = q[:, :1].copy()
    closure.close(
        q,
        p,
        free[1:] if kind != "law" else free,
        -bound[1:] if kind != "law" else -bound,
        bound[1:] if kind != "law" else bound,
    )
    assert np.abs(closure.evaluate(q, p)).max() < 1e-10
    if kind != "law":
        np.testing.assert_array_equal(q[:, :1], fixed)


def obeying(model: BodyModel, item: Constraint, q0: Array) -> Constraint:
    """The constraint with its second end, or its constant, moved to where it is obeyed."""
    values = dict(zip(model.coordinate_names, q0.tolist(), strict=True)) | {"shift": 0.05}
    if item.kind == "law":
        missed = compiled(replace(model, constraints=(item,))).evaluate(q0[None], np.array([0.05]))[0, 0]
        return replace(item, law=item.law + Law.constant(-missed))
    probes = [
        Marker.at(f"p{k}", "s1", tuple(row)) for k, row in enumerate(np.vstack([np.zeros(3), np.eye(3)]))
    ]
    a, origin, *tips = slow_markers(replace(model, markers=(item.ends[0], *probes)), values).real
    local = (np.array(tips) - origin) @ (a - origin)
    end = Marker.at("b", "s1", tuple(local.tolist()))
    if item.kind == "distance":
        return replace(
            item, ends=(item.ends[0], replace(end, laws=(end.laws[0] + Law.constant(0.3), *end.laws[1:])))
        )
    return replace(item, ends=(item.ends[0], end), turns=((0.0, 0.0, 0.0), _between(model, values)))


def _between(model: BodyModel, values: dict[str, float]) -> tuple[float, float, float]:
    """How s3 is turned in s1, as a rotation vector."""
    frames = []
    for name in ("s1", "s3"):
        probes = tuple(
            Marker.at(f"p{k}", name, tuple(row)) for k, row in enumerate(np.vstack([np.zeros(3), np.eye(3)]))
        )
        origin, *tips = slow_markers(replace(model, markers=probes), values).real
        frames.append((np.array(tips) - origin).T)
    x, y, z = convert_rotation_to_vector(frames[0].T @ frames[1]).tolist()
    return x, y, z
