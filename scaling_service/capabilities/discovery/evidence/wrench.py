"""The wrench on the ground as an observation: residuals and columns of loads, freed of noise in common."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.discovery.evidence.fit import Fit, fit_wrenches
from scaling_service.capabilities.discovery.evidence.markers import MARKERS
from scaling_service.capabilities.discovery.evidence.observation import Observation
from scaling_service.capabilities.discovery.evidence.sums import BlockSource, Chunk, Layout
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Estimate, Seen
from scaling_service.capabilities.discovery.laws.loads import compute_columns
from scaling_service.capabilities.discovery.observations.performed import perform_on_plates
from scaling_service.capabilities.discovery.observations.tracked import FEW_DRAWS, TrackedTrial
from scaling_service.capabilities.discovery.observations.wrench import COMPONENTS, WrenchFit
from scaling_service.core.threads import map_parallel
from scaling_service.numerics.multibody.laws import Array

_FEWEST = 5  # frames of a block; chosen: fewer say nothing of a block of half a second
_RATE = 4.0  # frames looked at per period of the filter; chosen: products of what passes it need two
_DRAWS = {False: FEW_DRAWS, True: 1}  # of noise, also roughly; chosen: its products' spread grows by 40 %


class Wrench(Observation[WrenchFit]):
    """The six components of the wrench; a place is a component."""

    name: Seen = "wrench"
    per_place = 1

    def items(self, fit: Fit) -> Sequence[WrenchFit]:
        """Trials with forces."""
        return fit.wrenches

    def places(self, _fit: Fit) -> tuple[str, ...]:
        """The components."""
        return COMPONENTS

    def sources(self, items: Sequence[WrenchFit], layout: Layout, block_s: float) -> list[BlockSource]:
        """Columns with what noise of the markers makes of them.

        Columns are made of the motion that leaves the residuals, so noise of the markers is in both, and its
        products do not vanish on average: a mass on a spring would seem to oscillate where nothing but
        cameras' noise is. Noise drawn once more estimates what they come to, which is taken off (corrected
        score of errors in variables: Nakamura 1990, Biometrika 77:127).
        """
        draws = _DRAWS[layout.rough]
        replicates = map_parallel(lambda item: list(item.noise_replicates(draws)), items)
        pairs = [(item, one) for item, some in zip(items, replicates, strict=True) for one in (item, *some)]
        made = iter(map_parallel(lambda pair: _whiten_columns(*pair, layout), pairs))
        sources = []
        for item in items:
            own = next(made)
            strays = [_White(*map(np.subtract, next(made), own)) for _ in range(draws)]
            weight = float(_thin(item))
            for used in _list_frames(item, block_s):
                block, *by_chance = (partial(one.block, used, weight) for one in (own, *strays))
                sources.append(BlockSource(item.name, item.role, block, by_chance))
        return sources

    def refit(self, fit: Fit, free: Sequence[Estimate], effects: Sequence[Estimate]) -> Fit:
        """The motion does not follow from forces and stays."""
        return fit_wrenches(replace(fit, free=tuple(free), effects=tuple(effects)))

    def residuals(self, fit: Fit) -> list[tuple[TrackedTrial, Array]]:
        """Measured minus needed, (n, 6), N and N m."""
        return [(w.tracked, np.where(w.usable[:, None], w.residuals, np.nan)) for w in fit.wrenches]

    def frames(self, _fit: Fit, item: WrenchFit, noise: Array | None) -> tuple[Array, Array, Array]:
        """Of the frames that count."""
        used = item.usable[:, None]
        floor = np.maximum(item.floor**2, np.zeros(len(COMPONENTS)) if noise is None else noise)
        square = np.where(used, np.square(item.residuals), 0.0)
        return square, np.where(used, floor, 0.0), np.broadcast_to(used, square.shape).astype(float)

    def series(self, fit: Fit, place: str) -> Iterator[tuple[TrackedTrial, Array, Array]]:
        """A component's residuals, (n, 1), N or N m."""
        at = [COMPONENTS.index(place)]
        for item in fit.wrenches:
            values = np.where(item.usable[:, None], item.residuals[:, at], np.nan)
            yield item.tracked, values, item.rated.q

    def perform(self, fit: Fit, movement: str) -> WrenchFit | None:
        """On plates under the feet of the first trial that has both."""
        made = (perform_on_plates(item, movement) for item in fit.wrenches)
        return next((item for item in made if item is not None), None)


class _White(NamedTuple):
    """Columns (n, 6, n_columns) and residuals (n, 6), in floors, in the frames that are looked at."""

    columns: Array
    residuals: Array

    def block(self, used: NDArray[np.intp], weight: float) -> list[list[Chunk]]:
        """Some of those frames; no pose is taken out."""
        columns, residuals = self.columns[used], self.residuals[used]
        flat = np.ascontiguousarray(columns.reshape(-1, columns.shape[2]).T)
        square = float(np.square(residuals).sum())
        return [[Chunk(flat, residuals.ravel(), square, float(residuals.size), weight=weight)]]


def _thin(item: WrenchFit) -> int:
    """Every how many frames to look at."""
    return max(1, int(item.tracked.trial.rate_hz / (_RATE * item.cutoff_hz)))


def _list_frames(item: WrenchFit, block_s: float) -> Iterator[NDArray[np.intp]]:
    """Of each block the frames that count, as numbers among those looked at."""
    thin = _thin(item)
    for rows in item.blocks(block_s):
        used = np.flatnonzero(item.usable[rows]) + rows.start
        if len(used) >= _FEWEST:
            yield used[used % thin == 0] // thin


def _whiten_columns(item: WrenchFit, replicate: WrenchFit, layout: Layout) -> _White:
    """Columns of a replicate, zero where there is no load, about its trunk's origin, by the item's floor."""
    on = layout.active_in(item.name)
    loads = [column.load if active else None for column, active in zip(layout.columns, on, strict=True)]
    known = {load: k for k, load in enumerate(dict.fromkeys(load for load in loads if load is not None))}
    raw = np.zeros((len(item.times), 6, len(known) + 1))
    raw[:, :, :-1] = compute_columns(list(known), replicate)
    thin = _thin(item)
    made, about = replicate.filter(raw)[::thin], replicate.about[::thin, None]
    made[:, 3:] -= np.cross(about, made[:, :3].transpose(0, 2, 1)).transpose(0, 2, 1)
    made /= item.floor[:, None]
    columns = made[:, :, [-1 if load is None else known[load] for load in loads]]
    return _White(columns, replicate.residuals[::thin] / item.floor)


WRENCH = Wrench()
OBSERVATIONS: tuple[Observation[Any], ...] = (MARKERS, WRENCH)
"""The motion first: forces have no part in it."""


def choose_observation(candidate: Candidate) -> Observation[Any]:
    """In which a candidate shows."""
    return next(o for o in OBSERVATIONS if o.shows(candidate))
