"""What an effect is to the search: at a place, some columns of unknown size."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

from scaling_service.capabilities.discovery.evidence.spots import At, Spot
from scaling_service.capabilities.discovery.laws.loads import Load, Wobbling
from scaling_service.capabilities.discovery.laws.profiles import ALWAYS, Profile, Swing
from scaling_service.model.body import Vector


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


@dataclass(frozen=True, slots=True)
class FreeMotion:
    """A turn or shift that takes any value in any frame: a degree of freedom that the model locks.

    Parameters
    ----------
    segment : str
    at : 'start', 'before' or 'after'
        In the parent's frame; before or after the joint's own turns.
    kind : 'rotation' or 'translation'
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
    columns : tuple of Column
    driver : tuple of str
        The coordinates that it follows.
    trials : tuple of str
        Those in which it is; all of them unless given.
    note : str
        What a person should know of this one: the frequency it was tried at.
    change : FreeMotion, Exchange, Contact or Masked, optional
        For what is not a sum of columns.
    """

    kind: str
    where: tuple[str, ...]
    columns: tuple[Column, ...]
    driver: tuple[str, ...] = ()
    trials: tuple[str, ...] = ()
    note: str = ""
    change: FreeMotion | Exchange | Contact | Masked | None = None

    def holds_in(self, trial: str) -> bool:
        """Whether it is in a trial."""
        return not self.trials or trial in self.trials

    @property
    def of_forces(self) -> bool:
        """Whether it shows in the ground wrench rather than among the markers."""
        return isinstance(self.change, Contact) or any(c.load is not None for c in self.columns)

    @property
    def swing(self) -> tuple[float, float] | None:
        """Frequency (Hz) and damping ratio of what swings; None where nothing does."""
        for column in self.columns:
            for source in (column.load, *(part.profile for part in column.parts)):
                if isinstance(source, Swing | Wobbling):
                    return source.frequency_hz, source.damping
        return None

    @property
    def name(self) -> str:
        """Short and unique in one search."""
        driven = f" by {', '.join(self.driver)}" if self.driver else ""
        only = f" in {', '.join(self.trials)}" if self.trials else ""
        said = f" ({self.note})" if self.note else ""
        return f"{self.kind} at {', '.join(self.where)}{driven}{only}{said}"

    @property
    def key(self) -> str:
        """The name, whatever the frequency and damping of a swing."""
        return self.name if self.swing is None else replace(self, note="").name
