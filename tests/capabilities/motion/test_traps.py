"""Wrong minima: a good pose spreads through a stretch of wrong ones, and only where it helps."""

from __future__ import annotations

import numpy as np
import pytest

from scaling_service.capabilities.motion.solving import free_trapped
from scaling_service.numerics.multibody.sweep import MotionSolution
from tests.capabilities.motion.solvers import answer_by

GOOD, WRONG = 1.0, -1.0


def found(poses: np.ndarray) -> MotionSolution:
    """Frames at a good or a wrong pose, with the cost of it."""
    cost = np.where(poses == GOOD, 1e-4, 1e-2)
    return MotionSolution(
        poses[:, None].copy(), cost, np.ones(len(poses), dtype=int), np.ones(len(poses), dtype=bool)
    )


def test_a_long_stretch_is_freed_from_both_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    poses = np.full(100, GOOD)
    poses[20:90] = WRONG
    calls = []

    def solve(rows: np.ndarray, starts: np.ndarray) -> MotionSolution:
        calls.append(len(rows))
        return found(starts[:, 0])  # whoever starts from a good pose ends there

    free = free_trapped(found(poses), answer_by(solve, len(poses), monkeypatch))
    assert (free.q[:, 0] == GOOD).all()
    assert (free.cost == 1e-4).all()
    assert sum(calls) == 70, "no frame is solved twice"


def test_frames_that_cannot_be_freed_do_not_go_on_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    poses = np.full(60, GOOD)
    poses[30:40] = WRONG
    tries = []

    def solve(rows: np.ndarray, starts: np.ndarray) -> MotionSolution:
        tries.extend(rows.tolist())
        return found(np.full(len(rows), WRONG))

    free = free_trapped(found(poses), answer_by(solve, len(poses), monkeypatch))
    assert (free.q[30:40, 0] == WRONG).all()
    assert sorted(tries) == [30, 39], "only those beside a good frame, once"


def test_a_worse_solution_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    poses = np.array([GOOD, GOOD, GOOD, WRONG])

    def solve(rows: np.ndarray, starts: np.ndarray) -> MotionSolution:
        answer = found(starts[:, 0])
        return MotionSolution(answer.q, answer.cost + 1.0, answer.steps, answer.converged)

    freed = free_trapped(found(poses), answer_by(solve, len(poses), monkeypatch))
    assert np.array_equal(freed.q, found(poses).q)
