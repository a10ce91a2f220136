"""Dynamically consistent motion of virtual squatters, whose angles and forces are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scaling_service.capabilities.consistent.estimate import estimate_consistent
from scaling_service.capabilities.consistent.motion import solve_consistent_motion
from scaling_service.capabilities.consistent.planar import find_sagittal_plane, project_loads
from scaling_service.capabilities.consistent.problem import ConsistentSettings
from scaling_service.capabilities.consistent.recording import (
    estimate_classical_motion,
    gather_limits,
    pose_problem,
)
from scaling_service.core.errors import TrialUnusable
from scaling_service.model.body import BodyModel
from scaling_service.numerics.signals.splines import Unknowns
from scaling_service.studies.futamure.squatters import make_virtual_squatter
from scaling_service.studies.futamure.study import make_recording, start_model

FAULTLESS = make_virtual_squatter(1, faults=0.0)
REAL = make_virtual_squatter(3)
SETTINGS = ConsistentSettings(placed_m=0.007)


def test_without_faults_the_truth_is_found_and_kept() -> None:
    plane = find_sagittal_plane(FAULTLESS.fitted.trial)
    filtered = make_recording(FAULTLESS.model, FAULTLESS.fitted, plane)
    recording = replace(filtered, loads=project_loads(FAULTLESS.fitted.loads, plane))
    problem = pose_problem(
        FAULTLESS.model, recording, estimate_classical_motion(FAULTLESS.model, recording, SETTINGS), SETTINGS
    )
    start = Unknowns(problem.basis.fit(recording.motion.q), np.zeros(problem.n_shared))
    found = solve_consistent_motion(problem, start, gather_limits(FAULTLESS.model, problem))
    truth = FAULTLESS.fitted.truth.q
    error = np.degrees(np.sqrt(((found.rated.q - truth) ** 2).mean(axis=0)))
    assert error.max() < 0.1  # camera noise alone makes as much
    assert np.sqrt((found.objectives.wrench_gaps[:, [0, 1, 5]] ** 2).mean(axis=0)).max() < 1.0


@pytest.fixture(scope="module")
def started() -> tuple[BodyModel, object]:
    plane = find_sagittal_plane(REAL.fitted.trial)
    model = start_model(REAL, plane)
    return model, plane


def test_forces_are_followed_and_angles_come_nearer(started: tuple[BodyModel, object]) -> None:
    model, plane = started
    fitted, held_out = (make_recording(model, s, plane) for s in (REAL.fitted, REAL.held_out))  # type: ignore[arg-type]
    found = estimate_consistent(model, [fitted], [held_out], SETTINGS)
    rows = [0, 1, 5]
    assert (found.consistent[0].wrench_rmse[rows] <= 0.7 * found.classical[0].wrench_rmse[rows]).all()
    assert (found.consistent[1].wrench_rmse[rows] <= 1.2 * found.consistent[0].wrench_rmse[rows]).all()
    errors = [np.abs(f[0].rated.q - REAL.fitted.truth.q).mean() for f in (found.classical, found.consistent)]
    assert errors[1] < errors[0]
    rated = found.consistent[0].rated
    # Sixth-order differences of the angles: nothing but their truncation stands between them and the rates.
    h = rated.times[1] - rated.times[0]
    q = rated.q
    slope = (45 * (q[4:-2] - q[2:-4]) - 9 * (q[5:-1] - q[1:-5]) + (q[6:] - q[:-6])) / (60 * h)
    inner = np.abs(slope - rated.qdot[3:-3])
    assert inner.max() < 1e-4


def test_joint_limits_hold(started: tuple[BodyModel, object]) -> None:
    model, plane = started
    knee = np.radians(60.0)
    bounded = replace(
        model,
        coordinates=tuple(
            replace(c, lower=-1.0, upper=float(knee), clamped=True) if c.name == "knee_angle" else c
            for c in model.coordinates
        ),
    )
    recording = make_recording(model, REAL.fitted, plane)  # type: ignore[arg-type]
    problem = pose_problem(
        bounded, recording, estimate_classical_motion(bounded, recording, SETTINGS), SETTINGS
    )
    start = Unknowns(problem.basis.fit(recording.motion.q), np.zeros(problem.n_shared))
    found = solve_consistent_motion(problem, start, gather_limits(bounded, problem))
    assert found.rated.q[:, 1].max() <= knee + 1e-12
    assert found.rated.q[:, 1].max() > knee - 0.01


def test_no_known_force_is_refused(started: tuple[BodyModel, object]) -> None:
    model, plane = started
    recording = make_recording(model, REAL.fitted, plane)  # type: ignore[arg-type]
    nowhere = replace(recording, supported=np.zeros_like(recording.supported))
    with pytest.raises(TrialUnusable, match="no frame has all its forces known"):
        pose_problem(model, nowhere, estimate_classical_motion(model, nowhere, SETTINGS), SETTINGS)
