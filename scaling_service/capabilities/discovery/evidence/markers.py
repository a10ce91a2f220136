"""Markers as an observation: residuals and columns of every frame, freed of the pose."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, dia_array

from scaling_service.capabilities.discovery.evidence.fit import Fit, fit_recordings
from scaling_service.capabilities.discovery.evidence.observation import Observation
from scaling_service.capabilities.discovery.evidence.sums import BlockSource, Chunk, Layout
from scaling_service.capabilities.discovery.laws.candidates import Column, Estimate, Seen
from scaling_service.capabilities.discovery.laws.profiles import Oscillation, Profile, evaluate_profiles
from scaling_service.capabilities.discovery.laws.spots import Generators, Spot
from scaling_service.capabilities.discovery.laws.steady_skin import (
    collect_oscillations,
    make_steady_replicates,
)
from scaling_service.capabilities.discovery.observations.performed import perform_movement
from scaling_service.capabilities.discovery.observations.tracked import TrackedTrial, span
from scaling_service.core.threads import map_parallel
from scaling_service.numerics.multibody.laws import Array

_CHUNK = 5e5  # numbers of all columns at once (chosen: 4 MB)
_SPOTS, _FRAMES = 4e6, (16, 144)  # numbers of all spots at once (chosen: 32 MB), and fewest and most frames
_MOST = 1e8  # numbers of all columns together; chosen: some eight seconds on one core
_ROUGH = 5  # frames of a block that a rough look takes (chosen: each has as many numbers as all markers)
_AT_ONCE = 128  # frames of a pose's freedom
_LEAST_LEFT = 1e-3  # of a marker's noise that its pose always leaves (chosen: nothing is divided by zero)


class Markers(Observation[TrackedTrial]):
    """All markers; a place is a marker, by its distance."""

    name: Seen = "markers"
    per_place = 3

    def items(self, fit: Fit) -> Sequence[TrackedTrial]:
        """All trials."""
        return fit.tracked

    def places(self, fit: Fit) -> tuple[str, ...]:
        """All markers of all trials."""
        return tuple(dict.fromkeys(m for item in fit.tracked for m in item.markers))

    def sources(self, items: Sequence[TrackedTrial], layout: Layout, block_s: float) -> list[BlockSource]:
        """All that the same body needs is made once."""
        parts = [part for column in layout.columns for part in column.parts]
        spots = tuple(dict.fromkeys(part.spot for part in parts))
        profiles = tuple(dict.fromkeys(part.profile for part in parts))
        products = _Products.of(layout.columns, spots, profiles)
        known: list[tuple[TrackedTrial, Generators]] = []
        sources = []
        for item in items:
            generators = next((g for other, g in known if _are_of_same_body(item, other)), None)
            if generators is None:
                generators = Generators.of(item, spots)
                known.append((item, generators))
            here = products.of_columns(layout.active_in(item.name), layout.rough)
            step = _choose_step(item, items, layout, block_s)
            made = _Columns(
                item=item,
                generators=generators,
                products=here,
                values=evaluate_profiles(profiles, item),
                step=step,
            )
            strays = list(made.strays(profiles, layout)) if layout.sizes.any() else []
            for stretch in made.stretches(item.blocks(block_s)):
                block, *by_chance = (partial(one.blocks, stretch) for one in (made, *strays))
                sources.append(BlockSource(item.name, item.role, block, by_chance))
        return sources

    def refit(self, fit: Fit, free: Sequence[Estimate], effects: Sequence[Estimate]) -> Fit:
        """Tracked anew, and forces with the motion."""
        return fit_recordings(fit.context, free, effects, fit)

    def residuals(self, fit: Fit) -> list[tuple[TrackedTrial, Array]]:
        """Measured minus model, m, of all markers of all trials in their order."""
        names, found = self.places(fit), []
        for item in fit.tracked:
            wide = np.full((len(item.q), len(names), 3), np.nan)
            wide[:, [names.index(m) for m in item.markers]] = item.residuals
            found.append((item, wide.reshape(len(item.q), -1)))
        return found

    def frames(self, fit: Fit, item: TrackedTrial, noise: Array | None) -> tuple[Array, Array, Array]:
        """Squared distances; the pose takes part of a marker's noise with it."""
        names = self.places(fit)
        at = [names.index(m) for m in item.markers]
        slow = np.zeros(len(at)) if noise is None else noise[at]
        floor = np.where(item.seen, np.maximum(_compute_free_share(item) * item.sure_noise**2, slow), 0.0)
        square = np.nan_to_num(np.square(item.residuals).sum(axis=2))
        wide = np.zeros((3, len(item.q), len(names)))
        wide[:, :, at] = square, floor, item.seen
        return wide[0], wide[1], wide[2]

    def series(self, fit: Fit, place: str) -> Iterator[tuple[TrackedTrial, Array, Array]]:
        """A marker's residuals, (n, 3), m."""
        for item in fit.tracked:
            if place in item.markers:
                yield item, item.residuals[:, item.markers.index(place)], item.q

    def perform(self, fit: Fit, movement: str) -> TrackedTrial | None:
        """By the markers of the first trial."""
        return perform_movement(fit.tracked[0], movement)


