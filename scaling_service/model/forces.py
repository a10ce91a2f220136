"""What touches the body from outside: plates as a file holds them, and wrenches on one clock."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.arrays import Array
from scaling_service.core.errors import TrialUnusable
from scaling_service.model.trial import Repair

CONTACT_N = 20.0
"""Vertical force above which a foot is on a plate and a centre of pressure means something. The centre of
pressure is the quotient of moment and force, so its error grows as 1/F: at 20 N, errors of 0.5 N m (plate
cross-talk) move it by 25 mm. Laboratories use 10 to 50 N; chosen: 20 N."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class RawPlate:
    """One force plate of a recording, in SI units, in its own axes."""

    kind: int  # type of the C3D standard, 1 to 4
    corners: Array
    """(4, 3), m: in the laboratory: the quadrants (+x +y), (-x +y), (-x -y), (+x -y) of the plate's axes."""
    origin: Array
    """(3,), m: types 2 and 4: from the sensors' origin to the middle of the surface. Type 3:
    half-distances of the sensors along x and y, and the height."""
    signals: Array  # (n, 6 or 8), N, N m or m


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class PlateRecording:
    """All plates of a recording on their clock."""

    name: str
    times: Array  # (n,), s: zero is the first frame of the markers
    plates: tuple[RawPlate, ...]
    repairs: tuple[Repair, ...] = ()


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GroundForces:
    """Wrenches of the ground on the body."""

    name: str
    times: Array  # (n,), s: strictly increasing
    plates: tuple[str, ...]  # plate_1 …, in the order of the file
    force: Array  # (n, k, 3), N: on the body. NaN where not known.
    moment: Array  # (n, k, 3), N m: about the origin of the axes
    surfaces: Array  # (k, 3), m: a point of each plate's surface
    normals: Array  # (k, 3): unit vectors square to the surfaces, upwards
    repairs: tuple[Repair, ...] = dataclasses.field(default=())
    read: Array | None = None
    """(n, k): how much of each sample comes from readings, 0 to 1, where filters have mixed samples."""
    corners: Array | None = None  # (k, 4, 3), m: of each plate, round its rim; None where no file tells them

    def __post_init__(self) -> None:
        shape = (len(self.times), len(self.plates), 3)
        if self.force.shape != shape or self.moment.shape != shape:
            raise ValueError(f"force {self.force.shape} and moment {self.moment.shape} must be {shape}")
        if self.read is not None and self.read.shape != shape[:2]:
            raise ValueError(f"read {self.read.shape} must be {shape[:2]}")
        if not len(self.times) or not self.plates:
            raise TrialUnusable(
                "there is no force data",
                file=self.name,
                remedy="Record with force plates, or leave forces out",
            )

    @property
    def known(self) -> NDArray[np.bool_]:
        """Where a plate's force and moment are numbers, shape (n, k)."""
        return np.asarray(np.isfinite(self.force + self.moment).all(axis=2))

    @property
    def readings(self) -> Array:
        """How much of each sample comes from readings, shape (n, k), 0 to 1; NaN where not known.

        Exports hold zeros where a plate is not loaded: nothing was read there, so no fault of the plate
        shows either.
        """
        if self.read is not None:
            return self.read
        some = (self.force != 0.0).any(axis=2) | (self.moment != 0.0).any(axis=2)
        return np.where(self.known, some.astype(float), np.nan)

    @property
    def pressing(self) -> Array:
        """Force square to each surface, positive where the ground pushes, shape (n, k), N."""
        return np.asarray(np.einsum("nka,ka->nk", self.force, self.normals))

    def in_contact(self, threshold_n: float = CONTACT_N) -> NDArray[np.bool_]:
        """Where a plate is loaded, shape (n, k)."""
        return np.asarray(self.pressing > threshold_n)

    def centre_of_pressure(self, threshold_n: float = CONTACT_N) -> Array:
        """Where the force pierces each surface with no moment along it, shape (n, k, 3), m.

        NaN where the plate is not loaded above the threshold: there it has no meaning.

        With the moment ``M_s`` about a point s of a surface with normal n: ``s + n x M_s / (n . F)``.
        """
        about = self.moment - np.cross(self.surfaces, self.force)
        loaded = self.in_contact(threshold_n)
        pressing = np.where(loaded, self.pressing, np.nan)
        return self.surfaces + np.cross(self.normals, about) / pressing[..., None]

    def change(self, *repairs: Repair, **fields: Any) -> GroundForces:
        """The same with some fields replaced and what was done noted."""
        return dataclasses.replace(self, repairs=self.repairs + repairs, **fields)


def list_plate_names(count: int) -> tuple[str, ...]:
    """``plate_1`` to ``plate_count``."""
    return tuple(f"plate_{k + 1}" for k in range(count))


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class SegmentLoads:
    """Wrenches from outside on named segments."""

    times: Array  # (n,), s
    segments: tuple[str, ...]
    force: Array  # (n, k, 3), N: on the segment. NaN where not known.
    moment: Array  # (n, k, 3), N m: about the ground origin

    @property
    def total(self) -> Array:
        """Force and moment about the ground origin of all together, shape (n, 6)."""
        return np.concatenate([self.force.sum(axis=1), self.moment.sum(axis=1)], axis=1)
