"""A degree of freedom that the model locks: a turn or shift that may take any value in any frame.

It has no column of its own, for its course is not known. What is known is its direction among the markers:
residuals that keep to it more than to any other direction speak for it. Courses are looked at below the
frequencies of voluntary movement, where noise is weakest and movement is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
from scipy import special

from scaling_service.capabilities.discovery.evidence.score import stretches_of
from scaling_service.capabilities.discovery.evidence.spots import At, JointSpot, MarkerSpot
from scaling_service.capabilities.discovery.evidence.watched import Role, Watched
from scaling_service.capabilities.discovery.laws.at_once import each
from scaling_service.capabilities.discovery.laws.generators import Generators, span
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.candidates import FreeMotion
from scaling_service.capabilities.discovery.search.comparing import Unseen
from scaling_service.capabilities.discovery.search.judging import HIDDEN, Fitted
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.signals.filters import butterworth

_CUTOFF_HZ = 6.0  # chosen: holds human movement (Winter 2009, sec. 3.4.3)
_BLOCK = 64
_ROUNDS = 10
MOST = {"rotation": np.radians(20.0), "translation": 0.03}
"""RMS of a motion that a model could have locked by mistake (chosen: nobody would lock a joint of more)."""

_PLACES: tuple[tuple[At, Literal["rotation", "translation"]], ...] = (
    ("before", "rotation"),
    ("after", "rotation"),
    ("start", "translation"),
)


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """Three spots in one trial: what the residuals say of three directions in every frame.

    Parameters
    ----------
    slope : ndarray, shape (n, 3)
    curvature : ndarray, shape (n, 3, 3)
    square : ndarray, shape (n,)
        Of the residuals, smoothed like the slopes.
    freedom : ndarray, shape (n,)
    """

    slope: Array
    curvature: Array
    square: Array
    freedom: Array


@dataclass(frozen=True, slots=True, eq=False)
class Freedom:
    """A locked motion, and what it would take off each stretch.

    Parameters
    ----------
    motion : FreeMotion
    fitted : Fitted
    gains : ndarray, shape (n_stretches of the trials to fit,)
    unseen : Unseen
    """

    motion: FreeMotion
    fitted: Fitted
    gains: Array
    unseen: Unseen


def freedoms(scene: Scene, watched: Sequence[Watched], stretch_s: float) -> list[Freedom]:
    """Every joint that turns, with its best direction of turning and of shifting."""
    spots = [JointSpot(s.name, at, kind, k) for s in scene.jointed for at, kind in _PLACES for k in range(3)]
    joints = [(s, *place) for s in scene.jointed for place in _PLACES]
    courses = each(partial(courses_of, spots=spots), watched)
    shares = _shares(courses)
    found = []
    for k, (segment, at, kind) in enumerate(joints):
        if shares[k] > HIDDEN:
            by_trial = [each[0][k] for each in courses]
            made = _freedom(watched, by_trial, stretch_s)
            if made is not None and _spread(by_trial, np.array(made[0])) < MOST[kind]:
                axis, fitted, gains, share, p = made
                motion = FreeMotion(segment.name, at, kind, axis)
                found.append(Freedom(motion, fitted, gains, Unseen(share, p, folds=False)))
    return found


def _shares(courses: Sequence[tuple[list[Course], Array]]) -> Array:
    """Of every joint and kind: the largest share of a direction's square that no pose hides."""
    shown = [
        np.linalg.eigvalsh(np.sum([each[0][k].curvature.sum(axis=0) for each in courses], axis=0))[-1]
        for k in range(len(courses[0][0]))
    ]
    return np.asarray(np.array(shown) / np.maximum(np.sum([raw for _, raw in courses], axis=0), 1e-300))


