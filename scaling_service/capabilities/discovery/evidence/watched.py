"""A recording as the search sees it: followed by the model, with its floor of noise."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.discovery.evidence.demands import Demands
from scaling_service.capabilities.discovery.evidence.floor import marker_floor
from scaling_service.capabilities.discovery.laws.shaking import strays
from scaling_service.capabilities.motion.inverse_kinematics import Task, solve_task
from scaling_service.model.body import BodyModel
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.tree import forward, positions

Role = Literal["fit", "held_out"]


@dataclass(frozen=True, eq=False)
class Watched:
    """One trial, and the motion with which the model follows it best.

    Parameters
    ----------
    trial : Trial
        Not smoothed and not filled: what was measured.
    role : 'fit' or 'held_out'
    task : Task
        The model as followed, with the markers used.
    q : ndarray, shape (n_frames, n_coordinates), rad or m
    floor : ndarray, shape (n_markers,), m
        Standard deviation of the noise of one coordinate of each marker.
    """

    trial: Trial
    role: Role
    task: Task
    q: Array
    floor: Array

    @classmethod
    def of(cls, model: BodyModel, trial: Trial, role: Role, near: Watched | None = None) -> Watched:
        """Follow a trial with a model.

        Parameters
        ----------
        near : Watched, optional
            The same trial, followed with a model like this one.

        Raises
        ------
        TrialUnusable
            The trial shows no marker of the model.
        """
        plain = Task.of(model, trial, bounded=False)
        floor = marker_floor(plain.measured)
        task = Task.of(model, trial, bounded=False, weights=_weights(plain, floor))
        return cls(trial, role, task, solve_task(task, trial.times, _carried_over(task, near)).q, floor)

    @property
    def name(self) -> str:
        """The trial's."""
        return self.trial.name

    @property
    def markers(self) -> tuple[str, ...]:
        """Those followed."""
        return self.task.markers

    @cached_property
    def residuals(self) -> Array:
        """Measured minus model, (n_frames, n_markers, 3), m; NaN where not seen."""
        tree = self.task.tree
        poses = forward(tree, np.ascontiguousarray(self.q.T), self.task.p)
        return np.asarray(self.task.measured - np.moveaxis(positions(tree, poses), -1, 0))

    @cached_property
    def shaken(self) -> tuple[Watched, ...]:
        """The same recording with as much noise of the markers once more, anew in each of a few draws."""
        return tuple(replace(self, q=self.q + stray) for stray in strays(self))

    def demands(self, gravity: Array, cutoff_hz: float) -> Demands:
        """What the motion demands of the ground under a gravity (3,), m/s2."""
        key = (gravity.tobytes(), cutoff_hz)
        if key not in self._demands:
            self._demands[key] = Demands(self.task.model, self.trial.times, self.q, gravity, cutoff_hz)
        return self._demands[key]

    @cached_property
    def _demands(self) -> dict[tuple[bytes, float], Demands]:
        return {}

    @property
    def square(self) -> float:
        """Whitened sum of squares of all residuals."""
        return float(np.nansum((self.residuals / self.floor[:, None]) ** 2))

    @property
    def freedom(self) -> float:
        """How many numbers the residuals are, the pose's taken off."""
        return 3.0 * float(self.seen.sum()) - len(self.q) * float(self.task.free.sum())

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Where a marker was seen, (n_frames, n_markers)."""
        return np.asarray(np.isfinite(self.task.measured).all(axis=2))


def _weights(task: Task, floor: Array) -> dict[str, float]:
    """One over the variance of each marker, the median marker's being one."""
    typical = float(np.median(floor))
    return {name: (typical / sd) ** 2 for name, sd in zip(task.markers, floor, strict=True)}


def _carried_over(task: Task, near: Watched | None) -> Array | None:
    """The motion of the same trial as it was followed before, by names of coordinates; new ones at zero."""
    if near is None:
        return None
    before = near.task.model.coordinate_names
    q = np.zeros((len(near.q), len(task.model.coordinates)))
    for k, name in enumerate(task.model.coordinate_names):
        if name in before:
            q[:, k] = near.q[:, before.index(name)]
    return q
