"""A body as this bank describes it: a tree of segments whose joints turn and slide by linear laws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Vector = tuple[float, float, float]

GROUND = "ground"
GRAVITY: Vector = (0.0, -9.80665, 0.0)
"""m/s^2; standard gravity (CGPM 1901), Y up."""


@dataclass(frozen=True)
class Move:
    """A turn about, or a slide along, an axis by ``constant + sum of gain * coordinate``.

    Parameters
    ----------
    kind : 'turn' or 'slide'
    axis : unit vector in the frame reached so far
    gains : coordinate and its factor (1 for a joint's own coordinate; m/rad for a coupled glide)
    constant : rad or m
    """

    kind: Literal["turn", "slide"]
    axis: Vector
    gains: tuple[tuple[str, float], ...] = ()
    constant: float = 0.0


def turn(axis: Vector, coordinate: str) -> Move:
    """A turn by a coordinate."""
    return Move("turn", axis, ((coordinate, 1.0),))


def slide(axis: Vector, coordinate: str) -> Move:
    """A slide by a coordinate."""
    return Move("slide", axis, ((coordinate, 1.0),))


@dataclass(frozen=True)
class Segment:
    """A rigid segment: its joint's centre in the parent (m), moves, mass (kg), com (m), inertia about it."""

    name: str
    parent: str
    joint: str
    centre: Vector
    moves: tuple[Move, ...]
    mass: float
    com: Vector
    inertia: tuple[Vector, Vector, Vector]


@dataclass(frozen=True)
class Marker:
    """A marker: its place in its segment's frame, m."""

    name: str
    segment: str
    at: Vector


@dataclass(frozen=True)
class Body:
    """A tree of segments, parents first, with markers; ``gravity`` in ground, m/s^2."""

    name: str
    segments: tuple[Segment, ...]
    markers: tuple[Marker, ...]
    gravity: Vector = GRAVITY

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Coordinates in the order in which the moves first use them."""
        used = (c for s in self.segments for m in s.moves for c, _ in m.gains)
        return tuple(dict.fromkeys(used))

    @property
    def mass(self) -> float:
        """All together, kg."""
        return sum(s.mass for s in self.segments)

    @property
    def marker_names(self) -> tuple[str, ...]:
        """In the order of the markers."""
        return tuple(m.name for m in self.markers)

    def segment(self, name: str) -> Segment:
        """A segment by its name."""
        return next(s for s in self.segments if s.name == name)

    def of_joint(self, joint: str) -> Segment:
        """The segment that a joint carries."""
        return next(s for s in self.segments if s.joint == joint)

    def marker(self, name: str) -> Marker:
        """A marker by its name."""
        return next(m for m in self.markers if m.name == name)

    def on(self, segment: str) -> tuple[str, ...]:
        """Names of the markers that a segment carries."""
        return tuple(m.name for m in self.markers if m.segment == segment)

    def with_segment(self, changed: Segment) -> Body:
        """The same with one segment replaced."""
        return replace(self, segments=tuple(changed if s.name == changed.name else s for s in self.segments))

    def with_markers_moved(self, shifts: Mapping[str, Vector]) -> Body:
        """The same with some markers shifted, m in their segments' frames."""
        moved = (replace(m, at=add(m.at, shifts[m.name])) if m.name in shifts else m for m in self.markers)
        return replace(self, markers=tuple(moved))


def add(a: Sequence[float], b: Sequence[float]) -> Vector:
    """Sum of two vectors."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def times(a: Sequence[float], factor: float) -> Vector:
    """A vector times a number."""
    return (a[0] * factor, a[1] * factor, a[2] * factor)
