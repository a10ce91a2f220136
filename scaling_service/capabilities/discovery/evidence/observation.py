"""An observation: what recordings show, as markers or as the wrench on the ground.

Whatever differs between the two is a method here; the search is written once.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Generic, TypeVar

import numpy as np

from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.evidence.sums import BlockSource, Evidence, Layout
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Estimate, Seen
from scaling_service.capabilities.discovery.observations.tracked import Role, TrackedTrial
from scaling_service.capabilities.discovery.observations.wrench import WrenchFit
from scaling_service.core.threads import map_parallel
from scaling_service.numerics.multibody.laws import Array

Item = TypeVar("Item", TrackedTrial, WrenchFit)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Tally:
    """Squares of residuals and of their floors: places of one observation against blocks of time."""

    places: tuple[str, ...]
    square: Array  # (n_blocks, n_places): sum over frames of the squared residual (m2, N2 or N2 m2)
    floor: Array  # (n_blocks, n_places): what noise alone would leave of it
    frames: Array  # (n_blocks, n_places)
    trials: tuple[str, ...]
    starts: tuple[float, ...]  # when each begins, s


class Observation(ABC, Generic[Item]):
    """Markers, or the wrench on the ground."""

    name: Seen
    per_place: int
    """How many numbers a place has in a frame."""

    @abstractmethod
    def items(self, fit: Fit) -> Sequence[Item]:
        """The trials of a fit that show it."""

    @abstractmethod
    def places(self, fit: Fit) -> tuple[str, ...]:
        """What is observed: markers, or components."""

    @abstractmethod
    def sources(self, items: Sequence[Item], layout: Layout, block_s: float) -> list[BlockSource]:
        """All blocks of time of all recordings, with the columns of a layout."""

    def gather(
        self,
        items: Sequence[Item],
        nuisances: Sequence[Candidate],
        candidates: Sequence[Candidate],
        block_s: float,
        *,
        together: bool,
        rough: bool = False,
        known: Sequence[Estimate] = (),
    ) -> Evidence:
        """Pass all recordings once, in blocks of a length (s).

        ``nuisances`` may take any value anyhow, ``candidates`` are looked at; ``together``: whether products
        of different candidates are wanted; ``rough``: whether it only tells which deserve a closer look;
        ``known``: what the residuals were freed of, where sums without what noise makes of it are wanted.
        """
        layout = Layout.of(nuisances, candidates, together=together, rough=rough, known=known)
        found = map_parallel(lambda source: source.add_up(layout), self.sources(items, layout, block_s))
        sums = list(chain.from_iterable(found))
        raw = sum((squares for _, squares in sums), np.zeros(len(layout.columns)))
        return Evidence(tuple(block for block, _ in sums), raw, layout.nuisances, layout.groups)

    @abstractmethod
    def refit(self, fit: Fit, free: Sequence[Estimate], effects: Sequence[Estimate]) -> Fit:
        """The recordings with other estimates, of which only those that show in this observation differ."""

    @abstractmethod
    def residuals(self, fit: Fit) -> list[tuple[TrackedTrial, Array]]:
        """Of every trial, (n, n_places * per_place); NaN where not known."""

    @abstractmethod
    def frames(self, fit: Fit, item: Item, noise: Array | None) -> tuple[Array, Array, Array]:
        """Squares of residuals, of their floors, and whether there are any, each (n, n_places).

        ``noise``: mean square of noise with memory, (n_places,); that of the instrument alone without.
        """

    @abstractmethod
    def series(self, fit: Fit, place: str) -> Iterator[tuple[TrackedTrial, Array, Array]]:
        """Of every trial: residuals of a place (n, 1 or 3), NaN where not known, and coordinates (n, any)."""

    @abstractmethod
    def perform(self, fit: Fit, movement: str) -> Item | None:
        """What another movement of the same body would show; None where it has none of its coordinates."""

    def shows(self, candidate: Candidate) -> bool:
        """Whether a candidate is one of this observation."""
        return candidate.seen_in == self.name

    def list_known(self, fit: Fit) -> list[Estimate]:
        """What is free or named already and is a sum of columns of this observation."""
        return [s for s in fit.estimates if s.candidate.columns and self.shows(s.candidate)]

    def gather_beside(
        self, fit: Fit, candidates: Sequence[Candidate], *, together: bool, rough: bool = False
    ) -> Evidence:
        """Candidates beside all that is known of their sort."""
        fit.context.advance()
        known = [s.candidate for s in self.list_known(fit)]
        items, block_s = self.items(fit), fit.settings.block_s
        return self.gather(items, known, candidates, block_s, together=together, rough=rough)

    def squares(self, fit: Fit, of: Sequence[Candidate] = ()) -> float:
        """Whitened sum of squares in the trials to fit, and in all trials of candidates in none of them."""
        items = self.items(fit)
        fitting = {item.name for item in items if item.role == "fit"}
        alone = {
            trial for candidate in of if not fitting & set(candidate.trials) for trial in candidate.trials
        }
        deciding = [item for item in items if item.name in fitting | alone]
        return float(sum(map_parallel(lambda item: item.square, deciding)))

    def above_noise(self, fit: Fit) -> float:
        """Whitened squares in the trials to fit, without those of noise."""
        return sum(item.square - item.freedom for item in self.items(fit) if item.role == "fit")

    def tally(self, fit: Fit, role: Role | None, noise: Mapping[str, Array] | None = None) -> Tally | None:
        """Of all places, over the trials of a role; None where nothing is observed.

        ``noise``: trial to the mean square of noise with memory, place by place.
        """
        rows, trials, starts = [], [], []
        for item in self.items(fit):
            if role is None or item.role == role:
                frames = self.frames(fit, item, None if noise is None else np.nan_to_num(noise[item.name]))
                for part in item.blocks(fit.settings.block_s):
                    row = np.array([values[part].sum(axis=0) for values in frames])
                    if row[2].any():
                        rows.append(row)
                        trials.append(item.name)
                        starts.append(float(item.times[part.start]))
        if not rows:
            return None
        table = np.array(rows)
        return Tally(
            places=self.places(fit),
            square=table[:, 0],
            floor=table[:, 1],
            frames=table[:, 2],
            trials=tuple(trials),
            starts=tuple(starts),
        )
