"""A joint that glides or turns along with a coordinate."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.capabilities.discovery.effects._columns import glide, shifts, turn_of
from scaling_service.capabilities.discovery.laws.profiles import Following
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.candidates import Candidate

KIND = "coupled_motion"
MEANING = "the joint glides or turns along with a coordinate"


def candidates(scene: Scene) -> Iterator[Candidate]:
    """Every joint that turns, gliding or turning with each of its own coordinates."""
    for segment in scene.jointed:
        for driver in scene.coordinates_of(segment):
            yield Candidate(KIND, (segment.joint_name,), glide(segment.name, driver), (driver,))
            turns = shifts(
                turn_of(segment.name),
                suffix="_deg_per_deg",
                unit=1.0,
                profile=Following(driver),
                most=1.0,
            )
            yield Candidate(KIND, (segment.joint_name,), turns, (driver,), note="turning")
