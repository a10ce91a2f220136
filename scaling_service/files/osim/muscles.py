"""An OpenSim model's muscles, by OpenSim in its own process: lengths, moment arms, attachments, bones."""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from scaling_service.core.arrays import Array
from scaling_service.files.mesh import Mesh, read_mesh
from scaling_service.files.osim import models
from scaling_service.model import body
from scaling_service.model import muscles as model_muscles
from scaling_service.model.compile import differentiate_law_at, evaluate_law_at
from scaling_service.model.document import from_document
from scaling_service.model.trial import Bone

_FRAME_S = 0.1  # chosen: of time allowed for each frame; 80 muscles take 4 ms on a quiet machine

_MOST_CHANGE = 0.25
"""Chosen: logarithm of a muscle's length over its length before, in the default pose, beyond which it has
changed sides. Attachments move by a few cm, muscles are 50 to 500 mm long."""

_MUSCLES = TypeAdapter(tuple[model_muscles.Muscle, ...])
_SURFACES = TypeAdapter(tuple[model_muscles.WrapSurface, ...])
_CONTACTS = TypeAdapter(tuple[tuple[tuple[model_muscles.Contact, ...], ...], ...])


@dataclass(frozen=True, slots=True, eq=False)
class MuscleGeometry:
    """Muscles of one model over one motion; NaN in frames that do not determine the pose."""

    muscles: tuple[str, ...]
    lengths: Array  # (n_frames, n_muscles), m: of muscle and tendon together
    arms: abc.Mapping[tuple[str, str], Array]
    """Muscle and coordinate to the moment arm, (n_frames,), m; pairs that are always zero are left out."""


def measure_muscles(osim: str, model: body.BodyModel, q: Array) -> MuscleGeometry:
    """Lengths and moment arms over a motion, as OpenSim's muscle analysis has them.

    A moment arm is the generalised force of a unit tension at a coordinate, that of coordinates coupled to it
    included (Sherman, Seth and Delp 2013, "What is a moment arm?").

    ``osim``: text of the ``.osim`` file. ``model``: what it holds.
    ``q``: (n_frames, n_coordinates), rad or m, in the order of the model's coordinates.
    Raises DependencyMissing, FileUnreadable: as for reading a model.
    """
    known = np.asarray(np.isfinite(q).all(axis=1))
    columns = dict(zip(model.coordinate_names, q[known].T, strict=True))
    turning = [c.name for c in model.coordinates if c.kind == "rotation" and not c.locked]
    request = {
        "operation": "muscles",
        "file": model.source or None,
        "text": osim,
        "q": _list_values(model, columns),
        "coordinates": turning,
        "couplings": [
            [c.dependent, c.independent, differentiate_law_at(c.law, columns[c.independent]).tolist()]
            for c in model.couplers
        ],
    }
    answer = models.ask(request, time_limit_s=models.TIME_LIMIT_S + _FRAME_S * int(known.sum()))
    muscles = tuple(answer["muscles"])
    lengths = _spread(known, np.reshape(answer["lengths"], (-1, len(muscles))))
    arms = {
        (muscle, coordinate): _spread(known, np.asarray(values))
        for muscle, coordinate, values in answer["arms"]
    }
    return MuscleGeometry(muscles, lengths, arms)


def read_musculature(osim: str, model: body.BodyModel, q: Array) -> model_muscles.Musculature:
    """The muscles of a model, and what surfaces they touch in some poses.

    ``osim``: text of the ``.osim`` file. ``model``: what it holds.
    ``q``: (n_poses, n_coordinates), rad or m, in the order of the model's coordinates.
    Raises DependencyMissing, FileUnreadable, ModelRefused: as for reading a model; ModelRefused as well where
    a path or a surface is of a kind that is not known.
    """
    request = {
        "operation": "musculature",
        "file": model.source or None,
        "text": osim,
        "q": _list_values(model, dict(zip(model.coordinate_names, q.T, strict=True))),
    }
    answer = models.ask(request, time_limit_s=models.TIME_LIMIT_S + _FRAME_S * len(q))
    moving, names = from_document(answer["model"]), set(answer["movers"])
    return model_muscles.Musculature(
        muscles=_MUSCLES.validate_python(answer["muscles"]),
        surfaces=_SURFACES.validate_python(answer["surfaces"]),
        movers=tuple(segment for segment in moving.segments if segment.name in names),
        q=q,
        contacts=_CONTACTS.validate_python(answer["contacts"]),
    )


def _list_values(model: body.BodyModel, columns: abc.Mapping[str, Array]) -> dict[str, list[float]]:
    """Values of all coordinates, those that follow others included."""
    followed = {c.dependent: evaluate_law_at(c.law, columns[c.independent]) for c in model.couplers}
    return {name: np.asarray(values).tolist() for name, values in {**columns, **followed}.items()}


def _spread(known: NDArray[np.bool_], values: Array) -> Array:
    """Values of the known frames among all frames, NaN elsewhere."""
    full = np.full((len(known), *values.shape[1:]), np.nan)
    full[known] = values
    return full


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

    bones: abc.Mapping[str, Bone]  # segment to its surfaces, as scaled, in the segment's frame, m
    absent: abc.Mapping[str, tuple[str, ...]]  # segment to names of files that are not there


def read_attachments(
    osim: str, source: Path, segments: abc.Collection[str]
) -> tuple[tuple[Attachment, ...], tuple[Wrap, ...], Surfaces]:
    """Fixed path points and wraps on some segments, and these bones' surfaces as far as there are files.

    Files are looked for beside the model and in a folder ``Geometry`` there, by their bare names.

    ``osim``: text of the model's file. ``source``: the generic model that it was made from.
    Raises DependencyMissing, FileUnreadable, ModelRefused: as for reading a model; FileUnreadable as well
    where a surface is damaged.
    """
    answer = models.ask({"operation": "attachments", "file": str(source), "text": osim})
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
    meshes = {}
    for segment, parts in found.items():
        first = np.cumsum([0, *(len(part.vertices) for part in parts)])
        faces = [part.faces + offset for part, offset in zip(parts, first, strict=False)]
        meshes[segment] = Bone(np.concatenate([part.vertices for part in parts]), np.concatenate(faces))
    return points, wraps, Surfaces(meshes, absent)


def move_attachments(
    osim: str, source: Path, moved: abc.Sequence[Attachment], wraps: abc.Sequence[Wrap]
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
    answer = models.ask(request)
    return answer["text"], tuple(answer["astray"])


def set_parameters(osim: str, model: body.BodyModel, lengths: abc.Mapping[str, abc.Sequence[float]]) -> str:
    """The text of a model with other optimal fibre and tendon slack lengths, m, of some muscles.

    Raises as :func:`read_attachments`.
    """
    given = {name: list(own) for name, own in lengths.items()}
    request = {"operation": "muscle parameters", "file": model.source or None, "text": osim, "lengths": given}
    text: str = models.ask(request)["text"]
    return text
