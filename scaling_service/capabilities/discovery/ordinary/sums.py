"""One table of sums of each recording: all columns against what the markers leave, the pose taken out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.discovery.laws.profiles import evaluate_profiles
from scaling_service.capabilities.discovery.laws.spots import Generators
from scaling_service.capabilities.discovery.observations.tracked import MotionFit, span
from scaling_service.capabilities.discovery.ordinary.body import Cluster
from scaling_service.capabilities.discovery.ordinary.columns import Base
from scaling_service.capabilities.discovery.ordinary.levels import weigh_marker
from scaling_service.core.arrays import Array
from scaling_service.model.people import read_people

_LAG_S = 0.05  # after which noise of cameras is gone and skin is not (chosen)
NONE_ASTRAY: Mapping[str, float] = MappingProxyType({})
FRAMES = 45  # of a recording that are looked at (chosen: skin is seen anew some five times a second)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Sums:
    """Of one recording."""

    trial: str
    products: Array  # (n, n): columns times columns
    scores: Array  # (n,): columns times residuals
    square: float  # of the residuals


def place_in_segments(item: MotionFit, rows: NDArray[np.intp] | slice) -> Array:
    """Axes of every marker's segment in some frames, as rows, (n, m, 3, 3)."""
    return np.moveaxis(item.poses.axes[item.task.tree.marker_link][..., rows], -1, 0)


def turn_vectors(axes: Array, values: Array) -> Array:
    """Numbers of all markers (n, 3 m) or (n, k, 3 m) in the axes of their segments."""
    shaped = values.reshape(*values.shape[:-1], -1, 3)[..., None]
    turned = np.matmul(axes if values.ndim == 2 else axes[:, None], shaped)
    return np.asarray(turned[..., 0].reshape(values.shape))


def weigh_frames(item: MotionFit, step_s: float) -> float:
    """How much of each frame is new, at times so far apart (s).

    Skin is seen anew after twice its time of correlation, and noise of cameras in every frame. Both are
    there: how much of what is left lasts tells their shares, at the median marker.
    """
    loose_s = read_people().loose_s
    lag = max(1, round(_LAG_S / item.step))
    moved = item.residuals[:, item.seen.any(axis=0)]
    if len(moved) < 4 * lag or not moved.shape[1]:
        return min(1.0, step_s / (2.0 * loose_s))
    moved = moved - np.nanmean(moved, axis=0)
    alike = np.nanmean((moved[lag:] * moved[:-lag]).sum(axis=2), axis=0)
    square = np.maximum(np.nanmean(np.square(moved).sum(axis=2), axis=0), np.finfo(float).tiny)
    share = float(np.nanmedian(alike / square)) * math.exp(lag * item.step / loose_s)
    lasting = loose_s * float(np.clip(np.nan_to_num(share, nan=1.0), 0.0, 1.0))
    return min(1.0, step_s / max(2.0 * lasting, item.step))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Look:
    """Some frames of a recording, every marker in the axes of its segment; m and rad."""

    item: MotionFit
    rows: NDArray[np.intp]
    gap: Array  # (n, 3 m): measured minus model
    pose: Array  # (n, q, 3 m)
    columns: Array  # (n, n_spots, 3 m)
    seen: NDArray[np.bool_]  # (n, m)
    values: Array  # (n_profiles, n)
    weight: float  # of a frame
    clusters: Sequence[Cluster]

    @classmethod
    def of(cls, item: MotionFit, base: Base, generators: Generators, clusters: Sequence[Cluster]) -> Look:
        """Frames at equal times."""
        rows = np.unique(np.linspace(0, len(item.q) - 1, min(FRAMES, len(item.q))).round().astype(np.intp))
        gap, pose, columns = generators.at(item, rows)
        axes = place_in_segments(item, rows)
        return cls(
            item=item,
            rows=rows,
            gap=turn_vectors(axes, gap),
            pose=turn_vectors(axes, pose),
            columns=turn_vectors(axes, columns),
            seen=item.seen[rows],
            values=evaluate_profiles(base.profiles, item)[:, rows],
            weight=weigh_frames(item, item.step * len(item.q) / len(rows)),
            clusters=clusters,
        )

    def make_covariance(
        self, levels: Mapping[str, float], strays: Mapping[str, float] = NONE_ASTRAY
    ) -> Array:
        """How all markers wander, (3 m, 3 m), m2; ``strays``: by which some do more than their part does."""
        wide = self.gap.shape[1]
        found = np.zeros((wide, wide))
        for cluster in self.clusters:
            at = cluster.numbers
            found[np.ix_(at, at)] = levels.get(cluster.part, 1.0) ** 2 * cluster.covariance
        own = np.repeat([strays.get(m, 1.0) for m in self.item.markers], 3)
        return found * np.outer(own, own)

    def whiten(self, levels: Mapping[str, float], strays: Mapping[str, float] = NONE_ASTRAY) -> White:
        """By how markers wander at some levels, and freed of the pose."""
        covariance = self.make_covariance(levels, strays)
        gap, pose, columns = (np.zeros_like(x) for x in (self.gap, self.pose, self.columns))
        for at, here in list_patterns(self.seen):
            values, vectors = np.linalg.eigh(covariance[np.ix_(at, at)])
            white = (vectors / np.sqrt(values)) @ vectors.T  # symmetric: each number stays its marker's
            for source, target in ((self.gap, gap), (self.pose, pose), (self.columns, columns)):
                target[here[:, None], ..., at] = np.moveaxis(source[here][..., at] @ white, -1, 1)
        basis = span(pose)
        gap = gap - np.matmul(np.matmul(basis, gap[:, :, None]).transpose(0, 2, 1), basis)[:, 0]
        columns = columns - np.matmul(np.matmul(columns, basis.transpose(0, 2, 1)), basis)
        return White(self, gap, columns, basis)


