"""Wrong minima that one start ends in, and what markers hardly tell: never worse than from the true pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scaling_service.capabilities.motion.inverse_kinematics import Task, solve_task
from scaling_service.capabilities.motion.uncertainty import find_determined
from scaling_service.core.arrays import Array
from scaling_service.model.body import BodyModel
from scaling_service.model.trial import Trial
from tests.capabilities.motion.arms import arm, record, swing

OVERHEAD = {"flexion": 2.4, "adduction": -0.6, "elbow": 1.2}
ABDUCTED = {"flexion": 0.2, "adduction": -2.2, "elbow": 1.0}


def compare(model: BodyModel, trial: Trial, q: Array) -> tuple[float, float, Array]:
    """RMS distance (mm), the same when started at the truth in every frame, and the largest steps (deg)."""
    task = Task.of(model, trial)
    found, best = solve_task(task, trial.times), solve_task(task, trial.times, q)
    size = len(trial.times) * len(task.weights)
    ours, theirs = (1e3 * float(np.sqrt(s.cost.sum() / size)) for s in (found, best))
    turning = [c.kind == "rotation" for c in model.coordinates]
    return ours, theirs, np.degrees(np.abs(np.diff(found.q[:, turning], axis=0)).max(axis=0))


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("pose", [OVERHEAD, ABDUCTED], ids=["overhead", "abducted"])
def test_an_elbow_at_its_limit_by_default_does_not_hold_the_arm(pose: dict[str, float], seed: int) -> None:
    model = arm()
    q = swing(model, pose, 0.4, seed=seed)
    ours, theirs, steps = compare(model, record(model, q, 8e-3, seed), q)
    assert ours < theirs + 0.1
    assert steps.max() < 10.0


@pytest.mark.parametrize("seed", range(4))
def test_few_markers_leave_the_arm_on_one_branch(seed: int) -> None:
    model = arm()
    q = swing(model, OVERHEAD, 0.4, seed=seed)
    ours, theirs, steps = compare(model, record(model, q, 8e-3, seed, without=("UPA", "WRB")), q)
    assert ours < theirs + 0.1
    assert steps.max() < 12.0


@pytest.mark.parametrize("seed", range(4))
def test_a_shoulder_goes_through_its_singular_pose_smoothly(seed: int) -> None:
    """The middle of three turns passes a right angle; noise alone would turn the others by half a turn."""
    model = arm(limited=False)
    q = swing(model, {"elbow": 1.0}, 0.2, seed=seed)
    q[:, model.coordinate_names.index("adduction")] = np.linspace(0.8, 2.2, len(q))
    trial = record(model, q, 0.0)
    noise = np.random.default_rng(seed).normal(0.0, 1e-3, trial.markers.shape)
    ours, theirs, steps = compare(model, replace(trial, markers=trial.markers + noise), q)
    assert ours < theirs + 0.05
    assert steps.max() < 15.0
    assert np.abs(steps).max() > 0.0


def test_a_sound_recording_is_solved_as_it_was() -> None:
    """Nothing is doubted where one start suffices: the least squares of every frame by itself."""
    model = arm()
    q = swing(model, {"flexion": 0.4, "elbow": 0.9}, 0.25)
    trial = record(model, q, 3e-3)
    task = Task.of(model, trial)
    found, best = solve_task(task, trial.times), solve_task(task, trial.times, q)
    np.testing.assert_allclose(found.q, best.q, atol=1e-5)


def test_a_marker_as_far_out_as_it_can_be_does_not_free_its_joint() -> None:
    """At no pronation the wrist's one marker moves alike with elbow and forearm; elsewhere it does not."""
    model = arm()
    q = np.zeros((3, len(model.coordinates)))
    q[:, model.coordinate_names.index("elbow")] = 1.0
    q[1:, model.coordinate_names.index("pronation")] = 0.5, 1.0
    task = Task.of(model, record(model, q, 0.0, without=("WRB",)))
    assert find_determined(task, q).all()
    known = find_determined(task.in_frames(np.array([0])), q[:1])
    assert not known[0, model.coordinate_names.index("pronation")]
