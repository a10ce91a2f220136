"""Something heavy that a segment carries at a point."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from scaling_service.discovery.candidates import Candidate, Column
from scaling_service.discovery.loads import Inertial
from scaling_service.discovery.scene import Scene

KIND = "carried_load"
MEANING = "the segment carries a load at a point"


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