def list_patterns(seen: NDArray[np.bool_]) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Which numbers of which frames are there: frames with the same markers together."""
    patterns, which = np.unique(seen, axis=0, return_inverse=True)
    pairs = [
        (np.flatnonzero(np.repeat(pattern, 3)), np.flatnonzero(which.ravel() == k))
        for k, pattern in enumerate(patterns)
    ]
    return [(at, here) for at, here in pairs if len(at)]


@dataclass(frozen=True, eq=False)
class White:
    """Residuals (n, 3 m) and spots (n, n_spots, 3 m) in deviations of what wanders, freed of the pose."""

    look: Look
    gap: Array
    columns: Array
    basis: Array  # (n, q, 3 m): of what the pose takes

    def add_up(self, base: Base) -> Sums:
        """Made of sums over spots frame by frame, spread over what they follow."""
        of_spot, of_profile = base.index()
        weight, values = self.look.weight, self.look.values
        products = np.matmul(self.columns, self.columns.transpose(0, 2, 1))
        scores = np.matmul(self.columns, self.gap[:, :, None])[:, :, 0]
        found = np.empty((len(base), len(base)))
        groups = [np.flatnonzero(of_profile == k) for k in range(len(values))]
        for a, at in enumerate(groups):
            for b, to in enumerate(groups[: a + 1]):
                shown = products[:, of_spot[at][:, None], of_spot[to][None]]
                block = np.tensordot(weight * values[a] * values[b], shown, axes=1)
                found[np.ix_(at, to)] = block
                found[np.ix_(to, at)] = block.T
        return Sums(
            trial=self.look.item.name,
            products=found,
            scores=weight * np.einsum("nb,bn->b", scores[:, of_spot], values[of_profile]),
            square=weight * float(np.square(self.gap).sum()),
        )

    def spread_over_spots(self, base: Base, coefficients: Array) -> Array:
        """What coefficients (n_columns, ...) make of every spot in every frame, (n, n_spots, ...)."""
        of_spot, of_profile = base.index()
        values = self.look.values
        of_both = np.zeros((len(values), self.columns.shape[1], *coefficients.shape[1:]))
        of_both[of_profile, of_spot] = coefficients
        return np.tensordot(values, of_both, axes=(0, 0))

    def subtract(self, base: Base, coefficients: Array) -> Array:
        """Residuals less what coefficients of columns explain, (n, 3 m)."""
        moved = self.spread_over_spots(base, coefficients)
        return np.asarray(self.gap - np.matmul(moved[:, None], self.columns)[:, 0])

    @cached_property
    def free(self) -> Array:
        """Of every marker, the weighed number of its values that the pose leaves free, (m,)."""
        free = np.repeat(self.look.seen, 3, axis=1) - np.square(self.basis).sum(axis=1)
        return np.asarray(self.look.weight * free.reshape(len(free), -1, 3).sum(axis=(0, 2)))

    def measure(self, values: Array) -> Array:
        """Of every marker, the weighed sum of squares of whitened values (..., n, 3 m), (..., m)."""
        each = np.square(values).reshape(*values.shape[:-1], -1, 3)
        return np.asarray(self.look.weight * each.sum(axis=(-3, -1)))


def weigh_markers(recordings: Sequence[tuple[White, Array]]) -> Array:
    """Log evidence, but for a constant, of what is left in recordings, each marker as lively as it is.

    Parameters
    ----------
    recordings : sequence
        With what is left, whitened (..., n, 3 m).
    """
    names = list(dict.fromkeys(m for white, _ in recordings for m in white.look.item.markers))
    energy, count = np.zeros(len(names)), np.zeros(len(names))
    for white, left in recordings:
        at = [names.index(m) for m in white.look.item.markers]
        own = np.zeros((*left.shape[:-2], len(names)))
        own[..., at] = white.measure(left)
        energy = energy + own
        count[at] += white.free
    return np.asarray(weigh_marker(energy, count).sum(axis=-1))


def score_course(
    white: White, left: Array, columns: Array, courses: Array, sd: float | Array
) -> tuple[float, float]:
    """Log Bayes factor of courses (k, n) of columns (n, j, 3 m) together, every marker as lively as it is.

    And the size of what moves. ``left``: residuals, whitened; ``sd``: of every course of each column, (j,).
    """
    moving = (courses[:, None, :, None] * columns.transpose(1, 0, 2)).reshape(-1, left.size)
    sd = np.tile(np.broadcast_to(sd, columns.shape[1:2]), len(courses))
    inverse = np.linalg.inv(np.diag(sd**-2.0) + white.look.weight * moving @ moving.T)
    sizes = white.look.weight * inverse @ (moving @ left.ravel())
    prior = 0.5 * float(np.square(sizes / sd).sum())
    prior -= 0.5 * float(np.linalg.slogdet(inverse / np.outer(sd, sd))[1])
    after = left - (sizes @ moving).reshape(left.shape)
    now, before = (float(weigh_markers([(white, x)])) for x in (after, left))
    return now - before - prior, float(np.linalg.norm(sizes))


def find_best_span(gains: Array) -> tuple[float, slice]:
    """The neighbouring frames with the largest sum, and that sum; none where nothing is positive.

    Kadane's algorithm (Bentley 1984, Commun ACM 27:865).

    Examples
    --------
    >>> find_best_span(np.array([-1.0, 2.0, -1.0, 3.0, -5.0]))
    (4.0, slice(1, 4, None))
    """
    total = np.concatenate([[0.0], np.cumsum(gains)])
    above = total - np.minimum.accumulate(total)
    end = int(np.argmax(above))
    return float(above[end]), slice(int(np.argmin(total[: end + 1])), end)
