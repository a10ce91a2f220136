"""A joint whose centre lies elsewhere in the parent segment."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.discovery.candidates import Candidate
from scaling_service.discovery.effects._columns import shifts
from scaling_service.discovery.scene import Scene
from scaling_service.discovery.spots import JointSpot

KIND = "joint_centre_offset"
MEANING = "the joint's centre lies elsewhere in the parent segment"


def candidates(scene: Scene) -> Iterator[Candidate]:
    """Every joint that turns."""
    for segment in scene.jointed:
        name = segment.name
        columns = shifts(lambda k, name=name: [JointSpot(name, "start", "translation", k)], most=80.0)  # type: ignore[misc]
        yield Candidate(KIND, (segment.joint_name,), columns)
