"""Muscles' attachments that follow a person's bones, beside those that only follow a segment's size."""

from __future__ import annotations

import csv
import dataclasses
from collections import abc
from pathlib import Path

import numpy as np

from scaling_service.bones import morph
from scaling_service.bones.results import MeshRefused
from scaling_service.capabilities.playback.drawing import place_bones
from scaling_service.core.arrays import Array
from scaling_service.core.names import say_name
from scaling_service.core.text import list_few
from scaling_service.files.osim import muscles as osim_muscles
from scaling_service.model import results
from scaling_service.model.anatomy.lengths import find_joint_ends
from scaling_service.model.trial import Bone


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class MovedAttachments:
    """Attachments on one segment's bone, before and after."""

    points: tuple[osim_muscles.Attachment, ...]  # where they are now
    before: Array  # (n, 3), m, in the segment's frame: where scaling put them
    distances: Array  # (n, 2), m: from the person's bone before and after


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class FollowedSurfaces:
    """A model whose muscles are attached where the person's bones are."""

    osim: str
    moved: abc.Mapping[str, MovedAttachments]  # by segment
    notes: tuple[str, ...]


def follow_surfaces(
    osim: str, calibration: results.Calibration, bones: abc.Mapping[str, Bone], source: Path
) -> FollowedSurfaces:
    """Move a model's attachments by the smooth map from its own bones, as scaled, to the person's.

    ``osim``: text of the calibration's file. ``bones``: segment to the person's bone in the image, m.
    ``source``: the generic model's file; its bones' surfaces lie beside it.
    Where a segment has no surface, or the map would fold, its attachments stay where scaling has put them,
    and a note says so.
    Raises DependencyMissing, FileUnreadable: as for reading a model.
    """
    persons = place_bones(calibration, bones)
    points, wraps, surfaces = osim_muscles.read_attachments(osim, source, persons.keys())
    moved: dict[str, MovedAttachments] = {}
    moved_wraps: list[osim_muscles.Wrap] = []
    notes = [
        f"{calibration.method}: the model's {list_few(names)} of the {say_name(segment)} is not beside it or "
        "in Geometry/"
        for segment, names in surfaces.absent.items()
    ]
    for segment, person in persons.items():
        attached = f"attachments on the {say_name(segment)}"
        here = [point for point in points if point.segment == segment]
        if not here or segment not in surfaces.bones:
            continue
        try:
            mapped = morph.map_surface(surfaces.bones[segment], person, *_find_centres(calibration, segment))
        except MeshRefused as error:
            notes.append(f"{calibration.method}: {attached} are scaled: {error}")
            continue
        before = np.array([point.at for point in here])
        over = [wrap for wrap in wraps if wrap.segment == segment]
        centres = np.array([wrap.at for wrap in over]).reshape(-1, 3)
        sizes = mapped.sizes(np.concatenate([before, centres]))
        if sizes.min() <= 0.0:
            notes.append(f"{calibration.method}: {attached} are scaled: the map would fold")
            continue
        after = mapped(before)
        distances = np.stack([morph.measure_distances(person, at) for at in (before, after)], axis=1)
        shifted = tuple(dataclasses.replace(p, at=at) for p, at in zip(here, after, strict=True))
        moved[segment] = MovedAttachments(shifted, before, distances)
        there = zip(over, mapped(centres) if over else (), sizes[len(here) :], strict=True)
        moved_wraps += [dataclasses.replace(wrap, at=at, size=float(size)) for wrap, at, size in there]
        off, now = 1e3 * np.median(moved[segment].distances, axis=0)
        notes.append(
            f"{calibration.method}: {len(moved[segment].points)} {attached} follow its surface: "
            f"{off:.1f} mm from the bone as scaled, {now:.1f} mm now (medians); "
            f"{1e3 * mapped.left_m:.1f} mm are left between the surfaces"
        )
    every = [point for found in moved.values() for point in found.points]
    if not every:
        notes.append(f"{calibration.method}: muscles follow no surface: all attachments are scaled")
        return FollowedSurfaces(osim, moved, tuple(notes))
    text, astray = osim_muscles.move_attachments(osim, source, every, moved_wraps)
    if astray:
        notes.append(
            f"{calibration.method}: {list_few(astray)} would run along another side of what they slide over: "
            "their attachments are scaled"
        )
    # Moved attachments but for those of some muscles
    return FollowedSurfaces(
        text,
        {
            segment: MovedAttachments(
                tuple(found.points[k] for k in rows), found.before[rows], found.distances[rows]
            )
            for segment, found in moved.items()
            if (rows := [k for k, point in enumerate(found.points) if point.muscle not in astray])
        },
        tuple(notes),
    )


def _find_centres(calibration: results.Calibration, segment: str) -> tuple[Array, Array]:
    """Joint centres that a segment knows, each (n, 3), m: where its own bone as scaled has them, and now."""
    model, now, before = calibration.model, [], []
    for joint in ("hip", "knee", "ankle"):
        for side in "rl":
            ends = find_joint_ends(model, joint, side)
            if segment not in ends:
                continue
            parent, *carried = ends
            moved = results.JointMove()
            if segment == parent and carried:
                moved = calibration.joint_moves.get(model.segment(carried[0]).joint_name, moved)
            now.append(ends[segment])
            before.append(ends[segment] - moved.shift)
    return np.array(before).reshape(-1, 3), np.array(now).reshape(-1, 3)


def write_attachments(file: Path, moved: abc.Mapping[str, MovedAttachments]) -> None:
    """Write a table of all attachments that were moved: places in the segment's frame and distances, mm."""
    places = [f"{axis}_{when}_mm" for when in ("before", "after") for axis in "xyz"]
    with file.open("w", encoding="utf-8", newline="") as stream:
        rows = csv.writer(stream)
        rows.writerow(["muscle", "point", "segment", *places, "distance_before_mm", "distance_after_mm"])
        for found in moved.values():
            for point, before, distances in zip(found.points, found.before, found.distances, strict=True):
                numbers = 1e3 * np.concatenate([before, point.at, distances])
                rows.writerow(
                    [point.muscle, point.number + 1, point.segment, *(f"{number:.2f}" for number in numbers)]
                )
