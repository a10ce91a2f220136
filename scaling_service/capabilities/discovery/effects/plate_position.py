"""A plate that lies elsewhere than the recording says."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.capabilities.discovery.effects._columns import MM
from scaling_service.capabilities.discovery.evidence.spots import LETTERS
from scaling_service.capabilities.discovery.laws.loads import PlateShift
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.candidates import Candidate, Column

KIND = "plate_position"
_MOST_MM = (300.0, 100.0, 300.0)  # chosen: half a plate, and a floor that was laid over it
MEANING = "the plate lies elsewhere, so that its centre of pressure is shifted"


def candidates(scene: Scene) -> Iterator[Candidate]:
    """Every loaded plate, in all recordings and in each."""
    for plate in scene.plates:
        columns = tuple(
            Column(f"{LETTERS[k]}_mm", MM, load=PlateShift(plate, k), low=-most, high=most)
            for k, most in enumerate(_MOST_MM)
        )
        for trials in scene.scopes_of_forces:
            yield Candidate(KIND, (plate,), columns, trials=trials)
