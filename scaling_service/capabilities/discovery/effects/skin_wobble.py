"""Skin that oscillates when the segment accelerates."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.capabilities.discovery.effects._swings import swing_details, swing_spreads
from scaling_service.capabilities.discovery.evidence.spots import MarkerSpot
from scaling_service.capabilities.discovery.laws.profiles import Swing
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.laws.wobbles import TRIED
from scaling_service.capabilities.discovery.search.candidates import Candidate, Column, Part

KIND = "skin_wobble"
MEANING = "the skin under the marker swings when the segment accelerates"

details, spreads = swing_details, swing_spreads


def candidates(scene: Scene) -> Iterator[Candidate]:
    """Every marker and every segment's markers together, at each frequency and damping tried."""
    for segment in scene.bearing:
        markers = scene.on(segment.name)
        groups = [(m,) for m in markers] + ([markers] if len(markers) > 1 else [])
        for group in groups:
            for frequency, damping in TRIED:
                yield _at(group, frequency, damping)


def swinging(candidate: Candidate, scene: Scene, frequency_hz: float, damping: float) -> Candidate:
    """The same markers at another frequency and damping."""
    return _at(candidate.where, frequency_hz, damping)


def _at(markers: tuple[str, ...], frequency_hz: float, damping: float) -> Candidate:
    parts = tuple(
        Part(MarkerSpot(m, k), Swing(m, frequency_hz, damping, k)) for m in markers for k in range(3)
    )
    note = f"{frequency_hz:.3g} Hz, damping {damping:.2g}"
    return Candidate(KIND, markers, (Column("share", 1.0, parts, low=0.3, high=3.0, natural=1.0),), note=note)
