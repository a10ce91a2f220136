"""Something heavy that a segment carries at a point."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from scaling_service.capabilities.discovery.evidence.fitting import Account
from scaling_service.capabilities.discovery.laws.additions import Sized
from scaling_service.capabilities.discovery.laws.loads import Inertial
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.candidates import Candidate, Column
from scaling_service.numerics.multibody.laws import Array

KIND = "carried_load"
MEANING = "the segment carries a load at a point"

_REACH_M = 1.0  # chosen: an arm holds a load 0.7 m from the middle of the trunk


def candidates(scene: Scene) -> Iterator[Candidate]:
    """Every segment: a mass at its origin, and first moments that say where it is."""
    unit = np.eye(10)
    names = (("kg", 1.0, 0.0, 60.0), *((f"{axis}_kgmm", 1e3, -3e4, 3e4) for axis in "xyz"))
    for segment in scene.heavy:
        columns = tuple(
            Column(name, scale, load=Inertial(segment.name, tuple(unit[k].tolist())), low=low, high=high)
            for k, (name, scale, low, high) in enumerate(names)
        )
        yield Candidate(KIND, (segment.name,), columns)


def plausible(size: Array) -> bool:
    """Whether it hangs within reach of its segment."""
    return bool(np.linalg.norm(size[1:]) <= _REACH_M * abs(size[0]))


def details(effect: Sized, after: Account) -> Mapping[str, float]:
    """Where it is."""
    mass = float(effect.size[0])
    place = effect.size[1:] / mass * 1e3 if mass else np.zeros(3)
    return dict(zip(("x_mm", "y_mm", "z_mm"), place.tolist(), strict=True))
