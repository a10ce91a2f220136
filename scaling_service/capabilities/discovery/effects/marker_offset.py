"""A marker that sits elsewhere on its segment, in all recordings or since it was stuck on again."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.capabilities.discovery.effects._columns import of_markers, shifts
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.candidates import Candidate

KIND = "marker_offset"
MEANING = "the marker sits elsewhere on its segment"


def candidates(scene: Scene) -> Iterator[Candidate]:
    """Every marker, in all trials, in each one and since each one."""
    for marker in scene.markers:
        columns = shifts(of_markers(marker), most=80.0)
        for trials in scene.scopes:
            yield Candidate(KIND, (marker,), columns, trials=trials)
