"""A recording as the search sees it: tracked by the model, with the noise floor of its markers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from scaling_service.capabilities.discovery.observations.inertial_loads import InertialLoads
from scaling_service.capabilities.motion.inverse_kinematics import solve_task
from scaling_service.capabilities.motion.task import Task
from scaling_service.model.body import BodyModel
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.tree import (
    Poses,
    compute_jacobian,
    order_by_frame,
    place_tree_markers,
    pose_links,
)

Role = Literal["fit", "held_out"]
ROLES: tuple[Role, ...] = ("fit", "held_out")
_FEWEST_BLOCKS = 4  # of a trial; chosen: a spread needs three, and one may be empty
LEAST_M = 2e-4
"""m; the least noise of a moving marker that is believed (chosen: cameras tell moving markers to some tenths
of a millimetre). Recordings that show less were smoothed before."""

_NORMAL = 1.4826
"""Standard deviation over median absolute deviation of a normal distribution."""

_UNLIKE = 2.0
"""How many times more or less noise than the median a marker may have (chosen: in real recordings 0.9 to 1.3
times). What shows less was smoothed, what shows more is no noise of the cameras."""

_STRIDES = (1, 2, 3, 5, 8, 12)  # frames (chosen: they tell a memory of 30 ms at 100 Hz from one of 100 ms)
_MEMORIES = np.linspace(0.0, 0.92, 47)[:, None]
"""Correlations from frame to frame that are distinguished: no noise is told to last longer than the longest
stride (0.92 ** 12 = 1 / e)."""

_SHARES = np.linspace(0.0, 1.0, 21)
"""Shares of the noise's variance that are distinguished to last."""

_WHITE = 0.2
"""Share times memory below which noise counts as white (chosen: the error of a walk of a hundred frames and
fifteen markers)."""

_ENOUGH = 30
"""Third differences from which a spread is estimated (chosen: its own error is then 15 %)."""

DRAWS = 8  # of noise; chosen: 8 trials of thousands of frames tell a spread to some 5 %
_CHUNK = 64  # frames at once
_NULL = 1e-9  # of a column's own curvature, so that a frame may leave a direction of its pose open
_RIDGE = 1e-9  # of a frame's largest curvature, so that what it does not determine stays still


class LastingNoise(NamedTuple):
    """Noise that is white but for a share of its variance: that is first-order autoregressive."""

    memory: float  # correlation from frame to frame of what lasts
    share: float


