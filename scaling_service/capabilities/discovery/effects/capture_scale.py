"""A capture volume that is scaled as a whole: a calibration wand of another length."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.capabilities.discovery.evidence.spots import VolumeSpot
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.candidates import Candidate, Column, Part

KIND = "capture_scale"
MEANING = "all measured positions are scaled by one factor"


def candidates(_scene: Scene) -> Iterator[Candidate]:
    """The whole recording."""
    yield Candidate(
        KIND, ("markers",), (Column("factor", 1.0, (Part(VolumeSpot()),), neutral=1.0, low=0.8, high=1.25),)
    )
