"""Where the bones are, from markers, from how skin moves over them and from what is known of their joints.

Plain inverse kinematics takes every marker's error for its own. Here markers of a segment err together
(:mod:`.uncertainty`), and a model may hold expectations of its coordinates; the pose is the most probable one
given all three (Gaussian, so generalised least squares in every frame).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.motion.uncertainty import (
    Mask,
    SkinField,
    compute_marker_rates,
    find_distinct_patterns,
    find_lost,
    is_pin,
    list_rigid_modes,
    split_frames,
)
from scaling_service.core.arrays import Array
from scaling_service.model.body import BodyModel, Expectation
from scaling_service.model.compile import to_piecewise
from scaling_service.numerics.least_squares.problem import find_seen
from scaling_service.numerics.multibody.tree import Tree, place_tree_markers, pose_links

if TYPE_CHECKING:
    from scaling_service.capabilities.motion.task import Task

_NOISE_M = 1e-3  # chosen: cameras and a marker's own wobble, beside what skin does
_MOST_STEPS = 20
_CLOSE = 1e-6  # rad or m: no motion file shows less
_LONGEST = 0.5  # rad or m: no step goes further, so that the start's minimum is kept
_ROUNDS = 20  # of expectation and maximisation; chosen: sizes then move by less than a per cent
_FRAMES = 200  # of a recording, from which sizes of skin are learnt
_FEW = 8  # frames, equally spaced, in which is looked at what a recording reveals
_REVEALED = 2.0 / 3.0  # chosen: four of the six ways in which a cluster moves as a whole


@dataclass(frozen=True, slots=True, eq=False)
class Posed:
    """A task with a motion that nearly solves it."""

    task: Task
    q: Array  # (n_frames, n_coordinates), rad or m
    held: Mask  # (n_frames, n_coordinates): what the markers do not determine or a range ends

    def thin(self) -> Posed:
        """Some of its frames, equally spaced: skin moves slowly, neighbours tell the same."""
        rows = np.unique(np.linspace(0, len(self.q) - 1, min(len(self.q), _FRAMES)).astype(np.intp))
        return Posed(self.task.in_frames(rows), self.q[rows], self.held[rows])


@dataclass(frozen=True, slots=True, eq=False)
class BoneMotion:
    """The most probable motion, and how sure it is."""

    q: Array  # (n_frames, n_coordinates), rad or m
    sd: Array  # the same shape: zero where locked, NaN where held
    combined: Array | None = None  # (n_frames, n_combined), as in CoordinateSd


def has_bone_knowledge(model: BodyModel) -> bool:
    """Whether a model holds more of bones than plain inverse kinematics uses."""
    return bool(model.expectations) or any(m.skin_sd is not None for m in model.markers)


def estimate_bones(
    posed: Posed, fields: Sequence[SkinField], rates: Callable[[Array], Array] | None = None
) -> BoneMotion:
    """The most probable motion given markers, skin and the model's expectations.

    Frames that end less probable than they began keep their start. ``rates``: of coordinates, as
    :func:`.uncertainty.estimate_coordinate_sd` takes them.
    """
    normal = _Normal.of(posed, fields)
    q, free = posed.q.copy(), np.flatnonzero(posed.task.free)
    sd, combined = np.zeros(q.shape), list[Array]()
    unknown = posed.held & posed.task.free
    for rows in split_frames(len(q)):
        q[rows] = _solve(normal, q[rows], rows)
        covariance = np.linalg.inv(normal.at(q[rows], rows).curvature)
        sd[rows, free] = np.sqrt(np.einsum("nii->ni", covariance))
        if rates is not None:
            change = rates(q[rows])
            moved = change[:, :, free]
            square = np.einsum("nkf,nfg,nkg->nk", moved, covariance, moved, optimize=True)
            combined.append(np.where(find_lost(change, unknown[rows]), np.nan, np.sqrt(square)))
    sd[unknown] = np.nan
    return BoneMotion(q, sd, np.concatenate(combined) if combined else None)


def learn_skin_sizes(recordings: Sequence[Posed], fields: Sequence[Sequence[SkinField]]) -> dict[str, float]:
    """How far the skin under each marker moves (m, along one axis), where recordings reveal it.

    What a cluster does as a whole shows where pins, through joints, say where its bone is; elsewhere nothing
    is learnt. Sizes are those of greatest likelihood (Dempster, Laird and Rubin 1977: expectation and
    maximisation), the correlation of markers left as published.
    """
    learnt: dict[str, float] = {}
    for posed, own in zip(recordings, fields, strict=True):
        shown = compute_revealed_share(posed, own)
        for field, share in zip(own, shown, strict=True):
            if is_revealed(share):
                names = [posed.task.markers[k] for k in field.markers]
                learnt |= dict(zip(names, np.sqrt(np.diag(field.covariance)).tolist(), strict=True))
    if not learnt:
        return {}
    for _ in range(_ROUNDS):
        squares, counts = dict.fromkeys(learnt, 0.0), dict.fromkeys(learnt, 0)
        for k, (posed, own) in enumerate(zip(recordings, fields, strict=True)):
            sized = [resize(field, posed.task.markers, learnt) for field in own]
            moved, square = _expect_skin_squares(posed, sized)
            recordings = [*recordings[:k], Posed(posed.task, moved, posed.held), *recordings[k + 1 :]]
            known = find_seen(posed.task.measured)
            for m, name in enumerate(posed.task.markers):
                if name in learnt:
                    squares[name] += float(square[known[:, m], m].sum())
                    counts[name] += 3 * int(known[:, m].sum())
        learnt = {name: float(np.sqrt(squares[name] / max(counts[name], 1))) for name in learnt}
    return learnt


def is_revealed(share: float) -> bool:
    """Whether enough is seen of what a cluster does as a whole to learn its size."""
    return share >= _REVEALED


def compute_revealed_share(posed: Posed, fields: Sequence[SkinField]) -> list[float]:
    """Of what each field's cluster does as a whole, the share of variance that the recording takes away.

    None where no pin is in any bone: sizes of neighbours' skin are then as much of a guess.
    """
    if not any(is_pin(name) for name in posed.task.markers):
        return [0.0] * len(fields)
    rows = np.unique(np.linspace(0, len(posed.q) - 1, min(len(posed.q), _FEW)).astype(np.intp))
    few = Posed(posed.task.in_frames(rows), posed.q[rows], posed.held[rows])
    at = _Normal.of(few, fields).at(few.q, slice(None))
    count = len(posed.task.markers)
    rates = at.rates.reshape(len(rows), -1, count, 3)
    places = _evaluate_places(few.task.tree, few.q, few.task.p)
    shares = []
    for field in fields:
        lost = []
        for frame, (where, rate, curvature) in enumerate(zip(places, rates, at.curvature, strict=True)):
            if not find_seen(few.task.measured[frame, field.markers]).all():
                continue
            ways = np.linalg.pinv(list_rigid_modes(where[field.markers]))
            prior = ways @ np.kron(field.covariance, np.eye(3)) @ ways.T
            moved = ways @ rate[:, field.markers].reshape(len(rate), -1).T
            after = moved @ np.linalg.solve(curvature, moved.T)
            rank = min(6, 3 * len(field.markers))
            lost.append(min(1.0, float(np.trace(np.linalg.pinv(prior, rcond=1e-6) @ after)) / rank))
        shares.append(1.0 - float(np.mean(lost)) if lost else 0.0)
    return shares


def resize(field: SkinField, markers: Sequence[str], sizes: Mapping[str, float]) -> SkinField:
    """A field whose markers have sizes of their own, alike as they were."""
    before = np.sqrt(np.diag(field.covariance))
    now = np.array([sizes.get(markers[k], sd) for k, sd in zip(field.markers, before, strict=True)])
    return SkinField(field.markers, field.covariance * np.outer(now / before, now / before))


def _expect_skin_squares(posed: Posed, fields: Sequence[SkinField]) -> tuple[Array, Array]:
    """The motion, and every marker's expected squared displacement over the bone, (n, n_markers), m2."""
    normal = _Normal.of(posed, fields)
    q, square = posed.q.copy(), np.zeros(posed.task.measured.shape[:2])
    for rows in split_frames(len(q)):
        q[rows] = _solve(normal, q[rows], rows)
        at = normal.at(q[rows], rows)
        spread = np.matmul(np.linalg.inv(at.curvature), at.rates)
        unsure = (at.rates * spread).sum(axis=1).reshape(len(at.rates), -1, 3).sum(axis=2)
        square[rows] = np.square(normal.residuals(q[rows], rows)).sum(axis=2) + unsure
    return q, square


