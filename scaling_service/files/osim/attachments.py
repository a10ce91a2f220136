"""Where an OpenSim model's muscles are attached, the surfaces of its bones, and attachments elsewhere."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scaling_service.files.mesh import Mesh, read_mesh
from scaling_service.files.osim.process import ask
from scaling_service.model.trial import Array, Bone

_MOST_CHANGE = 0.25
"""Chosen: logarithm of a muscle's length over its length before, in the default pose, beyond which it has
changed sides. Attachments move by a few cm, muscles are 50 to 500 mm long."""


@dataclass(frozen=True, slots=True, eq=False)
class Attachment:
    """A point of a muscle's path that is fixed in a segment; conditional ones are, moving ones are not."""

    muscle: str
    number: int  # in the muscle's path, from 0
    segment: str
    at: Array  # (3,), m, in the segment's frame


@dataclass(frozen=True, slots=True, eq=False)
class Wrap:
    """What muscles slide over."""

    name: str
    segment: str
    at: Array  # (3,), m: its centre in the segment's frame
    size: float = 1.0  # over what it was


@dataclass(frozen=True, slots=True, eq=False)
class Surfaces:
    """What a model's file says of its bones' surfaces."""

    bones: Mapping[str, Bone]  # segment to its surfaces, as scaled, in the segment's frame, m
    absent: Mapping[str, tuple[str, ...]]  # segment to names of files that are not there


def read_attachments(
    osim: str, source: Path, segments: Collection[str]
) -> tuple[tuple[Attachment, ...], tuple[Wrap, ...], Surfaces]:
    """Fixed path points and wraps on some segments, and these bones' surfaces as far as there are files.

    Files are looked for beside the model and in a folder ``Geometry`` there, by their bare names.

    ``osim``: text of the model's file. ``source``: the generic model that it was made from.
    Raises DependencyMissing, FileUnreadable, ModelRefused: as for reading a model; FileUnreadable as well
    where a surface is damaged.
    """
    answer = ask({"operation": "attachments", "file": str(source), "text": osim})
    points = tuple(
        Attachment(muscle, number, segment, np.array(at))
        for muscle, number, segment, at in answer["points"]
        if segment in segments
    )
    wraps = tuple(
        Wrap(name, segment, np.array(at)) for segment, name, at in answer["wraps"] if segment in segments
    )
    found: dict[str, list[Mesh]] = {}
    absent: dict[str, tuple[str, ...]] = {}
    for segment, name, factors, rotation, origin in answer["meshes"]:
        if segment not in segments:
            continue
        places = [folder / Path(name).name for folder in (source.parent, source.parent / "Geometry")]
        file = next((place for place in places if place.is_file()), None)
        if file is None:
            absent[segment] = (*absent.get(segment, ()), Path(name).name)
            continue
        mesh = read_mesh(file)
        vertices = (mesh.vertices * factors) @ np.array(rotation).T + origin
        found.setdefault(segment, []).append(Mesh(vertices, mesh.faces))
    return points, wraps, Surfaces({segment: _together(parts) for segment, parts in found.items()}, absent)


def _together(parts: Sequence[Mesh]) -> Bone:
    first = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = [part.faces + offset for part, offset in zip(parts, first, strict=False)]
    return Bone(np.concatenate([part.vertices for part in parts]), np.concatenate(faces))


def move_attachments(
    osim: str, source: Path, moved: Sequence[Attachment], wraps: Sequence[Wrap]
) -> tuple[str, tuple[str, ...]]:
    """The text of a model with attachments and wraps elsewhere; fibres and tendons grow as the paths do.

    ``moved``, ``wraps``: as :func:`read_attachments` gave them, at their new places.
    Returns the text, and muscles whose points stayed, for they would run along another side of a wrap.
    Raises as :func:`read_attachments`.
    """
    request = {
        "operation": "move attachments",
        "file": str(source),
        "text": osim,
        "moved": [[point.muscle, point.number, point.at.tolist()] for point in moved],
        "wraps": [[wrap.segment, wrap.name, wrap.at.tolist(), wrap.size] for wrap in wraps],
        "most": _MOST_CHANGE,
    }
    answer = ask(request)
    return answer["text"], tuple(answer["astray"])
