"""A plate that measures a multiple of the truth."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.capabilities.discovery.laws.loads import PlateGain
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.candidates import Candidate, Column

KIND = "plate_gain"
MEANING = "the plate measures a multiple of the true force"


def candidates(scene: Scene) -> Iterator[Candidate]:
    """Every loaded plate, in all recordings and in each."""
    for plate in scene.plates:
        for trials in scene.scopes_of_forces:
            columns = (Column("factor", 1.0, neutral=1.0, load=PlateGain(plate), low=0.7, high=1.4),)
            yield Candidate(KIND, (plate,), columns, trials=trials)
