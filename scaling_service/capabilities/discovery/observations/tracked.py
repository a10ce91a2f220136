"""A recording as the search sees it: tracked by the model."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.kinetics.inverse_dynamics import RatedMotion, differentiate_motion
from scaling_service.capabilities.motion.inverse_kinematics import solve_task
from scaling_service.capabilities.motion.task import Task
from scaling_service.core.arrays import Array
from scaling_service.model.body import BodyModel
from scaling_service.model.compile import list_parameter_values
from scaling_service.model.inertia import compile_mechanism
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.motion import Mechanism
from scaling_service.numerics.multibody.tree import Poses, place_tree_markers, pose_links
from scaling_service.numerics.wrench import compute_regressor_blocks

Role = Literal["fit", "held_out"]
ROLES: tuple[Role, ...] = ("fit", "held_out")
_FEWEST_BLOCKS = 4  # of a trial; chosen: a spread needs three, and one may be empty
_NULL = 1e-9  # of a column's own curvature, so that a frame may leave a direction of its pose open


@dataclass(frozen=True, eq=False, kw_only=True)
class InertialLoads:
    """A motion (model with mass, times, coordinates) under a gravity; the masses count for nothing here."""

    model: BodyModel
    times: Array
    q: Array
    gravity: Array  # (3,), m/s2
    cutoff_hz: float  # of the light filter of coordinates

    @cached_property
    def rated(self) -> RatedMotion:
        """The motion with its rates, filtered."""
        return differentiate_motion(self.model, self.times, self.q, cutoff_hz=self.cutoff_hz)

    @cached_property
    def root(self) -> Array:
        """The trunk's origin, (n, 3), m."""
        poses = pose_links(self.mechanism.tree, self.rated.rates.q, list_parameter_values(self.model))
        return np.ascontiguousarray(poses.origins[0].T)

    @cached_property
    def per_number(self) -> Array:
        """Wrench about the ground origin per inertial number of each segment, (n, 6, 10 n_segments)."""
        p = list_parameter_values(self.model)
        found = compute_regressor_blocks(self.mechanism, self.rated.rates, p, gravity=self.gravity)
        made = np.concatenate([block for _, block in found])
        made[:, 3:] += np.cross(self.root[:, :, None], made[:, :3], axis=1)
        return made

    @property
    def mechanism(self) -> Mechanism:
        """The model, compiled."""
        return _compiled(self.model)


_compiled = lru_cache(8)(compile_mechanism)  # chosen: bodies of as many recordings, if each has its own


@dataclass(frozen=True, eq=False, kw_only=True)
class MotionFit:
    """One trial, and the motion with which the model tracks it best."""

    trial: Trial  # not smoothed and not filled: what was measured
    role: Role
    task: Task  # the model as tracked, with the markers used
    q: Array  # (n_frames, n_coordinates), rad or m

    @classmethod
    def of(
        cls,
        model: BodyModel,
        trial: Trial,
        role: Role,
        near: MotionFit | None = None,
        astray: Mapping[str, float] = MappingProxyType({}),
    ) -> MotionFit:
        """Track a trial with a model, from where a model like this one did; TrialUnusable without markers.

        ``astray``: markers that wander by some factor more than others, which draw the pose the less.
        """
        weights = {m.name: astray.get(m.name, 1.0) ** -2 for m in model.markers if m.weight > 0.0}
        task = Task.of(model, trial, bounded=False, weights=weights)
        return cls(
            trial=trial,
            role=role,
            task=task,
            q=solve_task(task, trial.times, _carry_over_motion(task, near)).q,
        )

    @property
    def name(self) -> str:
        """The trial's."""
        return self.trial.name

    @property
    def markers(self) -> tuple[str, ...]:
        """Those tracked."""
        return self.task.markers

    @property
    def times(self) -> Array:
        """Of the frames, s."""
        return self.trial.times

    @property
    def step(self) -> float:
        """Time from frame to frame, s."""
        return float(np.median(np.diff(self.times)))

    def blocks(self, length_s: float) -> Iterator[slice]:
        """Blocks of time of about this length, at least four."""
        clock = self.trial.times
        count = max(_FEWEST_BLOCKS, int((clock[-1] - clock[0]) / length_s))
        edges = np.linspace(0, len(clock), count + 1).round().astype(int)
        return (slice(a, b) for a, b in pairwise(edges.tolist()) if b > a)

    def chunks(self, size: int) -> Iterator[slice]:
        """All frames, so many at once as fit in memory with their columns."""
        return (slice(start, min(start + size, len(self.q))) for start in range(0, len(self.q), size))

    @property
    def places(self) -> Array:
        """Of the model's markers, (n_frames, n_markers, 3), m, ground."""
        tree = self.task.tree
        return np.moveaxis(place_tree_markers(tree, self.poses), -1, 0)

    @cached_property
    def speeds(self) -> Array:
        """Of the model's markers, (n_frames, n_markers, 3), m/s, ground."""
        return np.asarray(np.gradient(self.places, self.times, axis=0))

    @property
    def poses(self) -> Poses:
        """Of all segments in all frames."""
        return pose_links(self.task.tree, np.ascontiguousarray(self.q.T), self.task.p)

    @cached_property
    def residuals(self) -> Array:
        """Measured minus model, (n_frames, n_markers, 3), m; NaN where not seen."""
        return np.asarray(self.task.measured - self.places)

    def inertial_loads(self, gravity: Array, cutoff_hz: float) -> InertialLoads:
        """What the motion needs of the ground under a gravity (3,), m/s2."""
        key = (gravity.tobytes(), cutoff_hz)
        if key not in self._inertial_loads:
            self._inertial_loads[key] = InertialLoads(
                model=self.task.model, times=self.trial.times, q=self.q, gravity=gravity, cutoff_hz=cutoff_hz
            )
        return self._inertial_loads[key]

    @cached_property
    def _inertial_loads(self) -> dict[tuple[bytes, float], InertialLoads]:
        return {}

    @cached_property
    def seen(self) -> NDArray[np.bool_]:
        """Where a marker was seen, (n_frames, n_markers)."""
        return np.asarray(np.isfinite(self.task.measured).all(axis=2))


def span(pose: Array) -> Array:
    """A basis of the pose's columns (n, q, r) in every frame, orthonormal but for directions without meaning.

    Those come out short, as far as rounding leaves anything of them.
    """
    bend = pose @ pose.transpose(0, 2, 1)
    size = np.sqrt(np.einsum("nqq->nq", bend))
    scale = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0)
    bend *= scale[:, :, None] * scale[:, None, :]
    bend += _NULL * np.eye(pose.shape[1])
    return np.asarray((np.linalg.inv(np.linalg.cholesky(bend)) * scale[:, None, :]) @ pose)


def _carry_over_motion(task: Task, near: MotionFit | None) -> Array | None:
    """The motion of the same trial as it was tracked before, by names of coordinates; new ones at zero."""
    if near is None:
        return None
    before = near.task.model.coordinate_names
    q = np.zeros((len(near.q), len(task.model.coordinates)))
    for k, name in enumerate(task.model.coordinate_names):
        if name in before:
            q[:, k] = near.q[:, before.index(name)]
    return q
