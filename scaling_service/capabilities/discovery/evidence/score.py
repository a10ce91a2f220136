"""Everything that the search needs from the recordings, as sums over stretches of time.

The residuals of all markers, divided by their floors, are freed of what the pose of the frame could
explain. So are the columns of every candidate: what is left of a column is what the markers would show of
it, the pose having followed as far as it can. Products of the two, summed over *stretches* of time, are
all that scores, gains, tests and likenesses are made of, so that the recordings are passed once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.discovery.evidence.spots import Spot
from scaling_service.capabilities.discovery.evidence.watched import Role, Watched
from scaling_service.capabilities.discovery.laws.at_once import each
from scaling_service.capabilities.discovery.laws.generators import Generators, span
from scaling_service.capabilities.discovery.laws.profiles import Profile
from scaling_service.capabilities.discovery.laws.wobbles import shapes as shapes_of
from scaling_service.capabilities.discovery.search.candidates import Candidate, Column
from scaling_service.numerics.multibody.laws import Array

_FEWEST = 4  # stretches of a trial; chosen: a spread is told from three, and one may be empty
_BLOCK, _FRAMES = 1e6, 48  # numbers of all columns at once: 8 MB, and frames of their spots (chosen)
_MOST = 1e8  # numbers of all columns together; chosen: some eight seconds on one core


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """Sums over a stretch of one trial.

    Parameters
    ----------
    trial : str
    role : 'fit' or 'held_out'
    scores : ndarray, shape (n_columns,)
        Columns times residuals.
    cross : ndarray, shape (n_nuisances, n_columns)
        The first columns, which are nuisances, times all columns.
    own : ndarray, shape (n_columns, n_columns) or (n_groups, widest, widest)
        Columns times columns: all of them, or only those of one group with each other.
    square : float
        Residuals times residuals.
    freedom : float
        How many numbers the residuals are, the pose's taken off.
    """

    trial: str
    role: Role
    scores: Array
    cross: Array
    own: Array
    square: float
    freedom: float


def deciding(stretches: Sequence[Stretch], candidate: Candidate) -> list[Stretch]:
    """Those that fit a candidate: all to fit, and where it is in none of them, those where it is.

    Where it is not they tell the nuisances from it.
    """
    fits = [s for s in stretches if s.role == "fit"]
    if any(candidate.holds_in(s.trial) for s in fits):
        return fits
    return [*fits, *(s for s in stretches if candidate.holds_in(s.trial))]


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """Stretches of all recordings.

    Parameters
    ----------
    stretches : tuple of Stretch
    raw : ndarray, shape (n_columns,)
        Squares of the columns before the pose was taken out, over all stretches.
    nuisances : int
        How many of the columns, the first ones, may take any value.
    groups : tuple of slice
        The columns of each candidate.
    """

    stretches: tuple[Stretch, ...]
    raw: Array
    nuisances: int
    groups: tuple[slice, ...]

    def arranged(self, known: Array, groups: Sequence[Array]) -> Evidence:
        """Of what was gathered together, some columns as nuisances and others in groups, by their numbers."""
        order = np.concatenate([known, *groups]).astype(np.intp)
        edges = np.cumsum([len(known), *(len(group) for group in groups)]).tolist()
        stretches = tuple(
            replace(
                s,
                scores=s.scores[order],
                own=s.own[np.ix_(order, order)],
                cross=s.own[np.ix_(order[: len(known)], order)],
            )
            for s in self.stretches
        )
        spans = tuple(slice(a, b) for a, b in pairwise(edges))
        return Evidence(stretches, self.raw[order], len(known), spans)

    def apart(self) -> Evidence:
        """The same with the products of each group only, also where all were gathered together."""
        if not self.stretches or self.stretches[0].own.ndim == 3:
            return self
        edges = np.array([self.nuisances, *(rows.stop for rows in self.groups)])
        table = _padded(edges)

        def of_groups(own: Array) -> Array:
            wide = np.pad(own, (0, 1))
            return np.asarray(wide[table[:, :, None], table[:, None, :]])

        return replace(self, stretches=tuple(replace(s, own=of_groups(s.own)) for s in self.stretches))


def gather(
    watched: Sequence[Watched],
    nuisances: Sequence[Candidate],
    candidates: Sequence[Candidate],
    stretch_s: float,
    *,
    together: bool,
) -> Evidence:
    """Pass all recordings once.

    Parameters
    ----------
    watched : sequence of Watched
    nuisances, candidates : sequence of Candidate
        What may take any value anyhow, and what is looked at.
    stretch_s : float
        Length of a stretch, s.
    together : bool
        Whether products of different candidates are wanted.
    """
    every = [*nuisances, *candidates]
    columns = [column for candidate in every for column in candidate.columns]
    count = sum(len(candidate.columns) for candidate in nuisances)
    edges = np.cumsum([count, *(len(candidate.columns) for candidate in candidates)])
    spots = tuple(dict.fromkeys(part.spot for column in columns for part in column.parts))
    profiles = tuple(dict.fromkeys(part.profile for column in columns for part in column.parts))
    layout = Layout.of(columns, spots, profiles, count, None if together else edges)
    step = _step(watched, len(columns))
    known: list[tuple[Watched, Generators]] = []
    for item in watched:
        if not any(_same_body(item, other) for other, _ in known):
            known.append((item, Generators.of(item, spots)))

    def parts(item: Watched) -> list[Callable[[], tuple[Stretch, Array]]]:
        generators = next(g for other, g in known if _same_body(item, other))
        shapes = shapes_of(profiles, item)
        here = layout.only([c.holds_in(item.name) for c in every for _ in c.columns])
        return [
            partial(_sums, item, generators, here, shapes, rows, step)
            for rows in stretches_of(item, stretch_s)
        ]

    sums = each(lambda part: part(), [part for item in watched for part in parts(item)])
    raw = sum((own for _, own in sums), np.zeros(len(columns)))
    spans = tuple(slice(a, b) for a, b in pairwise(edges.tolist()))
    return Evidence(tuple(stretch for stretch, _ in sums), raw, count, spans)


def _same_body(one: Watched, other: Watched) -> bool:
    """Whether two recordings are followed by the same body with the same markers and coordinates."""
    alike = one.markers == other.markers and np.array_equal(one.task.free, other.task.free)
    return alike and one.task.model == other.task.model


def _step(watched: Sequence[Watched], n_columns: int) -> int:
    """Every how many frames to look at, so that the products stay within bounds."""
    products = sum(3 * item.task.measured.shape[0] * len(item.markers) for item in watched) * n_columns
    return 1 + int(products / _MOST)


def stretches_of(item: Watched, length_s: float) -> Iterator[slice]:
    """Stretches of about this length, at least four to a trial."""
    clock = item.trial.times
    count = max(_FEWEST, int((clock[-1] - clock[0]) / length_s))
    edges = np.linspace(0, len(clock), count + 1).round().astype(int)
    return (slice(a, b) for a, b in pairwise(edges.tolist()) if b > a)


class _Parts(NamedTuple):
    """Which column is made, or added to, with which spot and profile, and how much: arrays of one length."""

    column: NDArray[np.intp]
    spot: NDArray[np.intp]
    profile: NDArray[np.intp]
    gain: Array


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """Of what columns are made, and whose products with each other are wanted.

    Parameters
    ----------
    count : int
        Of the columns.
    parts : tuple of _Parts
        The first parts of all columns, then the second of those that have two, and so on.
    nuisances : int
        How many of the columns, the first ones, may take any value.
    edges : ndarray, optional
        Where the groups of the others begin and end, if they are kept apart.
    """

    count: int
    parts: tuple[_Parts, ...]
    nuisances: int
    edges: NDArray[np.intp] | None

    @classmethod
    def of(
        cls,
        columns: Sequence[Column],
        spots: Sequence[Spot],
        profiles: Sequence[Profile],
        nuisances: int,
        edges: NDArray[np.intp] | None,
    ) -> Layout:
        """For columns, the first of which are nuisances; ``edges`` where groups are kept apart."""
        at = {spot: k for k, spot in enumerate(spots)}
        of = {profile: k for k, profile in enumerate(profiles)}
        made = []
        for rank in range(max((len(column.parts) for column in columns), default=0)):
            here = [(k, column.parts[rank]) for k, column in enumerate(columns) if len(column.parts) > rank]
            numbers = [(k, at[part.spot], of[part.profile]) for k, part in here]
            column, spot, profile = np.array(numbers, dtype=np.intp).T
            made.append(_Parts(column, spot, profile, np.array([part.gain for _, part in here])))
        return cls(len(columns), tuple(made), nuisances, edges)

    def only(self, active: Sequence[bool]) -> Layout:
        """The layout with columns that are not active zero."""
        on = np.array(active, dtype=float)
        return replace(self, parts=tuple(p._replace(gain=p.gain * on[p.column]) for p in self.parts))

    def own(self, made: Array) -> Array:
        """Columns (n_columns, rows) times columns, as ``own`` of a stretch."""
        if self.edges is None:
            return np.asarray(made @ made.T)
        widths = np.diff(self.edges)
        found = np.zeros((len(widths), *2 * (int(widths.max(initial=0)),)))
        for width in set(widths.tolist()):
            groups = np.flatnonzero(widths == width)
            wide = made[self.edges[groups][:, None] + np.arange(width)]
            found[groups, :width, :width] = wide @ wide.transpose(0, 2, 1)
        return found

    def columns(self, generated: Array, shapes: Array) -> Array:
        """Columns (n_columns, n, rows) from generators (n_spots, n, rows) and profiles (n_profiles, n)."""
        made = np.zeros((self.count, *generated.shape[1:]))
        for k, part in enumerate(self.parts):
            shape = (shapes[part.profile] * part.gain[:, None])[:, :, None]
            if k == 0:
                np.multiply(generated[part.spot], shape, out=made)
            else:
                made[part.column] += generated[part.spot] * shape
        return made


def _padded(edges: NDArray[np.intp]) -> NDArray[np.intp]:
    """The columns of each group in rows of equal length, filled up with the column after the last."""
    widest = int(np.diff(edges).max(initial=0))
    table = edges[:-1, None] + np.arange(widest)
    return np.where(table < edges[1:, None], table, edges[-1])


def _sums(
    item: Watched, generators: Generators, layout: Layout, shapes: Array, rows: slice, step: int
) -> tuple[Stretch, Array]:
    """Of one stretch, and the squares of its columns before the pose was taken out.

    The pose is taken out of the spots: there are far fewer of them than of columns, which are their sums.
    """
    count = layout.count
    scores, raw, own = np.zeros(count), np.zeros(count), layout.own(np.zeros((count, 0)))
    cross = np.zeros((layout.nuisances, count))
    square = freedom = 0.0
    at_once = max(1, int(_BLOCK / (3 * len(item.markers) * max(count, 1))))
    for start in range(rows.start, rows.stop, step * _FRAMES):
        block = slice(start, min(start + step * _FRAMES, rows.stop), step)
        gap, pose, spots = generators.at(item, block)
        basis = span(pose)
        taken = basis.transpose(0, 2, 1) @ spots
        left = np.ascontiguousarray(np.moveaxis(spots - basis @ taken, 2, 0))
        hidden = np.ascontiguousarray(np.moveaxis(taken, 2, 0))
        gap = gap - np.einsum("nrq,nq->nr", basis, np.einsum("nrq,nr->nq", basis, gap))
        square += float((gap**2).sum())
        freedom += 3.0 * float(item.seen[block].sum()) - float((basis**2).sum())
        shaped = shapes[:, block]
        for first in range(0, len(gap), at_once):
            some = slice(first, first + at_once)
            made = layout.columns(left[:, some], shaped[:, some]).reshape(count, -1)
            raw += _squares(made) + _squares(layout.columns(hidden[:, some], shaped[:, some]))
            scores += made @ gap[some].ravel()
            cross += made[: layout.nuisances] @ made.T
            own += layout.own(made)
    return Stretch(item.name, item.role, scores, cross, own, square, freedom), raw


def _squares(made: Array) -> Array:
    flat = made.reshape(len(made), -1)
    return np.asarray(np.einsum("kr,kr->k", flat, flat))
