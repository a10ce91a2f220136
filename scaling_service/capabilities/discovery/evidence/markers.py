"""Markers as an observation: residuals and columns of every frame, freed of the pose."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.discovery.evidence.fit import Fit, fit_recordings
from scaling_service.capabilities.discovery.evidence.observation import Observation
from scaling_service.capabilities.discovery.evidence.sums import BlockSource, Chunk, Layout
from scaling_service.capabilities.discovery.laws.candidates import Column, Estimate, Seen
from scaling_service.capabilities.discovery.laws.profiles import Profile, values_of
from scaling_service.capabilities.discovery.laws.spots import Generators, Spot
from scaling_service.capabilities.discovery.observations.performed import performed
from scaling_service.capabilities.discovery.observations.tracked import TrackedTrial, span
from scaling_service.numerics.multibody.laws import Array

_CHUNK, _FRAMES = 5e5, 48  # numbers of all columns at once: 4 MB, and frames of their spots (chosen)
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
        table = _Parts.of(layout.columns, spots, profiles)
        known: list[tuple[TrackedTrial, Generators]] = []
        sources = []
        for item in items:
            generators = next((g for other, g in known if _same_body(item, other)), None)
            if generators is None:
                generators = Generators.of(item, spots)
                known.append((item, generators))
            on = np.array(layout.active_in(item.name), dtype=float)
            here = table._replace(gain=table.gain * on[table.column])
            step = _step(item, items, layout, block_s)
            made = _Columns(item, generators, len(on), here, values_of(profiles, item), step, layout.rough)
            sources += [
                BlockSource(item.name, item.role, partial(made.chunks, rows)) for rows in item.blocks(block_s)
            ]
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
        floor = np.where(item.seen, np.maximum(_left(item) * item.noise**2, slow), 0.0)
        square = np.nan_to_num(np.square(item.residuals).sum(axis=2))
        wide = np.zeros((3, len(item.q), len(names)))
        wide[:, :, at] = square, floor, item.seen
        return wide[0], wide[1], wide[2]

    def series(self, fit: Fit, place: str) -> Iterator[tuple[TrackedTrial, Array, Array]]:
        """A marker's residuals, (n, 3), m."""
        for item in fit.tracked:
            if place in item.markers:
                yield item, item.residuals[:, item.markers.index(place)], item.q

    def performed(self, fit: Fit, movement: str) -> TrackedTrial | None:
        """By the markers of the first trial."""
        return performed(fit.tracked[0], movement)


def _same_body(one: TrackedTrial, other: TrackedTrial) -> bool:
    """Whether two recordings are tracked by the same body with the same markers and coordinates."""
    alike = one.markers == other.markers and np.array_equal(one.task.free, other.task.free)
    return alike and one.task.model == other.task.model


def _step(item: TrackedTrial, tracked: Sequence[TrackedTrial], layout: Layout, block_s: float) -> int:
    """Every how many frames to look at; all together the products stay within bounds."""
    if layout.rough:
        shortest: int = min(rows.stop - rows.start for rows in item.blocks(block_s))
        return max(1, shortest // _ROUGH)
    numbers = sum(3 * len(each.q) * len(each.markers) for each in tracked)
    return 1 + int(numbers * len(layout.columns) / _MOST)


class _Parts(NamedTuple):
    """The parts of all columns, column by column, as arrays of one length.

    In ``turns`` are the numbers of the first part of every column, of the second of those that have one, and
    so on.
    """

    column: NDArray[np.intp]
    spot: NDArray[np.intp]
    profile: NDArray[np.intp]
    gain: Array
    turns: tuple[NDArray[np.intp], ...]

    @classmethod
    def of(cls, columns: Sequence[Column], spots: Sequence[Spot], profiles: Sequence[Profile]) -> _Parts:
        """With spots and profiles as their numbers."""
        at = {spot: k for k, spot in enumerate(spots)}
        of = {profile: k for k, profile in enumerate(profiles)}
        every = [(k, part) for k, column in enumerate(columns) for part in column.parts]
        numbers = np.array([(k, at[part.spot], of[part.profile]) for k, part in every], dtype=np.intp)
        column, spot, profile = numbers.reshape(-1, 3).T
        gain = np.array([part.gain for _, part in every])
        place = np.arange(len(column)) - np.searchsorted(column, column)
        turns = tuple(np.flatnonzero(place == k) for k in range(int(place.max(initial=-1)) + 1))
        return cls(column, spot, profile, gain, turns)


@dataclass(frozen=True, slots=True, eq=False)
class _Columns:
    """Columns of one trial, of generators (spots) and values (n_profiles, n) of profiles."""

    item: TrackedTrial
    generators: Generators
    count: int  # of the columns
    parts: _Parts
    values: Array
    step: int  # every how many frames to look at
    rough: bool  # whether single precision will do

    def chunks(self, rows: slice) -> Iterator[Chunk]:
        """Of one block.

        The pose is taken out of the spots: there are far fewer of them than of columns, which are their sums.
        """
        for start in range(rows.start, rows.stop, self.step * _FRAMES):
            frames = slice(start, min(start + self.step * _FRAMES, rows.stop), self.step)
            free = self.generators.freed(self.item, frames)
            square = np.square(free.residuals).sum(axis=1)
            numbers = 3.0 * self.item.seen[frames].sum(axis=1) - np.square(free.basis).sum(axis=(1, 2))
            free, digits = free.condensed(), "f4" if self.rough else "f8"
            left, hidden = (
                np.asarray(np.ascontiguousarray(np.moveaxis(a, 2, 0), digits))
                for a in (free.columns, free.hidden)
            )
            residuals: Array = free.residuals.astype(digits)
            values: Array = self.values[:, frames].astype(digits)
            at_once = max(1, int(_CHUNK / (left.shape[2] * max(self.count, 1))))
            for first in range(0, len(numbers), at_once):
                some = slice(first, first + at_once)
                columns = self._of(left[:, some], values[:, some])
                raw = _squares(columns) + _squares(self._of(hidden[:, some], values[:, some]))
                counts = float(square[some].sum()), float(numbers[some].sum())
                yield Chunk(columns, residuals[some].ravel(), raw, *counts)

    def _of(self, generated: Array, values: Array) -> Array:
        """Columns (n_columns, n * rows) from generators (n_spots, n, rows) and profiles (n_profiles, n)."""
        parts, made = self.parts, np.zeros((self.count, *generated.shape[1:]), generated.dtype)
        for k, turn in enumerate(parts.turns):
            part = generated[parts.spot[turn]]
            gains = values[parts.profile[turn]] * parts.gain[turn, None].astype(values.dtype)
            part *= gains[:, :, None]
            if k == 0 and len(turn) == self.count:
                made = part
            else:
                made[parts.column[turn]] += part
        return made.reshape(self.count, -1)


def _squares(columns: Array) -> Array:
    return np.asarray(np.einsum("kr,kr->k", columns, columns))


def _left(item: TrackedTrial) -> Array:
    """How many of a marker's three numbers the pose leaves free, (n, n_markers)."""
    generators, left = Generators.of(item, ()), np.empty((len(item.q), len(item.markers)))
    for rows in item.chunks(_AT_ONCE):
        basis = span(generators.at(item, rows)[1])
        taken = np.square(basis).sum(axis=2).reshape(len(basis), -1, 3).sum(axis=2)
        left[rows] = np.maximum(3.0 - taken, _LEAST_LEFT)
    return left


MARKERS = Markers()
