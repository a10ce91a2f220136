"""What an unknown number does to the disagreement of the ground wrench.

The disagreement is what the plates measured minus what the motion needs. Each load gives its derivative
with respect to one number: force (N) and moment about the ground origin (N m), in every frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from scaling_service.capabilities.discovery.laws.oscillator import oscillate
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.wrench.ground_wrench import GRAVITY

if TYPE_CHECKING:
    from scaling_service.capabilities.discovery.evidence.weighed import Weighed

_UNIT = np.eye(3)
_LOADED_N = 20.0  # chosen: above any plate's noise, below any foot's weight


@dataclass(frozen=True, slots=True)
class Late:
    """The forces come late: seconds. ``measured(t) = true(t - d)``."""

    def column(self, weighed: Weighed) -> Array:
        """Minus the rate of the measured wrench, (n, 6)."""
        return -np.gradient(weighed.measured, weighed.times, axis=0)


@dataclass(frozen=True, slots=True)
class Drifting:
    """The forces come later and later: seconds each second of a trial."""

    def column(self, weighed: Weighed) -> Array:
        """Minus the rate of the measured wrench, more with time, (n, 6)."""
        return np.asarray((weighed.times - weighed.times[0])[:, None] * Late().column(weighed))


@dataclass(frozen=True, slots=True)
class PlateShift:
    """A plate lies elsewhere: m along a ground axis."""

    plate: str
    axis: int

    def column(self, weighed: Weighed) -> Array:
        """Its forces act elsewhere than was taken, (n, 6)."""
        force = weighed.plate(self.plate)[:, :3]
        return np.concatenate([np.zeros_like(force), -np.cross(_UNIT[self.axis], force)], axis=1)


@dataclass(frozen=True, slots=True)
class PlateBias:
    """Something constant is added to a plate's readings: N along an axis, N m about one through its middle.

    Nothing is added to zeros that an export puts where the plate is not loaded.
    """

    plate: str
    component: int

    def column(self, weighed: Weighed) -> Array:
        """One component wherever the plate is read, (n, 6)."""
        wrench = np.zeros(6)
        wrench[self.component] = 1.0
        if self.component < 3:
            wrench[3:] = np.cross(weighed.centre(self.plate), _UNIT[self.component])
        return np.outer(weighed.readings(self.plate), wrench)


@dataclass(frozen=True, slots=True)
class PlateGain:
    """A plate measures a multiple: measured over true, less one."""

    plate: str

    def column(self, weighed: Weighed) -> Array:
        """The plate's own wrench, (n, 6)."""
        return weighed.plate(self.plate)


@dataclass(frozen=True, slots=True)
class PlateTurn:
    """A plate is turned about an axis through its middle: rad, true minus taken."""

    plate: str
    axis: int

    def column(self, weighed: Weighed) -> Array:
        """Minus what turning its wrench would add, (n, 6)."""
        wrench, centre = weighed.plate(self.plate), weighed.centre(self.plate)
        about = wrench[:, 3:] - np.cross(centre, wrench[:, :3])
        turned = -np.cross(_UNIT[self.axis], wrench[:, :3])
        moment = np.cross(centre, turned) - np.cross(_UNIT[self.axis], about)
        return np.concatenate([turned, moment], axis=1)


@dataclass(frozen=True, slots=True)
class Shear:
    """A plate's force along a horizontal axis follows its vertical one: s, share or N, after what it follows.

    Parameters
    ----------
    follows : 'rate', 'force' or 'load'
        The rate of the vertical force, that force itself, or only that there is one.
    """

    plate: str
    axis: int
    follows: str

    FOLLOWS: ClassVar[tuple[str, ...]] = ("rate", "force", "load")

    def column(self, weighed: Weighed) -> Array:
        """A horizontal force where the plate is pressed, (n, 6)."""
        vertical = weighed.plate(self.plate)[:, 1]
        shapes = {
            "rate": np.gradient(vertical, weighed.times),
            "force": vertical,
            "load": (vertical > _LOADED_N).astype(float),
        }
        force = np.outer(shapes[self.follows], _UNIT[self.axis])
        return np.concatenate([force, np.cross(weighed.pressed(self.plate), force)], axis=1)


