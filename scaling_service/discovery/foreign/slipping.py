"""Markers of a foot that creep while it stands: a shoe that slips on it."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.discovery.candidates import Candidate, Column, Part
from scaling_service.discovery.findings import Foreign
from scaling_service.discovery.fitting import Account
from scaling_service.discovery.options import compared
from scaling_service.discovery.profiles import Standing
from scaling_service.discovery.scene import Scene
from scaling_service.discovery.spots import LETTERS, JointSpot
from scaling_service.discovery.standing import stands


def found(now: Account, scene: Scene, stretch_s: float) -> Iterator[Foreign]:
    """Every segment that comes to stand again and again."""
    watched = [segment.name for segment in scene.jointed if scene.on(segment.name)]
    stepping = [name for name in watched if all(stands(item, scene.on(name)) for item in now.watched)]
    choice = [_on(segment, scene.on(segment)) for segment in stepping]
    for option in compared(now, choice, stretch_s, 1):
        (segment,), fitted = option.candidate.where, option.fitted
        along = ", ".join(f"{1e3 * v:.3g}" for v in fitted.size.tolist())
        law = f"the markers of {segment} creep by ({along}) mm/s along its axes while it stands"
        yield Foreign(scene.on(segment), law, fitted.expected, fitted.p, option.unseen.p)


def _on(segment: str, markers: tuple[str, ...]) -> Candidate:
    spots = [JointSpot(segment, "after", "translation", k) for k in range(len(LETTERS))]
    parts = [(Part(spot, Standing(markers)),) for spot in spots]
    columns = tuple(Column(letter, 1.0, part) for letter, part in zip(LETTERS, parts, strict=True))
    return Candidate("slipping", (segment,), columns)
