"""A plate that lies elsewhere than the recording says."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.discovery.candidates import Candidate, Column
from scaling_service.discovery.effects._columns import MM
from scaling_service.discovery.loads import PlateShift
from scaling_service.discovery.scene import Scene
from scaling_service.discovery.spots import LETTERS

KIND = "plate_position"
MEANING = "the plate lies elsewhere, so that its centre of pressure is shifted"


def candidates(scene: Scene) -> Iterator[Candidate]:
    """Every loaded plate, in all recordings and in each."""
    for plate in scene.plates:
        columns = tuple(
            Column(f"{LETTERS[k]}_mm", MM, load=PlateShift(plate, k), low=-500.0, high=500.0)
            for k in range(3)
        )
        for trial in scene.scopes_of_forces:
            yield Candidate(KIND, (plate,), columns, trial=trial)
