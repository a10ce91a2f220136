"""Tasks whose frames are solved by what a test says, in place of inverse kinematics."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

from scaling_service.capabilities.motion import solving
from scaling_service.capabilities.motion.task import Task
from scaling_service.core.arrays import Array
from scaling_service.numerics.multibody.sweep import MotionSolution

Answer = Callable[[NDArray[np.intp], Array], MotionSolution]
"""Frames (rows) and starts (n_rows, n_coordinates) to their solution."""


@dataclass(frozen=True, eq=False)
class _Told:
    answer: Answer
    rows: NDArray[np.intp]

    def in_frames(self, rows: NDArray[np.intp]) -> _Told:
        return replace(self, rows=self.rows[rows])


def answer_by(answer: Answer, n_frames: int, monkeypatch: pytest.MonkeyPatch) -> Task:
    """A task of so many frames that are solved by ``answer``."""

    def solve(task: _Told, start: Array, **_: Any) -> MotionSolution:
        return task.answer(task.rows, start)

    monkeypatch.setattr(solving, "solve_from", solve)
    return cast("Task", _Told(answer, np.arange(n_frames)))
