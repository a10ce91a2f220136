"""A segment that is longer or shorter than the model has it, its markers following."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.capabilities.discovery.evidence.spots import SizeSpot
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.candidates import Candidate, Column, Part

KIND = "segment_length"
MEANING = "the segment is longer or shorter, its markers following"


def candidates(scene: Scene) -> Iterator[Candidate]:
    """Every segment that has a size."""
    sized = {joint.scales_with for _, joint in scene.model.joints() if joint.scales_with}
    sized |= {m.segment for m in scene.model.markers if m.follows_size}
    for segment in scene.bearing:
        if segment.name in sized:
            columns = (
                Column("factor", 1.0, (Part(SizeSpot(segment.name)),), neutral=1.0, low=0.7, high=1.4),
            )
            yield Candidate(KIND, (segment.name,), columns)
