"""Forces and markers that are out of step."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.capabilities.discovery.laws.loads import Late
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.candidates import Candidate, Column

KIND = "force_delay"
MEANING = "the forces come later (or earlier) than the markers"


def candidates(scene: Scene) -> Iterator[Candidate]:
    """All recordings with forces, and each by itself."""
    if scene.plates:
        columns = (Column("delay_s", 1.0, load=Late(), low=-0.3, high=0.3),)
        for trials in scene.scopes_of_forces:
            yield Candidate(KIND, ("forces",), columns, trials=trials)
