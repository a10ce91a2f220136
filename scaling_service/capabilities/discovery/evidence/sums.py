"""Everything that the search needs from the recordings, as sums over blocks of time.

The residuals, divided by their floors, are freed of what the pose of the frame could explain. So are the
columns of every candidate: what is left of a column is what the observation would show of it, the pose having
followed as far as it can. Products of the two, summed over *blocks* of time, are all that scores, gains,
tests and likenesses are made of, so that the recordings are passed once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.discovery.evidence.settings import IDENTIFIABLE
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Column, Estimate
from scaling_service.capabilities.discovery.observations.tracked import Role
from scaling_service.numerics.multibody.laws import Array

_KEPT = 4  # chosen: the two halves of what is folded, of motion and of forces


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Block:
    """Sums over a block of time of one trial."""

    trial: str
    role: Role
    scores: Array  # (n_columns,): columns times residuals
    cross: Array  # (n_nuisances, n_columns): the first columns, which are nuisances, times all columns
    # (n_columns, n_columns), or (n_groups, widest, widest): columns times columns: all of them, or only
    # those of one group with each other
    own: Array
    square: float  # residuals times residuals
    freedom: float  # how many numbers the residuals are, the pose's taken off
    # scores and products of all columns that noise makes on average and that were taken off, where there were
    chance: tuple[Array, Array] | None = None


def select_fitting_blocks(blocks: Sequence[Block], candidate: Candidate) -> list[Block]:
    """Those that fit a candidate: all to fit, and where it is in none of them, those where it is.

    Where it is not they tell the nuisances from it.
    """
    fits = [s for s in blocks if s.role == "fit"]
    if any(candidate.holds_in(s.trial) for s in fits):
        return fits
    return [*fits, *(s for s in blocks if candidate.holds_in(s.trial))]


@dataclass(frozen=True, eq=False)
class Evidence:
    """Blocks of all recordings."""

    blocks: tuple[Block, ...]
    raw: Array  # (n_columns,): squares of the columns before the pose was taken out, over all blocks
    nuisances: int  # how many of the columns, the first ones, may take any value
    groups: tuple[slice, ...]  # the columns of each candidate

    def arrange(self, known: Array, groups: Sequence[Array]) -> Evidence:
        """Of what was gathered together, some columns as nuisances and others in groups, by their numbers."""
        order = np.concatenate([known, *groups]).astype(np.intp)
        edges = np.cumsum([len(known), *(len(group) for group in groups)]).tolist()
        blocks = tuple(
            replace(
                s,
                scores=s.scores[order],
                own=s.own[np.ix_(order, order)],
                cross=s.own[np.ix_(order[: len(known)], order)],
            )
            for s in self.blocks
        )
        spans = tuple(slice(a, b) for a, b in pairwise(edges))
        return Evidence(blocks, self.raw[order], len(known), spans)

    def products(self, index: int, blocks: Sequence[Block]) -> Array:
        """The columns of one group times each other in each block, (n_blocks, k, k)."""
        rows = self.groups[index]
        count = rows.stop - rows.start
        found = [s.own[rows, rows] if s.own.ndim == 2 else s.own[index, :count, :count] for s in blocks]
        return np.array(found).reshape(len(blocks), count, count)

    @cached_property
    def summed(self) -> Callable[[tuple[Block, ...]], tuple[Array, Array, Array]]:
        """Products and scores of all columns over blocks, and the inverse of what the nuisances show there.

        Most candidates are fitted to the same blocks, one after the other.
        """
        return lru_cache(_KEPT)(partial(_sum_products, self.raw, self.nuisances))


class Chunk(NamedTuple):
    """Some frames: columns and residuals, divided by floors and freed of the pose."""

    columns: Array  # (n_columns, rows)
    residuals: Array  # (rows,)
    square: float  # of the residuals, also of what no column shows
    freedom: float  # how many numbers the residuals are, the pose's taken off
    hidden: Array | float = 0.0  # (n_columns,): squares of what the pose took of the columns
    weight: float = 1.0  # how many frames each frame stands for


@dataclass(frozen=True, slots=True, eq=False)
class BlockSource:
    """Neighbouring blocks of time of one trial, whose chunks are made when they are summed."""

    trial: str
    role: Role
    blocks: Callable[[], Iterable[Iterable[Chunk]]]
    # what noise makes of both, columns and residuals, drawn a few times
    by_chance: Sequence[Callable[[], Iterable[Iterable[Chunk]]]] = ()

    def add_up(self, layout: Layout) -> list[tuple[Block, Array]]:
        """Each block's sums without what noise alone makes of them on average, and the columns' squares."""
        found = [self._sums(chunks, layout) for chunks in self.blocks()]
        if not self.by_chance:
            return found
        draws = [[self._sums(chunks, layout)[0] for chunks in drawn()] for drawn in self.by_chance]
        return [(_without(block, drawn), raw) for (block, raw), *drawn in zip(found, *draws, strict=True)]

    def _sums(self, chunks: Iterable[Chunk], layout: Layout) -> tuple[Block, Array]:
        count, known = len(layout.columns), layout.nuisances
        scores, raw, cross = np.zeros(count), np.zeros(count), np.zeros((known, count))
        own = layout.own(np.zeros((count, 0)))
        square = freedom = 0.0
        for columns, residuals, left, numbers, hidden, weight in chunks:
            scores += weight * (columns @ residuals)
            own += weight * layout.own(columns)
            if not layout.together:
                cross += weight * (columns[:known] @ columns.T)
            raw += weight * hidden
            square += weight * left
            freedom += weight * numbers
        crossed = own[:known] if layout.together else cross
        raw += layout.squares(own, crossed)
        return Block(
            trial=self.trial,
            role=self.role,
            scores=scores,
            cross=crossed,
            own=own,
            square=square,
            freedom=freedom,
        ), raw


def _without(block: Block, drawn: Sequence[Block]) -> Block:
    """A block without the mean of what was drawn."""
    scores, cross, own = (
        np.mean([getattr(one, name) for one in drawn], axis=0) for name in ("scores", "cross", "own")
    )
    return replace(
        block,
        scores=block.scores - scores,
        cross=block.cross - cross,
        own=block.own - own,
        chance=(scores, own),
    )


def _sum_products(raw: Array, count: int, blocks: tuple[Block, ...]) -> tuple[Array, Array, Array]:
    total = np.sum([s.own for s in blocks], axis=0)
    inverse = invert_curvature(total[:count, :count], raw[:count])[0]
    return total, np.sum([s.scores for s in blocks], axis=0), inverse


def invert_curvature(curvature: Array, raw: Array) -> tuple[Array, float, Array]:
    """Inverse (k, k) of a curvature where the recordings show something, and how much they show.

    That is the largest share of any direction's square that is not hidden. Also directions D (k, rank) with
    D D' = inverse: D' score has unit variance for white noise.
    """
    scale = np.divide(1.0, np.sqrt(raw), out=np.zeros_like(raw), where=raw > 0)
    value, vector = np.linalg.eigh(curvature * np.outer(scale, scale))
    known = value > IDENTIFIABLE
    directions = scale[:, None] * vector[:, known] / np.sqrt(value[known])
    return directions @ directions.T, float(value.max(initial=0.0)), directions


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Layout:
    """The columns of nuisances (first) and candidates, and whose products with each other are wanted."""

    columns: tuple[Column, ...]
    owners: tuple[Candidate, ...]  # of the columns
    nuisances: int  # how many of the columns, the first ones, may take any value
    edges: NDArray[np.intp]  # where the groups of the others begin and end
    together: bool  # whether products of different candidates are wanted
    rough: bool  # whether fewer frames and digits, and fewer draws of noise, will do
    sizes: Array  # (n_columns,): what the residuals were freed of, as far as it oscillates; zero elsewhere

    @classmethod
    def of(
        cls,
        nuisances: Sequence[Candidate],
        candidates: Sequence[Candidate],
        *,
        together: bool,
        rough: bool = False,
        known: Sequence[Estimate] = (),
    ) -> Layout:
        """For nuisances and candidates; ``known``: what the residuals were freed of."""
        every = [*nuisances, *candidates]
        owners = tuple(candidate for candidate in every for _ in candidate.columns)
        columns = tuple(column for candidate in every for column in candidate.columns)
        count = sum(len(candidate.columns) for candidate in nuisances)
        edges = np.cumsum([count, *(len(candidate.columns) for candidate in candidates)])
        freed_of = {column: size for s in known for column, size in s.columns if any(column.oscillators)}
        sizes = np.array([freed_of.get(column, 0.0) for column in columns])
        return cls(
            columns=columns,
            owners=owners,
            nuisances=count,
            edges=edges,
            together=together,
            rough=rough,
            sizes=sizes,
        )

    @property
    def groups(self) -> tuple[slice, ...]:
        """The columns of each candidate."""
        return tuple(slice(a, b) for a, b in pairwise(self.edges.tolist()))

    def active_in(self, trial: str) -> list[bool]:
        """Which columns there are in a trial."""
        return [candidate.holds_in(trial) for candidate in self.owners]

    def squares(self, own: Array, cross: Array) -> Array:
        """Of the columns (n_columns,), by ``own`` and ``cross`` of a block."""
        if self.together:
            return np.diag(own)
        widths = np.arange(own.shape[1]) < np.diff(self.edges)[:, None]
        return np.concatenate([np.diag(cross), np.einsum("gkk->gk", own)[widths]])

    def own(self, made: Array) -> Array:
        """Columns (n_columns, rows) times columns, as ``own`` of a block."""
        if self.together:
            return np.asarray(made @ made.T)
        widths = np.diff(self.edges)
        found = np.zeros((len(widths), *2 * (int(widths.max(initial=0)),)))
        for width in set(widths.tolist()):
            groups = np.flatnonzero(widths == width)
            wide = made[self.edges[groups][:, None] + np.arange(width)]
            found[groups, :width, :width] = wide @ wide.transpose(0, 2, 1)
        return found
