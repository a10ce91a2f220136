"""A segment that is heavier or lighter than the model has it."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.capabilities.discovery.effects._inertia import of_segment
from scaling_service.capabilities.discovery.laws.loads import Inertial
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.candidates import Candidate, Column

KIND = "segment_mass"
MEANING = "the segment is heavier or lighter, of the same shape"


def candidates(scene: Scene) -> Iterator[Candidate]:
    """Every segment with mass, its inertia in proportion."""
    for segment in scene.heavy:
        change = tuple((of_segment(segment) / segment.mass).tolist())
        column = Column("kg", 1.0, load=Inertial(segment.name, change), low=-0.9 * segment.mass, high=20.0)
        yield Candidate(KIND, (segment.name,), (column,))
