"""What an unknown number does to the disagreement of the ground wrench.

The disagreement is what the plates measured minus what the motion needs. Each load gives its derivative
with respect to one number: force (N) and moment about the ground origin (N m), in every frame. A fault of a
plate also says how its readings are freed of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol, runtime_checkable

import numpy as np

from scaling_service.capabilities.discovery.observations.oscillator import simulate_oscillator
from scaling_service.capabilities.discovery.observations.wrench import Load, WrenchFit
from scaling_service.core.arrays import Array
from scaling_service.model.body import Segment
from scaling_service.model.inertia import to_matrix
from scaling_service.numerics.multibody.motion import TENSOR
from scaling_service.numerics.multibody.rigid import rotate_about
from scaling_service.numerics.wrench import GRAVITY

_UNIT = np.eye(3)

_ARM_M = 0.2
"""What makes forces of moments about a plate's middle, so that its readings are of one unit (chosen: half a
plate)."""


class Plate(NamedTuple):
    """One plate: force and moment about the ground origin (n, 3), its middle (3,), its readings (n,)."""

    force: Array
    moment: Array
    middle: Array
    read: Array


@runtime_checkable
class PlateFault(Protocol):
    """A load by which one plate's readings are wrong, and can be put right."""

    @property
    def plate(self) -> str:
        """The plate's name, ``plate_1`` and so on."""

    def column(self, fit: WrenchFit) -> Array:
        """What one more does to the disagreement, (n, 6), N and N m."""

    def correct(self, plate: Plate, size: float) -> tuple[Array, Array]:
        """Force and moment (n, 3) of the plate without a fault of this size."""


@dataclass(frozen=True, slots=True)
class Late:
    """The forces come late: seconds. ``measured(t) = true(t - d)``."""

    def column(self, fit: WrenchFit) -> Array:
        """Minus the rate of the measured wrench, (n, 6)."""
        return -np.gradient(fit.measured, fit.times, axis=0)


@dataclass(frozen=True, slots=True)
class PlateShift:
    """A plate lies elsewhere: m along a ground axis."""

    plate: str
    axis: int

    def column(self, fit: WrenchFit) -> Array:
        """Its forces act elsewhere than was taken, (n, 6)."""
        force = fit.plate(self.plate)[:, :3]
        return np.concatenate([np.zeros_like(force), -np.cross(_UNIT[self.axis], force)], axis=1)

    def correct(self, plate: Plate, size: float) -> tuple[Array, Array]:
        """Force and moment without it."""
        return plate.force, plate.moment + np.cross(size * _UNIT[self.axis], plate.force)


@dataclass(frozen=True, slots=True)
class PlateBias:
    """Something constant is added to a plate's readings: N along an axis, N m about one through its middle.

    Nothing is added to zeros that an export puts where the plate is not loaded.
    """

    plate: str
    component: int

    def column(self, fit: WrenchFit) -> Array:
        """One component wherever the plate is read, (n, 6)."""
        wrench = np.zeros(6)
        wrench[self.component] = 1.0
        if self.component < 3:
            wrench[3:] = np.cross(fit.centre(self.plate), _UNIT[self.component])
        return np.outer(fit.readings(self.plate), wrench)

    def correct(self, plate: Plate, size: float) -> tuple[Array, Array]:
        """Force and moment without it."""
        if self.component >= 3:
            return plate.force, plate.moment - np.outer(size * plate.read, _UNIT[self.component - 3])
        added = np.outer(size * plate.read, _UNIT[self.component])
        return plate.force - added, plate.moment - np.cross(plate.middle, added)


@dataclass(frozen=True, slots=True)
class PlateGain:
    """A plate measures a multiple: measured over true, less one."""

    plate: str

    def column(self, fit: WrenchFit) -> Array:
        """The plate's own wrench, (n, 6)."""
        return fit.plate(self.plate)

    def correct(self, plate: Plate, size: float) -> tuple[Array, Array]:
        """Force and moment without it."""
        return plate.force / (1.0 + size), plate.moment / (1.0 + size)


@dataclass(frozen=True, slots=True)
class PlateTurn:
    """A plate is turned about an axis: rad, true minus taken."""

    plate: str
    axis: int
    about: Literal["middle", "ground"] = "middle"  # of the plate in each trial, or the ground's origin

    def column(self, fit: WrenchFit) -> Array:
        """Minus what turning its wrench would add, (n, 6)."""
        wrench, centre = fit.plate(self.plate), self._point(fit.centre(self.plate))
        about = wrench[:, 3:] - np.cross(centre, wrench[:, :3])
        turned = -np.cross(_UNIT[self.axis], wrench[:, :3])
        moment = np.cross(centre, turned) - np.cross(_UNIT[self.axis], about)
        return np.concatenate([turned, moment], axis=1)

    def correct(self, plate: Plate, size: float) -> tuple[Array, Array]:
        """Force and moment without it."""
        turn, point = rotate_about(_UNIT[self.axis], size), self._point(plate.middle)
        about = plate.moment - np.cross(point, plate.force)
        turned = plate.force @ turn.T
        return turned, about @ turn.T + np.cross(point, turned)

    def _point(self, middle: Array) -> Array:
        return middle if self.about == "middle" else np.zeros(3)