WHITE = LastingNoise(0.0, 0.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class TrackedTrial:
    """One trial, and the motion with which the model tracks it best."""

    trial: Trial  # not smoothed and not filled: what was measured
    role: Role
    task: Task  # the model as tracked, with the markers used
    q: Array  # (n_frames, n_coordinates), rad or m
    floor: Array  # (n_markers,), m: standard deviation of the noise of one coordinate of each marker

    @classmethod
    def of(
        cls,
        model: BodyModel,
        trial: Trial,
        role: Role,
        near: TrackedTrial | None = None,
        astray: Mapping[str, float] = MappingProxyType({}),
    ) -> TrackedTrial:
        """Track a trial with a model, from where a model like this one did; TrialUnusable without markers.

        ``astray``: markers that wander by some factor more than others, which draw the pose the less.
        """
        plain = Task.of(model, trial, bounded=False)
        floor = estimate_marker_noise(plain.measured)
        task = Task.of(model, trial, bounded=False, weights=_weight_markers(plain, floor, astray))
        return cls(
            trial=trial,
            role=role,
            task=task,
            q=solve_task(task, trial.times, _carry_over_motion(task, near)).q,
            floor=floor,
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

    @property
    def poses(self) -> Poses:
        """Of all segments in all frames."""
        return pose_links(self.task.tree, np.ascontiguousarray(self.q.T), self.task.p)

    @cached_property
    def residuals(self) -> Array:
        """Measured minus model, (n_frames, n_markers, 3), m; NaN where not seen."""
        return np.asarray(self.task.measured - self.places)

    def pose_columns(self, rows: slice) -> Array:
        """What the coordinates do to the markers in some frames, by floors, (n, n_free, 3 n_markers)."""
        tree, free = self.task.tree, np.flatnonzero(self.task.free)
        poses = pose_links(tree, np.ascontiguousarray(self.q[rows].T), self.task.p)
        rates = compute_jacobian(tree, poses, place_tree_markers(tree, poses), free)
        white = order_by_frame(rates)
        white *= (np.repeat(self.seen[rows], 3, axis=1) / np.repeat(self.floor, 3))[:, None]
        return white

    @cached_property
    def lasting(self) -> LastingNoise:
        """How much of the noise lasts, and how long; alike everywhere.

        The longer noise lasts, the more residuals differ over some frames than over one: third differences
        over several strides are compared with those over one frame, at the median marker. Most strides
        decide: what moves slowly and is no noise shows in the long ones. None lasts where recordings were
        smoothed until no noise shows.
        """
        if not self.shows_noise:
            return WHITE
        spread = np.array([[_spread(steps) for steps in self._strides(k)] for k in _STRIDES])
        spread[spread == 0.0] = np.nan
        longer = 2.0 * np.log(spread[1:] / spread[0])
        known = np.isfinite(longer).any(axis=1)  # none where recordings are too short to tell
        powers = np.array(_STRIDES[1:])[known, None, None]
        expected = np.log(_compute_growth(_MEMORIES**powers, _SHARES) / _compute_growth(_MEMORIES, _SHARES))
        off = np.abs(np.nanmedian(longer[known], axis=1)[:, None, None] - expected).sum(axis=0)
        memory, share = np.unravel_index(off.argmin(), off.shape)
        found = LastingNoise(float(_MEMORIES[memory, 0]), float(_SHARES[share]))
        return found if found.share * found.memory >= _WHITE else WHITE

    @property
    def shows_noise(self) -> bool:
        """Whether the cameras' noise can be estimated, and was not smoothed away."""
        return float(np.median(self.floor)) > LEAST_M

    def _strides(self, stride: int) -> Iterator[Array]:
        """Third differences of each marker's residuals over so many frames, (n - 3 stride, 3)."""
        for path in np.moveaxis(self.residuals, 1, 0):
            third = path[3 * stride :] - path[: -3 * stride]
            yield third - 3.0 * (path[2 * stride : -stride] - path[stride : -2 * stride])

    @property
    def noise(self) -> Array:
        """Standard deviation of one coordinate's noise, with what lasts of it, (n_markers,), m."""
        return np.asarray(self.floor * np.sqrt(_compute_growth(*WHITE) / _compute_growth(*self.lasting)))

    @cached_property
    def noise_replicates(self) -> tuple[TrackedTrial, ...]:
        """The same recording with as much noise of the markers once more, anew in each of a few draws."""
        return tuple(replace(self, q=self.q + stray) for stray in _draw_strays(self))

    def give_way(self, moved: Array) -> Array:
        """How the pose of each frame follows markers that move, (draws, n, n_coordinates), rad or m.

        As far as it does when it is solved for: to first order, without the limits of joints.

        ``moved``: (draws, n, 3 n_markers), by floors.
        """
        free = np.flatnonzero(self.task.free)
        white = self.pose_columns(slice(0, len(self.q)))
        bend = white @ white.transpose(0, 2, 1)
        size = np.einsum("nqq->nq", bend).max(axis=1)
        pull = white @ np.moveaxis(moved, 0, -1)
        turned = np.linalg.solve(bend + (_RIDGE * size)[:, None, None] * np.eye(len(free)), pull)
        found = np.zeros((len(moved), *self.q.shape))
        found[:, :, free] = np.moveaxis(turned, -1, 0)
        return found

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

    @property
    def square(self) -> float:
        """Whitened sum of squares of all residuals."""
        return float(np.nansum((self.residuals / self.floor[:, None]) ** 2))

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


def without_span(residuals: Array, basis: Array) -> Array:
    """Residuals (n, r) without what a basis (n, q, r) takes of them."""
    taken = basis @ residuals[:, :, None]
    return residuals - (basis.transpose(0, 2, 1) @ taken)[:, :, 0]


def estimate_marker_noise(measured: Array) -> Array:
    """Standard deviation (m) of one coordinate's noise for each marker, (n_markers,).

    A body moves smoothly from frame to frame, a camera's noise does not: third differences of a marker's path
    keep the noise and next to nothing of the movement. A marker seen too briefly gets the others' median.
    ``measured``: not smoothed, (n_frames, n_markers, 3), m; NaN where not seen.
    """
    steps = np.diff(measured, n=3, axis=0)
    spread = np.array([_spread(steps[:, m]) for m in range(measured.shape[1])])
    typical = float(np.nanmedian(spread)) if np.isfinite(spread).any() else LEAST_M
    known = np.where(np.isfinite(spread), spread, typical)
    return np.asarray(np.maximum(np.clip(known, typical / _UNLIKE, typical * _UNLIKE), LEAST_M))


def _compute_growth(memory: Any, share: Any) -> Any:
    """Variance of third differences of noise of unit variance, of which a share lasts."""
    return 20.0 + share * (-30.0 * memory + 12.0 * memory**2 - 2.0 * memory**3)


def _spread(steps: Array) -> float:
    known = steps[np.isfinite(steps).all(axis=1)]
    if len(known) < _ENOUGH:
        return float("nan")
    return float(_NORMAL * np.median(np.abs(known)) / np.sqrt(_compute_growth(*WHITE)))


def _weight_markers(task: Task, floor: Array, astray: Mapping[str, float]) -> dict[str, float]:
    """One over the variance of each marker, the median marker's being one."""
    typical = float(np.median(floor))
    pairs = zip(task.markers, floor.tolist(), strict=True)
    return {name: (typical / (astray.get(name, 1.0) * sd)) ** 2 for name, sd in pairs}


def _carry_over_motion(task: Task, near: TrackedTrial | None) -> Array | None:
    """The motion of the same trial as it was tracked before, by names of coordinates; new ones at zero."""
    if near is None:
        return None
    before = near.task.model.coordinate_names
    q = np.zeros((len(near.q), len(task.model.coordinates)))
    for k, name in enumerate(task.model.coordinate_names):
        if name in before:
            q[:, k] = near.q[:, before.index(name)]
    return q


def _draw_noise(lasting: LastingNoise, shape: tuple[int, ...]) -> Array:
    """Noise of unit variance, (draws, n, numbers)."""
    stream, memory = np.random.default_rng(0), lasting.memory
    white = stream.normal(size=shape)
    if not lasting.share:
        return white
    slow = stream.normal(size=shape)
    slow[:, 1:] *= np.sqrt(1.0 - memory**2)
    slow = scipy.signal.lfilter([1.0], [1.0, -memory], slow, axis=1)
    return np.asarray(np.sqrt(1.0 - lasting.share) * white + np.sqrt(lasting.share) * slow)


def _draw_strays(item: TrackedTrial) -> Array:
    """How far noise takes the motion from where it is, (DRAWS, n, n_coordinates), rad or m.

    Noise of each marker's own size that lasts as the trial's does.
    """
    noise = _draw_noise(item.lasting, (DRAWS, len(item.q), 3 * len(item.markers)))
    noise *= np.repeat(item.noise / item.floor, 3)
    return item.give_way(noise)