@dataclass(frozen=True, slots=True, eq=False)
class _Linearised:
    """Rates of markers (n, n_free, 3 n_markers), gradient (n, n_free), curvature, and the cost (n,)."""

    rates: Array
    gradient: Array
    curvature: Array
    cost: Array


@dataclass(frozen=True, slots=True, eq=False)
class _Normal:
    """What is minimised in every frame."""

    posed: Posed
    white: Array  # (n_patterns, m, m): inverse roots of the markers' covariance, zero for those not seen
    which: NDArray[np.intp]  # (n_frames,): the pattern of each
    expected: tuple[_Expected, ...]

    @classmethod
    def of(cls, posed: Posed, fields: Sequence[SkinField]) -> _Normal:
        """By patterns of markers that are seen together."""
        task = posed.task
        shown = find_seen(task.measured)
        covariance = _NOISE_M**2 * np.eye(len(task.markers))
        for field in fields:
            covariance[np.ix_(field.markers, field.markers)] += field.covariance
        first, which = find_distinct_patterns(shown)
        white = np.zeros((len(first), *covariance.shape))
        for k, frame in enumerate(first):
            some = np.flatnonzero(shown[frame])
            root = np.linalg.cholesky(covariance[np.ix_(some, some)])
            white[k][np.ix_(some, some)] = np.linalg.inv(root)
        names = list(task.model.coordinate_names)
        expected = tuple(_Expected.of(e, names) for e in task.model.expectations)
        return cls(posed, white, which, expected)

    def residuals(self, q: Array, rows: slice) -> Array:
        """Measured minus model, zero where not seen, (n, m, 3), m."""
        task = self.posed.task
        return np.nan_to_num(task.measured[rows] - _evaluate_places(task.tree, q, task.p))

    def at(self, q: Array, rows: slice) -> _Linearised:
        """Linearised about a motion of some frames."""
        task, held = self.posed.task, self.posed.held[rows]
        free = np.flatnonzero(task.free)
        rates = compute_marker_rates(task.tree, q, task.p, free)
        rates *= ~held[:, free, None]
        n, count, _ = rates.shape
        white = self.white[self.which[rows]]
        moved = rates.reshape(n, count, -1, 3).transpose(0, 2, 3, 1).reshape(n, white.shape[1], -1)
        moved = (white @ moved).reshape(n, -1, count)
        left = (white @ self.residuals(q, rows)).reshape(n, -1, 1)
        gradient = (moved.transpose(0, 2, 1) @ left)[:, :, 0]
        curvature = moved.transpose(0, 2, 1) @ moved
        cost = np.square(left).sum(axis=(1, 2))
        for expected in self.expected:
            off, slopes = expected.linearise(q)
            slopes = np.where(held[:, free], 0.0, slopes[:, free])
            gradient -= slopes * off[:, None]
            curvature += slopes[:, :, None] * slopes[:, None]
            cost += off**2
        diagonal = np.einsum("nii->ni", curvature)
        diagonal += np.where(held[:, free], 1.0, 1e-12 * diagonal.max(axis=1, initial=0.0, keepdims=True))
        return _Linearised(rates, gradient, curvature, cost)