@dataclass(frozen=True, slots=True)
class PlateMisreading:
    """A share of one of a plate's readings is added to another, or to itself.

    Readings: its force, and its moment about its middle over 0.2 m. ``bent``: what is added grows with the
    square of the reading, and is that share where it bears a body's weight.
    """

    plate: str
    component: int
    of: int
    bent: bool = False

    def column(self, fit: WrenchFit) -> Array:
        """That reading as the other's, (n, 6)."""
        wrench, middle = fit.plate(self.plate), fit.centre(self.plate)
        moment = wrench[:, 3:] - np.cross(middle, wrench[:, :3])
        reading = np.concatenate([wrench[:, :3], moment / _ARM_M], axis=1)[:, self.of]
        if self.bent:
            reading = np.square(reading) / (fit.mass * np.linalg.norm(GRAVITY))
        made = np.zeros(6)
        made[self.component] = 1.0 if self.component < 3 else _ARM_M
        if self.component < 3:
            made[3:] = np.cross(middle, _UNIT[self.component])
        return np.outer(reading, made)


@dataclass(frozen=True, slots=True)
class PlateLate:
    """A plate's readings come late by themselves: seconds."""

    plate: str

    def column(self, fit: WrenchFit) -> Array:
        """Minus the rate of its wrench, (n, 6)."""
        return -np.gradient(fit.plate(self.plate), fit.times, axis=0)


@dataclass(frozen=True, slots=True)
class Inertial:
    """A segment's inertial parameters change along a direction (10,), ordered as ``Inertias.parameters``."""

    segment: str
    change: tuple[float, ...]

    def column(self, fit: WrenchFit) -> Array:
        """What the motion needs more, (n, 6)."""
        return fit.compute_needed_more(self.segment, self.change)


@dataclass(frozen=True, slots=True)
class Tilt:
    """The vertical leans: rad about a ground axis, true minus taken."""

    axis: int

    def column(self, fit: WrenchFit) -> Array:
        """What the whole weight does then, (n, 6)."""
        force = -fit.mass * np.cross(_UNIT[self.axis], GRAVITY)
        moment = np.cross(fit.centre_of_mass, force)
        return np.concatenate([np.broadcast_to(force, moment.shape), moment], axis=1)


@dataclass(frozen=True, slots=True)
class Wobbling:
    """Part of a segment's own mass hangs on a spring: kg.

    Its place is ``along`` of the way from the segment's origin to its centre of mass.
    """

    segment: str
    frequency_hz: float
    damping: float
    along: float = 1.0

    def column(self, fit: WrenchFit) -> Array:
        """What a kilogram needs more as it moves against its segment and lies beside its place, (n, 6)."""
        (place,), (pull,) = (
            at([self.segment], self.along).transpose(1, 0, 2) for at in (fit.centres, fit.pulls)
        )
        displaced, speed = simulate_oscillator(pull, fit.step, self.frequency_hz, self.damping)
        w = 2.0 * np.pi * self.frequency_hz
        force = pull - 2.0 * self.damping * w * speed - w * w * displaced
        moment = np.cross(place, force) + np.cross(displaced, force - pull - fit.gravity)
        return np.concatenate([force, moment], axis=1)


def compute_columns(loads: Sequence[Load], fit: WrenchFit) -> Array:
    """The columns of loads, (n, 6, n_loads)."""
    return np.stack([load.column(fit) for load in loads], axis=2)


def scale_segment(segment: Segment) -> Inertial:
    """A segment that is heavier, of the same shape: per kilogram."""
    com = np.array(segment.com)
    tensor = to_matrix(segment.inertia) + segment.mass * _spread(com, com)
    every = np.concatenate([[segment.mass], segment.mass * com, [tensor[i, j] for i, j in TENSOR]])
    return Inertial(segment.name, tuple((every / segment.mass).tolist()))


def differentiate_centre(segment: Segment, axis: int) -> tuple[float, ...]:
    """Change of the ten inertial parameters about the segment's origin per metre of its centre of mass."""
    com, unit = np.array(segment.com), np.eye(3)[axis]
    tensor = 2.0 * segment.mass * _spread(com, unit)
    return tuple(np.concatenate([[0.0], segment.mass * unit, [tensor[i, j] for i, j in TENSOR]]).tolist())


def differentiate_load(segment: Segment) -> list[tuple[float, ...]]:
    """Change of the ten inertial parameters per mass of a point load, and per first moment of it.

    About the segment's origin. The load's tensor is square in its place; it is that of a load near the
    segment's centre of mass, c: ``sum of 2 moment spread(c) - mass spread(c, c)``.
    """
    com = np.array(segment.com)
    tensors = (-_spread(com, com), *(2.0 * _spread(com, unit) for unit in np.eye(3)))
    return [
        (*first, *(float(tensor[i, j]) for i, j in TENSOR))
        for first, tensor in zip(np.eye(4).tolist(), tensors, strict=True)
    ]


def _spread(a: Array, b: Array) -> Array:
    """The mixed part of a unit mass' tensor at a + b, halved: ``a.b 1 - (a b' + b a') / 2``."""
    return np.asarray(a @ b * np.eye(3) - 0.5 * (np.outer(a, b) + np.outer(b, a)))
