"""What an effect is to the search: at a place, some columns of unknown size; and its estimate."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeVar

from scaling_service.capabilities.discovery.laws.loads import Wobbling
from scaling_service.capabilities.discovery.laws.profiles import ALWAYS, Oscillation, Profile
from scaling_service.capabilities.discovery.laws.spots import At, Spot
from scaling_service.capabilities.discovery.observations.wrench import Load
from scaling_service.model.body import Vector
from scaling_service.numerics.multibody.laws import Array

Seen = Literal["markers", "wrench"]
"""What a candidate shows in."""


@dataclass(frozen=True, slots=True)
class Part:
    """A spot that moves by ``gain`` times the profile for every unit of its column's coefficient."""

    spot: Spot
    profile: Profile = ALWAYS
    gain: float = 1.0


@dataclass(frozen=True, slots=True)
class Column:
    """One unknown number of an effect.

    Parameters
    ----------
    name : str
        As the results call it: ``x_mm``.
    unit : float
        The number in the results for a coefficient of one (SI, rad).
    parts : tuple of Part
        Of the motion.
    neutral : float
        The number in the results where the effect is absent: 1 for a factor.
    load : Load, optional
        Of the ground wrench, in place of parts.
    low, high : float
        What is plausible, as in the results.
    natural : float, optional
        The coefficient that physics gives, taken where the data do not speak clearly against it.
    """

    name: str
    unit: float
    parts: tuple[Part, ...] = ()
    neutral: float = 0.0
    load: Load | None = None
    low: float = -math.inf
    high: float = math.inf
    natural: float | None = None

    def plausible(self, size: float) -> bool:
        """Whether a coefficient (SI) is one that a laboratory could meet."""
        return self.low <= self.neutral + self.unit * size <= self.high

    @property
    def oscillators(self) -> Iterator[Oscillation | Wobbling]:
        """What of it oscillates."""
        for source in (self.load, *(part.profile for part in self.parts)):
            if isinstance(source, Oscillation | Wobbling):
                yield source

    def at(self, frequency_hz: float, damping: float) -> Column:
        """The same with what oscillates at another frequency and damping."""

        def tuned(source: Any) -> Any:
            if isinstance(source, Oscillation | Wobbling):
                return replace(source, frequency_hz=frequency_hz, damping=damping)
            return source

        parts = tuple(replace(part, profile=tuned(part.profile)) for part in self.parts)
        return replace(self, parts=parts, load=tuned(self.load))


@dataclass(frozen=True, slots=True)
class FreeMotion:
    """A turn or shift that takes any value in any frame: a degree of freedom that the model locks.

    Parameters
    ----------
    at : 'start', 'before' or 'after'
        In the parent's frame; before or after the joint's own turns.
    axis : (3,)
        Unit vector in the frame there.
    """

    segment: str
    at: At
    kind: Literal["rotation", "translation"]
    axis: Vector


@dataclass(frozen=True, slots=True)
class Exchange:
    """Two labels exchanged from one time to another (s, both included)."""

    first: str
    second: str
    start_s: float
    end_s: float


@dataclass(frozen=True, slots=True)
class Contact:
    """An unmeasured contact from one time to another (s), at a point of a segment (m, in its frame)."""

    segment: str
    start_s: float
    end_s: float
    point: Vector


@dataclass(frozen=True, slots=True)
class Masked:
    """A marker that is left out, for it goes its own way."""

    marker: str


@dataclass(frozen=True, slots=True)
class Candidate:
    """An effect at a place.

    Parameters
    ----------
    kind : str
        The catalogue's name.
    where : tuple of str
        Markers, segments, joints or plates.
    driver : tuple of str
        The coordinates that it follows.
    trials : tuple of str
        Those in which it is; all of them unless given.
    note : str
        What a person should know of this one: the frequency it was tried at.
    change : FreeMotion, Exchange, Contact or Masked, optional
        For what is not a sum of columns.
    together : callable, optional
        Whether coefficients, each in its range, are plausible together.
    """

    kind: str
    where: tuple[str, ...]
    columns: tuple[Column, ...]
    driver: tuple[str, ...] = ()
    trials: tuple[str, ...] = ()
    note: str = ""
    change: FreeMotion | Exchange | Contact | Masked | None = None
    together: Callable[[Array], bool] | None = None

    def holds_in(self, trial: str) -> bool:
        """Whether it is in a trial."""
        return not self.trials or trial in self.trials

    def plausible(self, size: Array) -> bool:
        """Whether coefficients (SI) are such as a laboratory could meet, each and together."""
        each = all(c.plausible(value) for c, value in zip(self.columns, size.tolist(), strict=True))
        return each and (self.together is None or self.together(size))

    @property
    def seen_in(self) -> Seen:
        """Whether it shows in the ground wrench or among the markers."""
        loaded = isinstance(self.change, Contact) or any(c.load is not None for c in self.columns)
        return "wrench" if loaded else "markers"

    @property
    def oscillation(self) -> tuple[float, float] | None:
        """Frequency (Hz) and damping ratio of what oscillates; None where nothing does."""
        found = next((source for column in self.columns for source in column.oscillators), None)
        return None if found is None else (found.frequency_hz, found.damping)

    def at(self, frequency_hz: float, damping: float) -> Candidate:
        """The same oscillating at another frequency and damping."""
        columns = tuple(column.at(frequency_hz, damping) for column in self.columns)
        return replace(self, columns=columns, note=oscillating_at(frequency_hz, damping))

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


def oscillating_at(frequency_hz: float, damping: float) -> str:
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


def loads_of(estimates: Iterable[Estimate], kind: type[LoadOf]) -> Iterator[tuple[LoadOf, float]]:
    """Loads of a kind with their sizes."""
    for estimate in estimates:
        for column, size in estimate.columns:
            if isinstance(column.load, kind):
                yield column.load, size


LoadOf = TypeVar("LoadOf")