def _are_of_same_body(one: TrackedTrial, other: TrackedTrial) -> bool:
    """Whether two recordings are tracked by the same body with the same markers and coordinates."""
    alike = one.markers == other.markers and np.array_equal(one.task.free, other.task.free)
    return alike and one.task.model == other.task.model


def _choose_step(item: TrackedTrial, tracked: Sequence[TrackedTrial], layout: Layout, block_s: float) -> int:
    """Every how many frames to look at; all together the products stay within bounds."""
    if layout.rough:
        shortest: int = min(rows.stop - rows.start for rows in item.blocks(block_s))
        return max(1, shortest // _ROUGH)
    numbers = sum(3 * len(each.q) * len(each.markers) for each in tracked)
    return 1 + int(numbers * len(layout.columns) / _MOST)


class _Products(NamedTuple):
    """Spots times profiles, each but once, by their numbers, and the columns as sums of these."""

    spot: NDArray[np.intp]
    profile: NDArray[np.intp]
    sums: csr_array  # (n_columns, n_products): gains

    @classmethod
    def of(cls, columns: Sequence[Column], spots: Sequence[Spot], profiles: Sequence[Profile]) -> _Products:
        """All that the parts of columns are."""
        at = {spot: k for k, spot in enumerate(spots)}
        of = {profile: k for k, profile in enumerate(profiles)}
        parts = [(k, part) for k, column in enumerate(columns) for part in column.parts]
        pairs = [(at[part.spot], of[part.profile]) for _, part in parts]
        number = {pair: k for k, pair in enumerate(dict.fromkeys(pairs))}
        places = [k for k, _ in parts], [number[pair] for pair in pairs]
        sums = csr_array(([part.gain for _, part in parts], places), shape=(len(columns), len(number)))
        spot, profile = np.array(list(number), dtype=np.intp).reshape(-1, 2).T
        return cls(spot, profile, sums)

    def of_columns(self, active: Sequence[bool], rough: bool) -> _Products:
        """With those columns that are there, roughly in single precision."""
        on = dia_array((np.array([active], dtype=float), [0]), shape=(len(active),) * 2)
        return self._replace(sums=csr_array(on @ self.sums).astype("f4" if rough else "f8"))

    def columns(self, generated: Array, values: Array) -> Array:
        """Columns (n_columns, n * rows) from generators (n_spots, n, rows) and profiles (n_profiles, n)."""
        made = generated[self.spot]
        made *= values[self.profile][:, :, None]
        return np.asarray(self.sums @ made.reshape(len(made), -1))


class _Freed(NamedTuple):
    """Spots and residuals of some frames, by floors, freed of the pose."""

    left: Array  # (n_spots, n, rows)
    hidden: Array  # (n_spots, n, q): what the pose takes of them, in single precision
    values: Array  # (n_profiles, n)
    residuals: Array  # (n, rows)
    square: Array  # (n,): of the residuals, before they were condensed
    numbers: Array  # (n,): how many the residuals are, the pose's taken off

    def cut(self, some: slice) -> _Freed:
        """Some of the frames."""
        left, hidden, values = self.left[:, some], self.hidden[:, some], self.values[:, some]
        return _Freed(left, hidden, values, self.residuals[some], self.square[some], self.numbers[some])


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Columns:
    """Columns of one trial, of generators (spots) and values (n_profiles, n) of profiles."""

    item: TrackedTrial
    generators: Generators
    products: _Products
    values: Array
    step: int  # every how many frames to look at
    sizes: Array | None = None  # (n_columns,): of which residuals are made, where they are not the trial's

    def strays(self, profiles: Sequence[Profile], layout: Layout) -> Iterator[_Columns]:
        """What noise makes of columns that oscillate with the motion, drawn a few times.

        The trial's residuals were freed of such columns of known sizes, hence of their noise, too. Else the
        pose leaves in them what has no part in itself, from which columns come. Without this what oscillates
        seems smaller and slower (corrected score of errors in variables: Nakamura 1990, Biometrika 77:127).
        """
        shaken = [k for k, profile in enumerate(profiles) if isinstance(profile, Oscillation)]
        sized = zip(layout.columns, layout.sizes.tolist(), strict=True)
        held = collect_oscillations((column, size) for column, size in sized if size)
        for other in make_steady_replicates(self.item, held):
            stray = np.zeros_like(self.values)
            stray[shaken] = evaluate_profiles([profiles[k] for k in shaken], other) - self.values[shaken]
            yield replace(self, values=stray, sizes=layout.sizes)

    @property
    def most(self) -> int:
        """How many frames to look at at once."""
        numbers = 3 * len(self.item.markers) * len(self.generators.variables)
        return int(np.clip(_SPOTS / numbers, *_FRAMES))

    def stretches(self, blocks: Iterable[slice]) -> list[list[NDArray[np.intp]]]:
        """The frames to look at of neighbouring blocks, of as many of these together as may be at once."""
        found: list[list[NDArray[np.intp]]] = [[]]
        for rows in blocks:
            frames = np.arange(rows.start, rows.stop, self.step)
            if found[-1] and sum(map(len, found[-1])) + len(frames) > self.most:
                found.append([])
            found[-1].append(frames)
        return found

    def blocks(self, stretch: Sequence[NDArray[np.intp]]) -> Iterator[Iterator[Chunk]]:
        """Of every block; the pose is taken out of a whole stretch at once, or of parts of a long block."""
        if len(stretch) > 1:
            free = self._free_of_pose(np.concatenate(stretch))
            edges = np.cumsum([0, *map(len, stretch)]).tolist()
            yield from (self._chunks(free.cut(slice(a, b))) for a, b in pairwise(edges))
        else:
            parts = (stretch[0][k : k + self.most] for k in range(0, len(stretch[0]), self.most))
            yield chain.from_iterable(self._chunks(self._free_of_pose(part)) for part in parts)

    def _free_of_pose(self, frames: NDArray[np.intp]) -> _Freed:
        """The pose is taken out of the spots: there are far fewer of them than of columns, their sums."""
        free = self.generators.free_of_pose(self.item, frames)
        square = np.square(free.residuals).sum(axis=1)
        numbers = 3.0 * self.item.seen[frames].sum(axis=1) - np.square(free.basis).sum(axis=(1, 2))
        free, digits = free.condense(), self.products.sums.dtype
        left = np.ascontiguousarray(np.moveaxis(free.columns, 1, 0), digits)
        hidden = np.ascontiguousarray(np.moveaxis(free.hidden, 1, 0), "f4")
        values: Array = self.values[:, frames].astype(digits)
        return _Freed(left, hidden, values, free.residuals.astype(digits), square, numbers)

    def _chunks(self, free: _Freed) -> Iterator[Chunk]:
        """Columns of a block's frames, so many at once."""
        exact, roughly = self.products, self.products._replace(sums=self.products.sums.astype("f4"))
        at_once = max(1, int(_CHUNK / (free.left.shape[2] * max(exact.sums.shape[0], 1))))
        for first in range(0, len(free.numbers), at_once):
            some = free.cut(slice(first, first + at_once))
            columns = exact.columns(some.left, some.values)
            taken = roughly.columns(some.hidden, some.values)
            hidden = np.einsum("kr,kr->k", taken, taken).astype(float)
            square, numbers = float(some.square.sum()), float(some.numbers.sum())
            residuals = some.residuals.ravel() if self.sizes is None else -(self.sizes @ columns)
            yield Chunk(columns, residuals, square, numbers, hidden)


def _compute_free_share(item: TrackedTrial) -> Array:
    """How many of a marker's three numbers the pose leaves free, (n, n_markers)."""
    generators = Generators.of(item, ())

    def of(rows: slice) -> Array:
        basis = span(generators.at(item, rows)[1])
        taken = np.square(basis).sum(axis=1).reshape(len(basis), -1, 3).sum(axis=2)
        return np.asarray(np.maximum(3.0 - taken, _LEAST_LEFT))

    return np.concatenate(map_parallel(of, item.chunks(_AT_ONCE)))


MARKERS = Markers()
