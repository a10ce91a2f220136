"""Markers of a foot that creep while it stands: a shoe that slips on it."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.capabilities.discovery.evidence.fitting import Account
from scaling_service.capabilities.discovery.evidence.spots import LETTERS, JointSpot
from scaling_service.capabilities.discovery.evidence.standing import stands
from scaling_service.capabilities.discovery.laws.profiles import Standing
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.candidates import Candidate, Column, Part
from scaling_service.capabilities.discovery.search.option import Option


def candidates(now: Account, scene: Scene) -> Iterator[Candidate]:
    """Every segment that comes to stand again and again."""
    for segment in scene.jointed:
        markers = scene.on(segment.name)
        if markers and all(stands(item, markers) for item in now.watched):
            spots = [JointSpot(segment.name, "after", "translation", k) for k in range(len(LETTERS))]
            parts = [(Part(spot, Standing(markers)),) for spot in spots]
            columns = tuple(Column(letter, 1.0, part) for letter, part in zip(LETTERS, parts, strict=True))
            yield Candidate("slipping", markers, columns, note=segment.name)


def told(option: Option) -> tuple[tuple[str, ...], str]:
    """The markers, and how fast they creep."""
    along = ", ".join(f"{1e3 * v:.3g}" for v in option.fitted.size.tolist())
    law = f"the markers of {option.candidate.note} creep by ({along}) mm/s along its axes while it stands"
    return option.candidate.where, law