@dataclass(frozen=True, slots=True, eq=False)
class _Expected:
    """An expectation by numbers of coordinates."""

    expectation: Expectation
    coordinate: int
    columns: Mapping[str, int]

    @classmethod
    def of(cls, expectation: Expectation, names: Sequence[str]) -> _Expected:
        columns = {name: names.index(name) for name in expectation.law.coordinates}
        return cls(expectation, names.index(expectation.coordinate), columns)

    def linearise(self, q: Array) -> tuple[Array, Array]:
        """How many deviations each frame is off, (n,), and how that changes with q, (n, n_coordinates)."""
        off, slopes = q[:, self.coordinate].copy(), np.zeros(q.shape)
        slopes[:, self.coordinate] = 1.0
        for term in self.expectation.law.terms:
            if term.coordinate is None:
                off -= term.gain
                continue
            column = self.columns[term.coordinate]
            x = q[:, column]
            value, slope = (x, 1.0) if term.shape is None else to_piecewise(term.shape).evaluate(x)
            off -= term.gain * value
            slopes[:, column] -= term.gain * slope
        return off / self.expectation.sd, slopes / self.expectation.sd


def _solve(normal: _Normal, start: Array, rows: slice) -> Array:
    """Gauss-Newton steps of a block of frames."""
    free, q = np.flatnonzero(normal.posed.task.free), start.copy()
    first = at = normal.at(q, rows)
    for _ in range(_MOST_STEPS):
        step = np.linalg.solve(at.curvature, at.gradient[:, :, None])[:, :, 0]
        step *= np.minimum(1.0, _LONGEST / np.maximum(np.abs(step).max(axis=1, keepdims=True), _LONGEST))
        q[:, free] += step
        at = normal.at(q, rows)
        if np.abs(step).max(initial=0.0) < _CLOSE:
            break
    return np.asarray(np.where((at.cost <= first.cost)[:, None], q, start))


def _evaluate_places(tree: Tree, q: Array, p: Array) -> Array:
    return np.moveaxis(place_tree_markers(tree, pose_links(tree, np.ascontiguousarray(q.T), p)), -1, 0)
