"""A vertical that is not vertical."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.capabilities.discovery.effects._columns import DEG
from scaling_service.capabilities.discovery.laws.loads import Tilt
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.candidates import Candidate, Column

KIND = "gravity_tilt"
MEANING = "the laboratory's vertical is not vertical"


def candidates(scene: Scene) -> Iterator[Candidate]:
    """The whole world, about its two level axes."""
    if scene.plates:
        columns = tuple(
            Column(name, DEG, load=Tilt(k), low=-15.0, high=15.0) for k, name in ((0, "x_deg"), (2, "z_deg"))
        )
        yield Candidate(KIND, ("world",), columns)
