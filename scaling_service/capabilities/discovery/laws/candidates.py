"""What an effect is to the search: at a place, some columns of unknown size; its estimate; its steps."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import Literal, TypeVar

from scaling_service.capabilities.discovery.laws.loads import Wobbling
from scaling_service.capabilities.discovery.laws.profiles import Profile
from scaling_service.capabilities.discovery.laws.spots import At, Spot
from scaling_service.capabilities.discovery.observations.wrench import Load
from scaling_service.core.arrays import Array
from scaling_service.model.body import Vector

FREQUENCIES_HZ, DAMPINGS = (1.0, 30.0), (0.01, 0.9)
SHAPES = ("frequency_hz", "damping")
TRIED = tuple((f, z) for f in (3.0, 4.5, 6.5, 9.0, 13.0, 18.0) for z in (0.1, 0.3))
"""Frequencies (Hz) and damping ratios tried first; the best is tuned (chosen: from the slow sway of heavy
tissue to the quick one of a marker on thin skin, lightly and well damped)."""


LoadOf = TypeVar("LoadOf")

Seen = Literal["markers", "wrench"]
"""What a candidate shows in."""


@dataclass(frozen=True, slots=True)
class Part:
    """A spot that moves by ``gain`` times the profile for every unit of its column's coefficient."""

    spot: Spot
    profile: Profile = None
    gain: float = 1.0


@dataclass(frozen=True, slots=True)
class Column:
    """One unknown number of an effect."""

    name: str  # as the results call it: ``x_mm``
    unit: float  # the number in the results for a coefficient of one (SI, rad)
    _: KW_ONLY
    parts: tuple[Part, ...] = ()  # of the motion
    neutral: float = 0.0  # the number in the results where the effect is absent: 1 for a factor
    load: Load | None = None  # of the ground wrench, in place of parts
    low: float = -math.inf  # low, high: 95 of 100, as in the results, where ``effect_sizes.yaml`` has none
    high: float = math.inf


@dataclass(frozen=True, slots=True)
class FreeMotion:
    """A turn or shift that takes any value in any frame: a degree of freedom that the model locks."""

    segment: str
    at: At  # in the parent's frame; before or after the joint's own turns
    kind: Literal["rotation", "translation"]
    axis: Vector  # (3,): unit vector in the frame there


@dataclass(frozen=True, slots=True)
class Exchange:
    """Two labels exchanged from one time to another (s, both included)."""

    first: str
    second: str
    start_s: float
    end_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Contact:
    """An unmeasured contact from one time to another (s), at a point of a segment (m, in its frame)."""

    segment: str
    start_s: float
    end_s: float
    point: Vector
    noise: tuple[float, ...]  # (6,): what was ordinary of each component, N and N m


@dataclass(frozen=True, slots=True)
class Reweighed:
    """The whole body heavier or lighter, in proportion."""

    factor: float  # true over declared mass
    sd: float
    of_trials: tuple[tuple[str, float], ...] = ()  # where recordings disagree: trial to its own factor
    of_model: float = 1.0  # declared mass over that of the model's segments together

    def factor_in(self, trial: str) -> float:
        """What the plates of one recording bear over what the model weighs."""
        return self.of_model * dict(self.of_trials).get(trial, self.factor)


@dataclass(frozen=True, slots=True)
class Swinging:
    """Markers whose skin swings together when their segment accelerates."""

    markers: tuple[str, ...]
    frequency_hz: float
    damping: float


@dataclass(frozen=True, slots=True)
class Candidate:
    """An effect at a place."""

    kind: str  # the catalogue's name
    where: tuple[str, ...]  # markers, segments, joints or plates
    columns: tuple[Column, ...]
    _: KW_ONLY
    driver: tuple[str, ...] = ()  # the coordinates that it follows
    trials: tuple[str, ...] = ()  # those in which it is; all of them unless given
    note: str = ""  # what a person should know of this one: the frequency it was tried at
    # for what is not a sum of columns
    change: FreeMotion | Exchange | Contact | Reweighed | Swinging | None = None
    # whether coefficients (SI) are such as a laboratory could meet together
    together: Callable[[Array], bool] | None = field(default=None, compare=False)

    def holds_in(self, trial: str) -> bool:
        """Whether it is in a trial."""
        return not self.trials or trial in self.trials

    @property
    def parts(self) -> tuple[Part, ...]:
        """Of all columns."""
        return tuple(part for column in self.columns for part in column.parts)

    @property
    def follows(self) -> bool:
        """Whether any of it follows a coordinate."""
        return any(part.profile is not None for part in self.parts)

    @property
    def seen_in(self) -> Seen:
        """Whether it shows in the ground wrench or among the markers."""
        loaded = isinstance(self.change, Contact | Reweighed) or any(c.load is not None for c in self.columns)
        return "wrench" if loaded else "markers"

    @property
    def oscillation(self) -> tuple[float, float] | None:
        """Frequency (Hz) and damping ratio of what oscillates; None where nothing does."""
        if isinstance(self.change, Swinging):
            return self.change.frequency_hz, self.change.damping
        loads = (column.load for column in self.columns)
        found = next((load for load in loads if isinstance(load, Wobbling)), None)
        return None if found is None else (found.frequency_hz, found.damping)

    @property
    def name(self) -> str:
        """Short and unique in one search."""
        driven = f" by {', '.join(self.driver)}" if self.driver else ""
        only = f" in {', '.join(self.trials)}" if self.trials else ""
        said = f" ({self.note})" if self.note else ""
        return f"{self.kind} at {', '.join(self.where)}{driven}{only}{said}"

    @property
    def key(self) -> str:
        """The name, whatever the frequency and damping of an oscillation."""
        return self.name if self.oscillation is None else replace(self, note="").name


def describe_oscillation(frequency_hz: float, damping: float) -> str:
    """A frequency and damping ratio as a candidate's note."""
    return f"{frequency_hz:.3g} Hz, damping {damping:.2g}"


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """A candidate with a value for each of its columns (SI)."""

    candidate: Candidate
    size: Array

    @property
    def columns(self) -> tuple[tuple[Column, float], ...]:
        """Columns with their values."""
        return tuple(zip(self.candidate.columns, self.size.tolist(), strict=True))


def list_loads(estimates: Iterable[Estimate], kind: type[LoadOf]) -> Iterator[tuple[LoadOf, float]]:
    """Loads of a kind with their sizes."""
    for estimate in estimates:
        for column, size in estimate.columns:
            if isinstance(column.load, kind):
                yield column.load, size
