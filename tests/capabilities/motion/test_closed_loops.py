"""Legs on a crank: what no marker shows, the loop says; poses obey it, and deviations know of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scaling_service.capabilities.motion.inverse_kinematics import inverse_kinematics
from scaling_service.capabilities.motion.solving import follow_neighbours
from scaling_service.capabilities.motion.task import Task
from scaling_service.capabilities.motion.uncertainty import estimate_coordinate_sd
from scaling_service.core.arrays import Array
from scaling_service.model.body import BodyModel, Constraint, Coordinate, Joint, Law, Marker, Segment
from scaling_service.model.compile import compile_constraints, compile_model
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.closure import CLOSED
from scaling_service.numerics.multibody.sweep import MotionSolution
from scaling_service.numerics.multibody.tree import pose_markers
from tests.capabilities.motion.solvers import answer_by

X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
THIGH, SHANK, CRANK = 0.42, 0.40, 0.17
AXLE = (0.15, -0.62)  # m from the hip
NONE = np.zeros(0)


def shift(axis: tuple[float, float, float], value: float) -> Joint:
    return Joint("translation", axis, Law.constant(value))


def cyclist() -> BodyModel:
    """Thigh and shank hang from a hip, a crank turns on an axle; the ankle sits on the crank's end."""
    segments = (
        Segment(
            name="thigh", parent="ground", joint_name="hip", joints=(Joint("rotation", Z, Law.of("hip")),)
        ),
        Segment(
            name="shank",
            parent="thigh",
            joint_name="knee",
            joints=(shift(Y, -THIGH), Joint("rotation", Z, Law.of("knee"))),
        ),
        Segment(
            name="crank",
            parent="ground",
            joint_name="axle",
            joints=(shift(X, AXLE[0]), shift(Y, AXLE[1]), Joint("rotation", Z, Law.of("crank"))),
        ),
    )
    markers = tuple(
        Marker.at(f"{segment}_{k}", segment, place)
        for segment, length in (("thigh", THIGH), ("shank", SHANK))
        for k, place in enumerate([(0.05, -0.3 * length, 0.02), (-0.04, -0.8 * length, 0.05)])
    )
    ends = (Marker.at("a", "shank", (0.0, -SHANK, 0.0)), Marker.at("b", "crank", (CRANK, 0.0, 0.0)))
    return BodyModel(
        name="cyclist",
        segments=segments,
        coordinates=tuple(Coordinate(name=name) for name in ("hip", "knee", "crank")),
        markers=markers,
        constraints=(Constraint(name="cleat", kind="point", ends=ends),),
    )


def ride(n: int) -> Array:
    """Hip, knee and crank angles over a whole turn and more, by the law of cosines."""
    crank = np.linspace(0.0, 8.0, n)
    ankle = np.stack([AXLE[0] + CRANK * np.cos(crank), AXLE[1] + CRANK * np.sin(crank)])
    reach = np.hypot(*ankle)
    knee = -(np.pi - np.arccos((THIGH**2 + SHANK**2 - reach**2) / (2 * THIGH * SHANK)))
    inner = np.arccos((THIGH**2 + reach**2 - SHANK**2) / (2 * THIGH * reach))
    hip = np.arctan2(ankle[0], -ankle[1]) + inner
    return np.stack([hip, knee, crank], axis=1)


def record(model: BodyModel, q: Array, noise: float) -> Trial:
    placed = pose_markers(compile_model(model), q, NONE)
    placed += np.random.default_rng(3).normal(0.0, noise, placed.shape)
    return Trial(
        name="ride", times=0.02 * np.arange(len(q)), rate_hz=50.0, labels=model.marker_names, markers=placed
    )


def test_the_ride_obeys_by_construction() -> None:
    closure = compile_constraints(cyclist())
    assert closure is not None
    np.testing.assert_allclose(closure.evaluate(ride(20), NONE), 0.0, atol=1e-15)


def test_the_loop_says_where_the_crank_is() -> None:
    model, q = cyclist(), ride(200)
    motion = inverse_kinematics(model, record(model, q, 0.0))
    assert motion.estimated == ("hip", "knee", "crank")
    off = (motion.q - q + np.pi) % (2 * np.pi) - np.pi
    np.testing.assert_allclose(off, 0.0, atol=1e-6)
    open_loop = replace(model, constraints=())
    assert inverse_kinematics(open_loop, record(model, q, 0.0)).estimated == ("hip", "knee")


