"""Muscles as lines of action: path points, surfaces that they slide over, and what makes their force."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from scaling_service.core.arrays import Array
from scaling_service.model import body

SurfaceKind = Literal["cylinder", "sphere", "ellipsoid", "torus"]


@dataclass(frozen=True, slots=True, kw_only=True)
class PathPoint:
    """A point of a muscle's path, fixed in a segment.

    With a ``coordinate`` the path passes it only where that lies between ``lower`` and ``upper`` (rad or m).
    """

    name: str
    segment: str
    at: body.Vector  # (3,), m, in the segment's frame
    coordinate: str | None = None
    lower: float = 0.0
    upper: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class WrapSurface:
    """What muscles slide over.

    ``sizes``, m: a cylinder's radius and length along z, a sphere's radius, an ellipsoid's half axes, a
    torus's inner and outer radius about z. ``side``: the direction in the surface's frame on which paths
    pass, where the file says one.
    """

    name: str
    kind: SurfaceKind
    segment: str
    origin: body.Vector  # (3,), m, in the segment's frame
    axes: tuple[
        body.Vector, body.Vector, body.Vector
    ]  # rows of the rotation from the surface's frame to the segment's
    sizes: tuple[float, ...]
    side: body.Vector | None = None
    of: str = ""  # the surface that this one stands for, if it does


@dataclass(frozen=True, slots=True, kw_only=True)
class Contact:
    """A muscle on a surface in one pose."""

    surface: str
    after: int  # number of the path point before the surface, from 0
    first: body.Vector  # (3,), m, where the path touches, in the surface's segment
    middle: body.Vector
    last: body.Vector


@dataclass(frozen=True, slots=True, kw_only=True)
class Muscle:
    """A muscle, SI; its parameters are those of Hill's model with a tendon."""

    name: str
    points: tuple[PathPoint, ...]
    surfaces: tuple[str, ...]  # that the file names for it
    isometric_force: float  # N
    fibre: float  # m, optimal length
    slack: float  # m, of the tendon
    pennation: float  # rad, at optimal length
    speed: float  # fibre lengths per second
    rise: float  # s, of activation
    fall: float  # s
    damping: float  # of the fibre, isometric forces at the greatest speed
    strain: float  # of the passive fibre at one isometric force
    passive: tuple[float, ...]  # its force over the isometric one at equal steps of strain up to there


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Musculature:
    """A model's muscles. A point that moves in its segment is fixed in one of its own, in ``movers``."""

    muscles: tuple[Muscle, ...]
    surfaces: tuple[WrapSurface, ...]
    movers: tuple[body.Segment, ...]
    q: Array  # (n_poses, n_coordinates), rad or m, in the order of the model's coordinates
    contacts: tuple[tuple[tuple[Contact, ...], ...], ...]  # by pose and muscle, in the path's order


def name_point(muscle: str, number: int) -> str:
    """The name of a point of a muscle's path, numbered from 0; files number points within each muscle."""
    return f"{muscle}-P{number + 1}"