def courses_of(item: Watched, spots: Sequence[JointSpot | MarkerSpot]) -> tuple[list[Course], Array]:
    """Of every three spots what the residuals of a trial say, and the squares of their columns."""
    n, groups = len(item.q), len(spots) // 3
    generators = Generators.of(item, spots)
    rows = 3 * len(item.markers)
    gaps, made = np.empty((n, rows)), np.empty((n, len(spots), rows))
    freedom, raw = np.empty(n), np.empty((n, len(spots)))

    def fill(start: int) -> None:
        block = slice(start, min(start + _BLOCK, n))
        gap, pose, columns = generators.at(item, block)
        basis = span(pose)
        raw[block] = np.square(columns).sum(axis=1)
        made[block] = (columns - basis @ (basis.transpose(0, 2, 1) @ columns)).transpose(0, 2, 1)
        gaps[block] = gap - np.einsum("nrq,nq->nr", basis, np.einsum("nrq,nr->nq", basis, gap))
        freedom[block] = 3.0 * item.seen[block].sum(axis=1) - np.square(basis).sum(axis=(1, 2))

    each(fill, range(0, n, _BLOCK))
    rate = 1.0 / float(np.median(np.diff(item.trial.times)))
    if rate > 2.5 * _CUTOFF_HZ:
        gaps = butterworth(gaps, rate_hz=rate, cutoff_hz=_CUTOFF_HZ, order=4).values
    square = np.square(gaps).sum(axis=1)
    slopes = (made @ gaps[:, :, None]).reshape(n, groups, 3)
    of_groups = made.reshape(n, groups, 3, rows)
    curvatures = of_groups @ of_groups.transpose(0, 1, 3, 2)
    found = [Course(slopes[:, g], curvatures[:, g], square, freedom) for g in range(groups)]
    return found, raw.sum(axis=0).reshape(groups, 3).max(axis=1)


def _freedom(
    watched: Sequence[Watched], courses: Sequence[Course], stretch_s: float
) -> tuple[tuple[float, float, float], Fitted, Array, float, float] | None:
    def parts(role: Role | None) -> list[Course]:
        return [
            cut(course, rows)
            for item, course in zip(watched, courses, strict=True)
            if role is None or item.role == role
            for rows in stretches_of(item, stretch_s)
        ]

    fit, held = parts("fit"), parts("held_out")
    axis = _axis(fit)
    if axis is None:
        return None
    gains, chance = _energies(fit, axis)
    crossed = [
        _log_ratio(new, other)
        for known, new in ((fit[0::2], fit[1::2]), (fit[1::2], fit[0::2]))
        if (other := _axis(known)) is not None and new
    ]
    p = above(np.concatenate(crossed)) if crossed else 1.0
    fitted = Fitted(np.zeros(0), np.zeros((0, 0)), float(gains.sum()), float(chance.sum()), p, 1.0)
    if held:
        held_gain, held_chance = _energies(held, axis)
        share = float((held_gain - held_chance).sum() / sum(c.square.sum() for c in held))
        held_p = above(_log_ratio(held, axis))
    else:
        share, held_p = float((gains - chance).sum() / sum(c.square.sum() for c in fit)), p
    x, y, z = (float(v) for v in axis)
    return (x, y, z), fitted, gains, share, held_p


def _spread(courses: Sequence[Course], axis: Array) -> float:
    """RMS of the course along an axis, rad or m."""
    slope = np.concatenate([c.slope for c in courses]) @ axis
    bend = np.einsum("k,nkl,l->n", axis, np.concatenate([c.curvature for c in courses]), axis)
    known = bend > HIDDEN * bend.max()
    return float(np.sqrt(np.mean((slope[known] / bend[known]) ** 2))) if known.any() else 0.0


def course_rms(watched: Sequence[Watched], name: str) -> float:
    """RMS of a coordinate over the trials that fitted it, rad or m; not a number where none has it.

    Its square is freed of what noise of the markers adds to it on average.
    """
    courses = _fitted_courses(watched, name)
    squares = [course**2 - variance for _, course, variance in courses]
    return float(np.sqrt(max(np.concatenate(squares).mean(), 0.0))) if squares else float("nan")


def course_error(watched: Sequence[Watched], name: str, stretch_s: float) -> float:
    """Standard deviation of :func:`course_rms` by noise of the markers.

    The variance of the mean of N independent numbers (c + e)2, with e of variance v, is (4 c2 v + 2 v2) / N.
    """
    rms, courses = course_rms(watched, name), _fitted_courses(watched, name)
    if not courses or not rms > 0.0:
        return float("nan")
    variance = float(np.concatenate([v for _, _, v in courses]).mean())
    count = sum(len(item.q) / _memory(item, stretch_s) for item, _, _ in courses)
    return float(np.sqrt((4.0 * rms**2 * variance + 2.0 * variance**2) / count) / (2.0 * rms))