def test_with_noise_every_frame_obeys_and_none_is_worse_than_the_truth() -> None:
    model, q = cyclist(), ride(200)
    trial = record(model, q, 0.005)
    motion, closure = inverse_kinematics(model, trial), compile_constraints(model)
    assert closure is not None
    assert np.abs(closure.evaluate(motion.q, NONE)).max() < CLOSED
    there = trial.markers - pose_markers(compile_model(model), q, NONE)
    assert (np.square(motion.residuals).sum(axis=(1, 2)) <= np.square(there).sum(axis=(1, 2)) + 1e-9).all()


def test_deviations_are_those_of_repeated_recordings() -> None:
    """The crank's, too, which only the loop determines; and the leg's are smaller than without it."""
    model, q, noise = cyclist(), np.repeat(ride(200)[[30, 77]], 400, axis=0), 0.004
    trial = record(model, q, noise)
    sds = []
    for each in (model, replace(model, constraints=())):
        motion, task = inverse_kinematics(each, trial), Task.of(each, trial)
        known = np.isin(motion.coordinates, motion.estimated) & np.ones(motion.q.shape, dtype=bool)
        sds.append(estimate_coordinate_sd(task, motion.q, motion.residuals, known).sd)
        if each is model:
            spread = (motion.q - q).reshape(2, 400, 3).std(axis=1)
    stated = sds[0].reshape(2, 400, 3).mean(axis=1)
    np.testing.assert_allclose(stated, spread, rtol=0.15)
    assert (sds[0][:, :2] < sds[1][:, :2]).all()
    assert np.isnan(sds[1][:, 2]).all()


def test_a_loop_that_cannot_close_is_not_told() -> None:
    model, q = cyclist(), ride(60)
    far = replace(model.constraints[0].ends[1], laws=(Law.constant(3.0), Law(), Law()))
    broken = replace(model.constraints[0], ends=(model.constraints[0].ends[0], far))
    motion = inverse_kinematics(replace(model, constraints=(broken,)), record(model, q, 0.0))
    assert motion.estimated == ()


@pytest.mark.parametrize("bound", [0.3, 1.0])
def test_bounds_hold_in_a_loop(bound: float) -> None:
    model, q = cyclist(), ride(60)
    coordinates = tuple(
        replace(c, lower=-1.6, upper=-bound, clamped=True, default=-bound) if c.name == "knee" else c
        for c in model.coordinates
    )
    motion = inverse_kinematics(replace(model, coordinates=coordinates), record(model, q, 0.0))
    knee = motion.q[:, 1]
    assert ((knee >= -1.6 - 1e-12) & (knee <= -bound + 1e-12) | np.isnan(knee)).all()
    within = q[:, 1] < -bound
    np.testing.assert_allclose(knee[within & (q[:, 1] > -1.6)], q[within & (q[:, 1] > -1.6), 1], atol=1e-6)


@pytest.mark.parametrize("default", [0.0, -0.5, 0.5])
def test_a_leg_that_no_marker_shows_keeps_to_one_way_of_bending(default: float) -> None:
    model, q = cyclist(), ride(200)
    coordinates = tuple(replace(c, default=default) if c.name == "knee" else c for c in model.coordinates)
    markers = (Marker.at("c", "crank", (0.1, 0.02, 0.0)), Marker.at("d", "crank", (-0.05, 0.08, 0.03)))
    model = replace(model, coordinates=coordinates, markers=markers)
    motion = inverse_kinematics(model, record(model, q, 0.0))
    knee = motion.q[:, 1]
    np.testing.assert_allclose(np.abs(knee), np.abs(q[:, 1]), atol=1e-5)
    assert len(np.unique(np.sign(knee))) == 1
    if default:
        assert np.sign(knee[0]) == np.sign(default)


def test_frames_beyond_a_jump_follow_the_longest_stretch_where_that_is_as_good(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of a motion written in two ways, with a jump that nothing else explains where it must stay."""
    times = 0.01 * np.arange(10)
    q = np.where(np.isin(np.arange(10), [0, 1, 6]), 5.0, 1.0)[:, None] + 0.01 * np.arange(10)[:, None]
    q[9] = -7.0
    found = MotionSolution(q, np.ones(10), np.ones(10, dtype=int), np.ones(10, dtype=bool))

    def solve(rows: Array, start: Array) -> MotionSolution:
        cost = np.where(rows == 9, 2.0, 1.0)
        return MotionSolution(
            start + 0.01, cost, np.ones(len(rows), dtype=int), np.ones(len(rows), dtype=bool)
        )

    joined = follow_neighbours(found, answer_by(solve, len(times), monkeypatch), times).q[:, 0]
    assert (np.abs(np.diff(joined[:9])) < 0.05).all()
    assert joined[3] == q[3, 0]
    assert joined[9] == -7.0
