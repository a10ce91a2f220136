"""What solved coordinates leave unexplained and undetermined: the motion that they are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.motion.task import Task
from scaling_service.capabilities.motion.uncertainty import find_determined
from scaling_service.core.arrays import Array
from scaling_service.model.results import Motion
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.closure import CLOSED
from scaling_service.numerics.multibody.tree import pose_markers

_FRAMES = 1024  # placed together; a long recording at once would take gigabytes


def make_motion(task: Task, trial: Trial, q: Array, steps: NDArray[np.intp]) -> Motion:
    """The motion that coordinates are, with what they leave unexplained and what is not determined."""
    known = find_determined(task, q)
    if task.closure is not None:
        known &= np.abs(task.closure.evaluate(q, task.p)).max(axis=1, keepdims=True) <= CLOSED
    else:
        known &= task.ranges.shown
    residual = np.empty(task.measured.shape)
    for rows in (slice(start, start + _FRAMES) for start in range(0, len(residual), _FRAMES)):
        residual[rows] = task.measured[rows] - pose_markers(task.tree, q[rows], task.p)
    sometimes = np.asarray(known.any(axis=0))
    names = task.model.coordinate_names
    # Tips of directions say by how much a rotation is missed; they are no markers.
    points = np.array([not task.model.marker(name).is_direction for name in task.markers], dtype=bool)
    # How far each measured rotation is from the model's, (n_frames,), rad; see `motion/mounting.py`.
    turns: list[tuple[str, Array]] = []
    own = [name for name in task.markers if task.model.marker(name).is_direction]
    for label in dict.fromkeys(name.rpartition("@")[0] for name in own):
        tips = [k for k, name in enumerate(task.markers) if name in own and name.rpartition("@")[0] == label]
        arm = float(np.linalg.norm(task.model.marker(task.markers[tips[0]]).nominal))
        gap = np.linalg.norm(residual[:, tips].reshape(len(residual), -1), axis=1)
        turns.append((label, 2.0 * np.arcsin(np.minimum(gap / (np.sqrt(8.0) * arm), 1.0))))
    return Motion(
        trial=trial.name,
        times=trial.times,
        coordinates=names,
        q=np.where(known | ~sometimes, q, np.nan),
        markers=tuple(name for name, point in zip(task.markers, points, strict=True) if point),
        residuals=residual[:, points],
        turns=dict(turns),
        estimated=tuple(
            n for n, known, free in zip(names, sometimes, task.free, strict=True) if known and free
        ),
        iterations=int(steps.max(initial=0)),
    )
