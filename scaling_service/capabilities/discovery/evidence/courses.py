"""Motions and markers that may take any course: a turn or shift of any value in any frame.

Such a motion has no column of its own, for its course is not known. What is known is its direction among the
markers: residuals that keep to it more than to any other direction speak for it. Courses are looked at below
the frequencies of voluntary movement, where noise is weakest and movement is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scaling_service.capabilities.discovery.evidence.settings import IDENTIFIABLE
from scaling_service.capabilities.discovery.laws.spots import Generators, JointSpot, MarkerSpot
from scaling_service.capabilities.discovery.observations.tracked import MOVEMENT_HZ, TrackedTrial
from scaling_service.core.threads import map_parallel
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.signals.filters import filter_butterworth

_CHUNK = 64
_RATE = 4.0  # frames looked at per period of the filter; chosen: products of what passes it need two
_ROUNDS = 10


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FreeCourse:
    """Three spots in one trial: what the residuals say of three directions in every frame."""

    slope: Array  # (n, 3)
    curvature: Array  # (n, 3, 3)
    square: Array  # (n,): of the residuals, smoothed like the slopes
    freedom: Array  # (n,)
    every: int = 1  # how many frames each of them stands for

    def cut(self, rows: slice) -> FreeCourse:
        """A block of it."""
        part = slice(-(-rows.start // self.every), -(-rows.stop // self.every))
        return FreeCourse(
            slope=self.slope[part],
            curvature=self.curvature[part],
            square=self.square[part],
            freedom=self.freedom[part],
            every=self.every,
        )

    @property
    def frames(self) -> int:
        """How many it stands for."""
        return self.every * len(self.square)


def solve_courses(
    item: TrackedTrial, spots: Sequence[JointSpot | MarkerSpot]
) -> tuple[list[FreeCourse], Array]:
    """Of every three spots what the residuals of a trial say, and the squares of their columns."""
    groups, rate = len(spots) // 3, 1.0 / item.step
    generators = Generators.of(item, spots)
    gaps, freedom = item.pose_free
    every = max(1, int(rate / (_RATE * MOVEMENT_HZ)))
    if rate > 2.5 * MOVEMENT_HZ:
        gaps = filter_butterworth(gaps, rate_hz=rate, cutoff_hz=MOVEMENT_HZ, order=4).values
    gaps, freedom = gaps[::every], every * freedom[::every]
    square = every * np.square(gaps).sum(axis=1)
    slopes, curvatures = np.empty((len(gaps), groups, 3)), np.empty((len(gaps), groups, 3, 3))

    def fill(start: int) -> Array:
        rows = slice(start, start + _CHUNK)
        free = generators.free_of_pose(item, slice(every * start, every * (start + _CHUNK), every))
        slopes[rows] = every * (free.columns @ gaps[rows, :, None]).reshape(-1, groups, 3)
        of_groups = free.columns.reshape(len(free.columns), groups, 3, -1)
        curvatures[rows] = every * (of_groups @ of_groups.transpose(0, 1, 3, 2))
        squares = np.square(free.columns).sum(axis=(0, 2)) + np.square(free.hidden).sum(axis=(0, 2))
        return np.asarray(every * squares)

    raw = np.sum(map_parallel(fill, range(0, len(gaps), _CHUNK)), axis=0)
    found = [
        FreeCourse(
            slope=slopes[:, g], curvature=curvatures[:, g], square=square, freedom=freedom, every=every
        )
        for g in range(groups)
    ]
    return found, raw.reshape(groups, 3).max(axis=1)


def find_common_axis(courses: Sequence[FreeCourse]) -> Array | None:
    """The direction that the residuals keep to most, (3,)."""
    if not courses:
        return None
    slope = np.concatenate([c.slope for c in courses])
    curvature = np.concatenate([c.curvature for c in courses])
    total = curvature.sum(axis=0)
    value, vector = np.linalg.eigh(total)
    known = value > IDENTIFIABLE * value[-1]
    half = vector[:, known] / np.sqrt(value[known])
    axis = half @ np.linalg.eigh(half.T @ slope.T @ slope @ half)[1][:, -1]
    for _ in range(_ROUNDS):
        axis = axis / np.linalg.norm(axis)
        bend = np.einsum("k,nkl,l->n", axis, curvature, axis)
        course = np.divide(slope @ axis, bend, out=np.zeros(len(bend)), where=bend > 0)
        matrix = np.einsum("n,nkl->kl", course**2, curvature)
        axis = half @ np.linalg.solve(half.T @ matrix @ half, half.T @ (course @ slope))
    largest = axis[np.argmax(np.abs(axis))]
    return np.asarray(axis / np.linalg.norm(axis) * np.sign(largest))


def compute_energies(courses: Sequence[FreeCourse], axis: Array) -> tuple[Array, Array]:
    """Of each block what the direction takes off, and what any other direction would."""
    own = np.array([_square_along(c, axis).sum() for c in courses])
    others = np.array([c.square.sum() for c in courses]) - own
    freedom = np.array([c.freedom.sum() for c in courses])
    frames = np.array([c.frames for c in courses])
    return own, others / np.maximum(freedom - frames, 1.0) * frames


def _square_along(course: FreeCourse, axis: Array) -> Array:
    """Square of the residuals along the direction, in every frame."""
    bend = np.einsum("k,nkl,l->n", axis, course.curvature, axis)
    return np.asarray(np.divide((course.slope @ axis) ** 2, bend, out=np.zeros(len(bend)), where=bend > 0))


def spread_along(courses: Sequence[FreeCourse], axis: Array) -> float:
    """RMS of the course along an axis, rad or m."""
    slope = np.concatenate([c.slope for c in courses]) @ axis
    bend = np.einsum("k,nkl,l->n", axis, np.concatenate([c.curvature for c in courses]), axis)
    known = bend > IDENTIFIABLE * bend.max()
    return float(np.sqrt(np.mean((slope[known] / bend[known]) ** 2))) if known.any() else 0.0


def compute_course_rms(tracked: Sequence[TrackedTrial], name: str) -> float:
    """RMS of a coordinate over the trials that fitted it, rad or m; not a number where none has it.

    Its square is freed of what noise of the markers adds to it on average.
    """
    courses = _list_fitted_courses(tracked, name)
    squares = [course**2 - variance for _, course, variance in courses]
    return float(np.sqrt(max(np.concatenate(squares).mean(), 0.0))) if squares else float("nan")


def compute_course_error(tracked: Sequence[TrackedTrial], name: str, block_s: float) -> float:
    """Standard deviation of :func:`compute_course_rms` by noise of the markers.

    The variance of the mean of N independent numbers (c + e)2, with e of variance v, is (4 c2 v + 2 v2) / N.
    """
    rms, courses = compute_course_rms(tracked, name), _list_fitted_courses(tracked, name)
    if not courses or not rms > 0.0:
        return float("nan")
    variance = float(np.concatenate([v for _, _, v in courses]).mean())
    count = sum(len(item.q) / _estimate_memory(item, block_s) for item, _, _ in courses)
    return float(np.sqrt((4.0 * rms**2 * variance + 2.0 * variance**2) / count) / (2.0 * rms))


def _estimate_memory(item: TrackedTrial, longest_s: float) -> float:
    """How many frames one independent number of the noise stands for: 1 + 2 x its autocorrelations."""
    count = np.maximum(item.seen.sum(axis=0), 1)[:, None]
    mean = np.nan_to_num(item.residuals).sum(axis=0) / count
    left = np.nan_to_num(item.residuals - mean).reshape(len(item.q), -1)
    lags = max(1, min(int(longest_s * item.trial.rate_hz), len(left) - 1))
    own = max(float(np.square(left).sum()), 1e-300)
    alike = [float((left[lag:] * left[:-lag]).sum()) / own for lag in range(1, lags + 1)]
    first_lost = next((k for k, r in enumerate(alike) if r <= 0.0), len(alike))
    return 1.0 + 2.0 * sum(alike[:first_lost])


def _list_fitted_courses(
    tracked: Sequence[TrackedTrial], name: str
) -> list[tuple[TrackedTrial, Array, Array]]:
    """The trials that fitted a coordinate, its course in each and the variance of that, rad or m."""
    found = []
    for item in tracked:
        names = item.task.model.coordinate_names
        if item.role == "fit" and name in names:
            k = names.index(name)
            found.append((item, item.q[:, k], _compute_variance(item, k)))
    return found


def _compute_variance(item: TrackedTrial, coordinate: int) -> Array:
    """Of a coordinate in every frame by what the markers stray, (n,), rad2 or m2."""
    generators = Generators.of(item, ())
    at = int(np.flatnonzero(np.flatnonzero(item.task.free) == coordinate)[0])

    def of(rows: slice) -> tuple[Array, float, float]:
        gap, pose, _ = generators.at(item, rows)
        inverse = np.linalg.pinv(pose @ pose.transpose(0, 2, 1), rcond=IDENTIFIABLE**2, hermitian=True)
        freedom = 3.0 * float(item.seen[rows].sum()) - gap.shape[0] * pose.shape[1]
        return np.asarray(inverse[:, at, at], dtype=float), float((gap**2).sum()), float(freedom)

    found, square, freedom = zip(*map_parallel(of, item.chunks(_CHUNK)), strict=True)
    return np.asarray(np.concatenate(found) * sum(square) / max(sum(freedom), 1.0))
