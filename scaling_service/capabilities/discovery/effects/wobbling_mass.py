"""Part of a segment's own mass that swings against it."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.capabilities.discovery.effects._swings import swing_details, swing_spreads
from scaling_service.capabilities.discovery.laws.loads import Wobbling
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.laws.wobbles import TRIED
from scaling_service.capabilities.discovery.search.candidates import Candidate, Column

KIND = "wobbling_mass"
MEANING = "part of the segment's own mass swings on a spring"

details, spreads = swing_details, swing_spreads


def candidates(scene: Scene) -> Iterator[Candidate]:
    """Every segment with mass, at each frequency and damping tried."""
    for segment in scene.heavy:
        for frequency, damping in TRIED:
            yield _at(segment.name, segment.mass, frequency, damping)


def swinging(candidate: Candidate, scene: Scene, frequency_hz: float, damping: float) -> Candidate:
    """The same segment at another frequency and damping."""
    (segment,) = candidate.where
    return _at(segment, scene.model.segment(segment).mass, frequency_hz, damping)


def _at(segment: str, mass: float, frequency_hz: float, damping: float) -> Candidate:
    note = f"{frequency_hz:.3g} Hz, damping {damping:.2g}"
    columns = (Column("kg", 1.0, load=Wobbling(segment, frequency_hz, damping), low=0.0, high=mass),)
    return Candidate(KIND, (segment,), columns, note=note)
