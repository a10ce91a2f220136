"""A segment whose centre of mass lies elsewhere."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.capabilities.discovery.effects._columns import MM
from scaling_service.capabilities.discovery.effects._inertia import of_centre
from scaling_service.capabilities.discovery.evidence.spots import LETTERS
from scaling_service.capabilities.discovery.laws.loads import Inertial
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.candidates import Candidate, Column

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
