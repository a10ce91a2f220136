"""A plate that is turned against what the recording says."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.capabilities.discovery.effects._columns import DEG
from scaling_service.capabilities.discovery.laws.loads import PlateTurn
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.candidates import Candidate, Column

KIND = "plate_rotation"
MEANING = "the plate is turned about its middle"


def candidates(scene: Scene) -> Iterator[Candidate]:
    """Every loaded plate, about the vertical and leaning, in all recordings and in each."""
    for plate in scene.plates:
        for trials in scene.scopes_of_forces:
            vertical = (Column("about_vertical_deg", DEG, load=PlateTurn(plate, 1), low=-45.0, high=45.0),)
            leaning = tuple(
                Column(f"tilt_{letter}_deg", DEG, load=PlateTurn(plate, k), low=-20.0, high=20.0)
                for k, letter in ((0, "x"), (2, "z"))
            )
            yield Candidate(KIND, (plate,), vertical, trials=trials)
            yield Candidate(KIND, (plate,), leaning, trials=trials, note="leaning")
