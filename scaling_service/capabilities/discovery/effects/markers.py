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
            yield Candidate(kind="marker_offset", where=(marker,), columns=columns, trials=trials)


def propose_skin_artefacts(scene: Scene) -> Iterator[Candidate]:
    """Every marker and the groups of every segment, with each coordinate at its ends, groups with two."""
    for segment in scene.bearing:
        groups = scene.groups_on(segment.name)
        for driver in scene.drivers_of(segment.name):
            for group in groups:
                columns = make_shifts(of_markers(*group), driver=driver)
                yield Candidate(kind="soft_tissue_artefact", where=group, columns=columns, driver=(driver,))
        for drivers in combinations(scene.drivers_of(segment.name), 2):
            for group in groups:
                if len(group) > 1:
                    yield Candidate(
                        kind="soft_tissue_artefact",
                        where=group,
                        columns=_make_following_shifts(group, drivers),
                        driver=drivers,
                    )


def _make_following_shifts(group: Sequence[str], drivers: Sequence[str]) -> tuple[Column, ...]:
    """Shifts of markers together, with several coordinates at once."""
    return tuple(
        replace(column, name=column.name.replace("_", f"_{driver}_", 1))
        for driver in drivers
        for column in make_shifts(of_markers(*group), driver=driver)
    )


def propose_capture_scale(scene: Scene) -> Iterator[Candidate]:
    """Whole recordings: a calibration wand of another length."""
    column = Column(name="factor", unit=1.0, parts=(Part(VolumeSpot()),), neutral=1.0)
    for trials in scene.scopes:
        yield Candidate(kind="capture_scale", where=("markers",), columns=(column,), trials=trials)


EFFECTS = (
    Effect(
        kind="marker_offset",
        meaning="the marker sits elsewhere on its segment",
        candidates=propose_marker_offsets,
        of_recording=True,
    ),
    Effect(
        kind="soft_tissue_artefact",
        meaning="the skin under the marker moves over the bone with a joint's angle",
        candidates=propose_skin_artefacts,
    ),
    Effect(
        kind="capture_scale",
        meaning="all measured positions are scaled by one factor",
        candidates=propose_capture_scale,
        of_recording=True,
    ),
)
