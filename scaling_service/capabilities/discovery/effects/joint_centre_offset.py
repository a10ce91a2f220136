"""A joint whose centre lies elsewhere in the parent segment."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.capabilities.discovery.effects._columns import shift_of, shifts
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.candidates import Candidate

KIND = "joint_centre_offset"
MEANING = "the joint's centre lies elsewhere in the parent segment"


def candidates(scene: Scene) -> Iterator[Candidate]:
    """Every joint that turns."""
    for segment in scene.jointed:
        yield Candidate(KIND, (segment.joint_name,), shifts(shift_of(segment.name), most=80.0))
