"""Markers that sit elsewhere or move over the bone, and a volume that is scaled as a whole."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations

from scaling_service.capabilities.discovery.effects._columns import make_shifts, of_markers
from scaling_service.capabilities.discovery.effects.catalogue import Effect
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Column, Part
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.laws.spots import VolumeSpot


def propose_marker_offsets(scene: Scene) -> Iterator[Candidate]:
    """Every marker, in all trials, in each one and since each one: it may have been stuck on again."""
    for marker in scene.markers:
        columns = make_shifts(of_markers(marker))
        for trials in scene.scopes:
            yield Candidate("marker_offset", (marker,), columns, trials=trials)


def propose_skin_artefacts(scene: Scene) -> Iterator[Candidate]:
    """Every marker and the groups of every segment, with each coordinate at its ends, groups with two."""
    for segment in scene.bearing:
        groups, every = scene.groups_on(segment.name), scene.drivers_of(segment.name)
        for drivers in (*((one,) for one in every), *combinations(every, 2)):
            for group in groups:
                if len(group) >= len(drivers):
                    columns = _make_following_shifts(group, drivers)
                    yield Candidate("soft_tissue_artefact", group, columns, driver=drivers)


def _make_following_shifts(group: Sequence[str], drivers: Sequence[str]) -> tuple[Column, ...]:
    """Shifts of markers together, with one coordinate or several at once."""
    found = [(d, c) for d in drivers for c in make_shifts(of_markers(*group), driver=d)]
    if len(drivers) < 2:
        return tuple(column for _, column in found)
    return tuple(replace(c, name=c.name.replace("_", f"_{d}_", 1)) for d, c in found)


def propose_capture_scale(scene: Scene) -> Iterator[Candidate]:
    """Whole recordings: a calibration wand of another length."""
    column = Column(name="factor", unit=1.0, parts=(Part(VolumeSpot()),), neutral=1.0)
    for trials in scene.scopes:
        yield Candidate("capture_scale", ("markers",), (column,), trials=trials)


EFFECTS = (
    Effect(
        "marker_offset", "the marker sits elsewhere on its segment", propose_marker_offsets, of_recording=True
    ),
    Effect(
        "soft_tissue_artefact",
        "the skin under the marker moves over the bone with a joint's angle",
        propose_skin_artefacts,
    ),
    Effect(
        "capture_scale",
        "all measured positions are scaled by one factor",
        propose_capture_scale,
        of_recording=True,
    ),
)
