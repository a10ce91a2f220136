"""A marker that sits elsewhere on its segment, in all recordings or since it was stuck on again."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.discovery.candidates import Candidate
from scaling_service.discovery.effects._columns import of_markers, shifts
from scaling_service.discovery.scene import Scene

KIND = "marker_offset"
MEANING = "the marker sits elsewhere on its segment"


def candidates(scene: Scene) -> Iterator[Candidate]:
    """Every marker, in all trials and in each one."""
    for marker in scene.markers:
        columns = shifts(of_markers(marker), most=80.0)
        yield Candidate(KIND, (marker,), columns)
        if len(scene.trials) > 1:
            for trial in scene.trials:
                yield Candidate(KIND, (marker,), columns, trial=trial)
