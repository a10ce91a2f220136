"""What an effect is to the search: at a place, some columns of unknown size; its estimate; its steps."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import Any, Literal, TypeVar

import numpy as np

from scaling_service.capabilities.discovery.laws.loads import Between, Wobbling
from scaling_service.capabilities.discovery.laws.profiles import ALWAYS, Oscillation, Profile
from scaling_service.capabilities.discovery.laws.spots import At, Spot
from scaling_service.capabilities.discovery.observations.wrench import Load
from scaling_service.model.body import Vector
from scaling_service.numerics.multibody.laws import Array

FREQUENCIES_HZ, DAMPINGS = (1.0, 30.0), (0.01, 0.9)
SHAPES = ("frequency_hz", "damping")
TRIED = tuple((f, z) for f in (3.0, 4.5, 6.5, 9.0, 13.0, 18.0) for z in (0.1, 0.3))
"""Frequencies (Hz) and damping ratios tried first; the best is tuned (chosen: from the slow sway of heavy
tissue to the quick one of a marker on thin skin, lightly and well damped)."""

_APART = 0.05  # of both numbers, for differences; chosen: far below what they are known to

LoadOf = TypeVar("LoadOf")

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
    """One unknown number of an effect."""

    name: str  # as the results call it: ``x_mm``
    unit: float  # the number in the results for a coefficient of one (SI, rad)
    _: KW_ONLY
    parts: tuple[Part, ...] = ()  # of the motion
    neutral: float = 0.0  # the number in the results where the effect is absent: 1 for a factor
    load: Load | None = None  # of the ground wrench, in place of parts
    low: float = -math.inf  # low, high: what is plausible, as in the results
    high: float = math.inf
    # the coefficient that physics gives, taken where the data do not speak clearly against it
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

        def tune(source: Any) -> Any:
            if isinstance(source, Oscillation | Wobbling):
                return replace(source, frequency_hz=frequency_hz, damping=damping)
            return source

        parts = tuple(replace(part, profile=tune(part.profile)) for part in self.parts)
        return replace(self, parts=parts, load=tune(self.load))


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


@dataclass(frozen=True, slots=True)
class Contact:
    """An unmeasured contact from one time to another (s), at a point of a segment (m, in its frame)."""

    segment: str
    start_s: float
    end_s: float
    point: Vector


@dataclass(frozen=True, slots=True)
class Reweighed:
    """The whole body heavier or lighter, in proportion."""

    factor: float  # true over declared mass
    sd: float
    of_trials: tuple[tuple[str, float], ...] = ()  # where recordings disagree: trial to its own factor

    def factor_in(self, trial: str) -> float:
        """What the plates of one recording bear over the declared mass."""
        return dict(self.of_trials).get(trial, self.factor)


@dataclass(frozen=True, slots=True)
class Masked:
    """A marker that is left out, for it moves independently."""

    marker: str


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
    change: FreeMotion | Exchange | Contact | Reweighed | Masked | None = None
    # whether coefficients, each in its range, are plausible together
    together: Callable[[Array], bool] | None = field(default=None, compare=False)

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
        loaded = isinstance(self.change, Contact | Reweighed) or any(c.load is not None for c in self.columns)
        return "wrench" if loaded else "markers"

    @property
    def oscillation(self) -> tuple[float, float] | None:
        """Frequency (Hz) and damping ratio of what oscillates; None where nothing does."""
        found = next((source for column in self.columns for source in column.oscillators), None)
        return None if found is None else (found.frequency_hz, found.damping)

    def at(self, frequency_hz: float, damping: float) -> Candidate:
        """The same oscillating at another frequency and damping."""
        columns = tuple(column.at(frequency_hz, damping) for column in self.columns)
        return replace(self, columns=columns, note=describe_oscillation(frequency_hz, damping))

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


def with_shape_columns(effect: Estimate) -> Candidate:
    """An effect's candidate, for an oscillation with the two numbers that shape it as further columns."""
    pair = effect.candidate.oscillation
    if pair is None or not effect.size.any():
        return effect.candidate
    slopes = (_differentiate_shape(effect, pair, k) for k in range(len(SHAPES)))
    return replace(effect.candidate, columns=(*effect.candidate.columns, *slopes))


def step_shape(effect: Estimate, step: Array) -> Estimate:
    """An effect after a step of all columns of :func:`with_shape_columns`."""
    count = len(effect.size)
    moved = replace(effect, size=effect.size + step[:count])
    if len(step) == count or effect.candidate.oscillation is None:
        return moved
    frequency, damping = np.array(effect.candidate.oscillation) + step[count:]
    place = (float(np.clip(frequency, *FREQUENCIES_HZ)), float(np.clip(damping, *DAMPINGS)))
    return replace(moved, candidate=effect.candidate.at(*place))


def _differentiate_shape(effect: Estimate, pair: tuple[float, float], k: int) -> Column:
    """How the effect changes with its frequency (k = 0) or damping (k = 1)."""
    step = _APART * pair[k]
    ends = []
    for sign in (1.0, -1.0):
        moved = list(pair)
        moved[k] += sign * step
        ends.append(effect.candidate.columns[0].at(moved[0], moved[1]))
    high, low = ends
    factor = float(effect.size[0]) / (2.0 * step)
    load = None
    if isinstance(high.load, Wobbling) and isinstance(low.load, Wobbling):
        load = Between(high.load, low.load, factor)
    up = tuple(replace(part, gain=factor * part.gain) for part in high.parts)
    down = tuple(replace(part, gain=-factor * part.gain) for part in low.parts)
    return Column(name=SHAPES[k], unit=1.0, parts=(*up, *down), load=load)
