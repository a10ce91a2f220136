"""Skin that moves over the bone as a joint bends, with one marker or all of a segment."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.capabilities.discovery.effects._columns import skin
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.candidates import Candidate

KIND = "soft_tissue_artefact"
MEANING = "the skin under the marker moves over the bone with a joint's angle"


def candidates(scene: Scene) -> Iterator[Candidate]:
    """Every marker and every segment's markers together, with each coordinate at the segment's ends."""
    for segment in scene.bearing:
        markers = scene.on(segment.name)
        for driver in scene.drivers_of(segment.name):
            for marker in markers:
                yield Candidate(KIND, (marker,), skin((marker,), driver), (driver,))
            if len(markers) > 1:
                yield Candidate(KIND, markers, skin(markers, driver), (driver,))
