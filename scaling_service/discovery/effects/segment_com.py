"""A segment whose centre of mass lies elsewhere."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.discovery.candidates import Candidate, Column
from scaling_service.discovery.effects._columns import MM
from scaling_service.discovery.effects._inertia import of_centre
from scaling_service.discovery.loads import Inertial
from scaling_service.discovery.scene import Scene
from scaling_service.discovery.spots import LETTERS

KIND = "segment_com"
MEANING = "the segment's centre of mass lies elsewhere"


def candidates(scene: Scene) -> Iterator[Candidate]:
    """Every segment with mass."""
    for segment in scene.heavy:
        columns = tuple(
            Column(
                f"{LETTERS[k]}_mm",
                MM,
                load=Inertial(segment.name, tuple(of_centre(segment, k).tolist())),
                low=-200.0,
                high=200.0,
            )
            for k in range(3)
        )
        yield Candidate(KIND, (segment.name,), columns)