def _memory(item: Watched, longest_s: float) -> float:
    """How many frames one independent number of the noise stands for: 1 + 2 x its autocorrelations."""
    count = np.maximum(item.seen.sum(axis=0), 1)[:, None]
    mean = np.nan_to_num(item.residuals).sum(axis=0) / count
    left = np.nan_to_num(item.residuals - mean).reshape(len(item.q), -1)
    lags = max(1, min(int(longest_s * item.trial.rate_hz), len(left) - 1))
    own = max(float(np.square(left).sum()), 1e-300)
    alike = [float((left[lag:] * left[:-lag]).sum()) / own for lag in range(1, lags + 1)]
    first_lost = next((k for k, r in enumerate(alike) if r <= 0.0), len(alike))
    return 1.0 + 2.0 * sum(alike[:first_lost])


def _fitted_courses(watched: Sequence[Watched], name: str) -> list[tuple[Watched, Array, Array]]:
    """The trials that fitted a coordinate, its course in each and the variance of that, rad or m."""
    found = []
    for item in watched:
        names = item.task.model.coordinate_names
        if item.role == "fit" and name in names:
            k = names.index(name)
            found.append((item, item.q[:, k], _variance(item, k)))
    return found


def _variance(item: Watched, coordinate: int) -> Array:
    """Of a coordinate in every frame by what the markers stray, (n,), rad2 or m2."""
    generators = Generators.of(item, ())
    at = int(np.flatnonzero(np.flatnonzero(item.task.free) == coordinate)[0])
    found, square, freedom = np.empty(len(item.q)), 0.0, 0.0
    for start in range(0, len(item.q), _BLOCK):
        rows = slice(start, min(start + _BLOCK, len(item.q)))
        gap, pose, _ = generators.at(item, rows)
        bend = pose.transpose(0, 2, 1) @ pose
        found[rows] = np.linalg.pinv(bend, rcond=HIDDEN**2, hermitian=True)[:, at, at]
        square += float((gap**2).sum())
        freedom += 3.0 * float(item.seen[rows].sum()) - gap.shape[0] * pose.shape[2]
    return found * square / max(freedom, 1.0)


def cut(course: Course, rows: slice) -> Course:
    """A stretch of it."""
    return Course(course.slope[rows], course.curvature[rows], course.square[rows], course.freedom[rows])


def _axis(courses: Sequence[Course]) -> Array | None:
    """The direction that the residuals keep to most, (3,)."""
    if not courses:
        return None
    slope = np.concatenate([c.slope for c in courses])
    curvature = np.concatenate([c.curvature for c in courses])
    total = curvature.sum(axis=0)
    value, vector = np.linalg.eigh(total)
    known = value > HIDDEN * value[-1]
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


def _along(course: Course, axis: Array) -> Array:
    """Square of the residuals along the direction, in every frame."""
    bend = np.einsum("k,nkl,l->n", axis, course.curvature, axis)
    return np.asarray(np.divide((course.slope @ axis) ** 2, bend, out=np.zeros(len(bend)), where=bend > 0))


def _energies(courses: Sequence[Course], axis: Array) -> tuple[Array, Array]:
    """Of each stretch what the direction takes off, and what any other direction would."""
    own = np.array([_along(c, axis).sum() for c in courses])
    others = np.array([c.square.sum() for c in courses]) - own
    freedom = np.array([c.freedom.sum() for c in courses])
    frames = np.array([len(c.square) for c in courses])
    return own, others / np.maximum(freedom - frames, 1.0) * frames


def _log_ratio(courses: Sequence[Course], axis: Array) -> Array:
    own, chance = _energies(courses, axis)
    return np.asarray(np.log(np.maximum(own, 1e-300) / np.maximum(chance, 1e-300)))


def above(values: Array) -> float:
    """How likely chance alone brings the mean so far above zero."""
    if len(values) < 3:
        return 1.0
    spread = float(values.std(ddof=1))
    if spread == 0.0:
        return 1.0
    return float(special.stdtr(len(values) - 1, -values.mean() / (spread / np.sqrt(len(values)))))
