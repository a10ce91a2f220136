"""The columns that everything ordinary and every candidate is a sum of, by their numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.discovery.laws.candidates import Candidate
from scaling_service.capabilities.discovery.laws.profiles import Profile
from scaling_service.capabilities.discovery.laws.spots import Spot
from scaling_service.core.arrays import Array

_NEGLIGIBLE = 1e-12  # share of a covariance's largest direction


class Base:
    """Columns, each a spot of the body and how the value there varies, in the order of asking."""

    def __init__(self) -> None:
        self.columns: dict[tuple[Spot, Profile], int] = {}

    def __len__(self) -> int:
        return len(self.columns)

    def number(self, spot: Spot, profile: Profile = None) -> int:
        """Of a column, which is added where it is not there."""
        return self.columns.setdefault((spot, profile), len(self.columns))

    def number_axes(self, make: Callable[[int], Spot], profile: Profile = None) -> list[int]:
        """Of the columns of a spot along or about each axis."""
        return [self.number(make(axis), profile) for axis in range(3)]

    def include(self, candidate: Candidate) -> None:
        """Add what a candidate's numbers are coefficients of."""
        for part in candidate.parts:
            self.number(part.spot, part.profile)

    def expand(self, candidate: Candidate) -> Array:
        """A candidate's numbers as coefficients of all columns, (n_columns, k); they are among these."""
        found = np.zeros((len(self), len(candidate.columns)))
        for k, column in enumerate(candidate.columns):
            for part in column.parts:
                found[self.columns[part.spot, part.profile], k] += part.gain
        return found

    @property
    def spots(self) -> tuple[Spot, ...]:
        """All of them, once each."""
        return tuple(dict.fromkeys(spot for spot, _ in self.columns))

    @property
    def profiles(self) -> tuple[Profile, ...]:
        """All of them, once each."""
        return tuple(dict.fromkeys(profile for _, profile in self.columns))

    def index(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Of every column, the numbers of its spot and of its profile."""
        spots = {spot: k for k, spot in enumerate(self.spots)}
        profiles = {profile: k for k, profile in enumerate(self.profiles)}
        pairs = np.array([(spots[s], profiles[p]) for s, p in self.columns], dtype=np.intp).reshape(-1, 2)
        return pairs[:, 0], pairs[:, 1]


@dataclass(frozen=True, slots=True, eq=False)
class Direction:
    """Some independent numbers of unit variance, as coefficients of columns.

    ``level``: which level they have; ``place``: where they may be livelier than elsewhere.
    """

    rows: tuple[int, ...]
    factor: Array  # (len(rows), n)
    level: str = ""
    place: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """A covariance of coefficients, piece by piece."""

    directions: list[Direction] = field(default_factory=list)

    def add(self, rows: Iterable[int], covariance: Array, level: str = "", place: str = "") -> None:
        """Coefficients are Gaussian about zero."""
        self._keep(tuple(rows), factorise(covariance), level, place)

    def add_centred(
        self, rows: tuple[list[int], list[int]], mean: float, covariance: Array, level: str, place: str = ""
    ) -> None:
        """Slopes along a coordinate less its mean; ``rows``: of what follows it, and of the constants."""
        following, constant = rows
        factor = factorise(covariance)
        self._keep((*following, *constant), np.concatenate([factor, -mean * factor]), level, place)

    def _keep(self, rows: tuple[int, ...], factor: Array, level: str, place: str) -> None:
        self.directions.append(Direction(rows, factor, level, place))

    def expand(self, size: int, levels: Mapping[str, float], place: str = "") -> tuple[Array, list[str]]:
        """All directions, or those of a place, (size, n), and the level of each."""
        chosen = [d for d in self.directions if not place or d.place == place]
        owners = [d.level for d in chosen for _ in range(d.factor.shape[1])]
        found = np.zeros((size, len(owners)))
        at = 0
        for d in chosen:
            count = d.factor.shape[1]
            np.add.at(found[:, at : at + count], list(d.rows), levels.get(d.level, 1.0) * d.factor)
            at += count
        return found, owners


def factorise(covariance: Array) -> Array:
    """F with ``F F' = covariance``, without directions that do not vary."""
    values, vectors = np.linalg.eigh(covariance)
    kept = values > _NEGLIGIBLE * max(float(values.max()), np.finfo(float).tiny)
    return np.asarray(vectors[:, kept] * np.sqrt(values[kept]))