@dataclass(frozen=True, slots=True)
class Inertial:
    """A segment's inertial parameters change along a direction.

    Parameters
    ----------
    change : (10,)
        As ``Inertias.parameters`` orders them.
    """

    segment: str
    change: tuple[float, ...]

    def column(self, weighed: Weighed) -> Array:
        """What the motion needs more, (n, 6)."""
        return weighed.needed_more([self.segment], np.array([self.change]))[:, :, 0]


@dataclass(frozen=True, slots=True)
class Tilt:
    """The vertical leans: rad about a ground axis, true minus taken."""

    axis: int

    def column(self, weighed: Weighed) -> Array:
        """What the whole weight does then, (n, 6)."""
        force = -weighed.mass * np.cross(_UNIT[self.axis], GRAVITY)
        moment = np.cross(weighed.centre_of_mass, force)
        return np.concatenate([np.broadcast_to(force, moment.shape), moment], axis=1)


@dataclass(frozen=True, slots=True)
class Wobbling:
    """Part of a segment's own mass hangs on a spring: kg."""

    segment: str
    frequency_hz: float
    damping: float

    def column(self, weighed: Weighed) -> Array:
        """What a kilogram needs more as it moves against its segment and lies beside its place, (n, 6)."""
        return _swinging(weighed, [self.segment], self.frequency_hz, self.damping)[:, :, 0]


@dataclass(frozen=True, slots=True)
class Between:
    """How a load changes with a number that shapes it: the difference of two loads, times a factor."""

    high: Wobbling
    low: Wobbling
    factor: float

    def column(self, weighed: Weighed) -> Array:
        """The difference, (n, 6)."""
        return self.factor * (self.high.column(weighed) - self.low.column(weighed))


Load = (
    Late
    | Drifting
    | PlateShift
    | PlateBias
    | PlateGain
    | PlateTurn
    | Shear
    | Inertial
    | Tilt
    | Wobbling
    | Between
)


def columns_of(loads: Sequence[Load], weighed: Weighed) -> Array:
    """The columns of many loads, (n, 6, n_loads): what they have in common is made once."""
    made = np.empty((len(weighed.times), 6, len(loads)))
    changing: dict[int, Inertial] = {}
    swinging: dict[tuple[float, float], dict[int, str]] = {}
    for k, load in enumerate(loads):
        if isinstance(load, Inertial):
            changing[k] = load
        elif isinstance(load, Wobbling):
            swinging.setdefault((load.frequency_hz, load.damping), {})[k] = load.segment
        elif isinstance(load, Tilt | Between):
            made[:, :, k] = load.column(weighed)
        else:
            made[:, :, k] = _of_plates(load, weighed)
    if changing:
        segments, changes = [x.segment for x in changing.values()], [x.change for x in changing.values()]
        made[:, :, list(changing)] = weighed.needed_more(segments, np.array(changes))
    for (frequency, damping), here in swinging.items():
        made[:, :, list(here)] = _swinging(weighed, list(here.values()), frequency, damping)
    return made


def _of_plates(load: Load, weighed: Weighed) -> Array:
    """A load in which the motion has no part, made once for all draws of its noise."""
    kept = weighed.footing.columns
    if load not in kept:
        kept[load] = load.column(weighed)
    return kept[load]


def _swinging(weighed: Weighed, segments: Sequence[str], frequency_hz: float, damping: float) -> Array:
    """What a kilogram on a spring needs more, in each of some segments, (n, 6, n_segments)."""
    place, pull = weighed.centres(segments), weighed.pulls(segments)
    displaced, speed = oscillate(pull, weighed.step, frequency_hz, damping)
    w = 2.0 * np.pi * frequency_hz
    force = pull - 2.0 * damping * w * speed - w * w * displaced
    moment = np.cross(place, force) + np.cross(displaced, force - pull - weighed.gravity)
    return np.concatenate([force, moment], axis=2).transpose(0, 2, 1)
