"""Spots of a body where something could move that the model holds still.

Everything that moves is a joint, so every kinematic effect is one or more joints put at such spots, each
with a law: a constant, a multiple of a coordinate, a multiple of a signal. A spot with the constant law
zero changes nothing, and the derivative of all markers with respect to it is what an effect there would
look like.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.discovery.observations.tracked import MotionFit
from scaling_service.core.arrays import Array
from scaling_service.model import body
from scaling_service.model.compile import compile_model, list_parameter_values
from scaling_service.model.parameters import fold, free_scale
from scaling_service.numerics.multibody import tree as trees

AXES: tuple[body.Vector, body.Vector, body.Vector] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
LETTERS = "xyz"
_OPEN = 1e9  # no bound

At = Literal["start", "before", "after"]
Frames = slice | NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class JointSpot:
    """A turn or shift along an axis (0, 1, 2 for x, y, z) in the chain that carries a segment.

    It is at the parent's frame (``start``), or before or after the turns that the joint makes.
    """

    segment: str
    at: At
    kind: Literal["rotation", "translation"]
    axis: int

    def put(self, model: body.BodyModel, law: body.Law) -> body.BodyModel:
        """The model with a joint of this law here; a ValueError where the joint does not turn."""
        return put_joint(model, self.segment, self.at, body.Joint(self.kind, AXES[self.axis], law))


@dataclass(frozen=True, slots=True)
class MarkerSpot:
    """A shift of one marker along an axis of its segment."""

    marker: str
    axis: int

    def put(self, model: body.BodyModel, law: body.Law) -> body.BodyModel:
        """The model with this law added to the marker's place."""
        markers = []
        for marker in model.markers:
            if marker.name == self.marker:
                x, y, z = (own + law if k == self.axis else own for k, own in enumerate(marker.laws))
                marker = replace(marker, laws=(x, y, z))
            markers.append(marker)
        return model.with_markers(tuple(markers))


@dataclass(frozen=True, slots=True)
class SizeSpot:
    """The size of a segment, markers following."""

    segment: str

    def resize(self, model: body.BodyModel, change: float) -> body.BodyModel:
        """The model with a segment that is larger by a share."""
        return fold(free_scale(model, self.segment, 0.9), {f"scale.{self.segment}": 1.0 + change})


@dataclass(frozen=True, slots=True)
class VolumeSpot:
    """The size of the whole measured volume about the laboratory's origin."""


@dataclass(frozen=True, slots=True)
class FieldSpot:
    """What cameras make of a place: a shift along an axis of the room, by powers of where it is.

    Where that is counts from a middle (m), in so many metres. ``late``: it comes so much later (s) instead.
    """

    powers: tuple[int, int, int]
    middle: body.Vector
    reach: float
    _: KW_ONLY
    axis: int = 0
    late: bool = False

    def move(self, places: Array, speeds: Array) -> Array:
        """Places (m, 3, n), with their speeds, per unit of this."""
        away = (places - np.array(self.middle)[:, None]) / self.reach
        grows = np.prod(away ** np.array(self.powers)[:, None], axis=1)
        if self.late:
            return np.asarray(-speeds * grows[:, None])
        moved = np.zeros_like(places)
        moved[:, self.axis] = grows
        return moved


OfVolume = VolumeSpot | FieldSpot
Spot = JointSpot | MarkerSpot | SizeSpot | OfVolume


def find_turning_joints(segment: body.Segment) -> tuple[int, int] | None:
    """The first of the joints of a segment that turn, and one past the last; None if none does."""
    found = [k for k, j in enumerate(segment.joints) if j.turns]
    return (found[0], found[-1] + 1) if found else None


def put_joint(model: body.BodyModel, segment: str, at: At, joint: body.Joint) -> body.BodyModel:
    """The model with a joint in the chain that carries a segment; a ValueError where that does not turn."""

    def lengthen(item: body.Segment) -> body.Segment:
        place = find_index(item, at)
        return replace(item, joints=(*item.joints[:place], joint, *item.joints[place:]))

    return replace(model, segments=tuple(lengthen(s) if s.name == segment else s for s in model.segments))


def find_index(segment: body.Segment, at: At) -> int:
    """How many of a segment's joints come before that place; a ValueError where none turns."""
    if at == "start":
        return 0
    span = find_turning_joints(segment)
    if span is None:
        raise ValueError(f"the joint of '{segment.name}' does not turn")
    return span[0] if at == "before" else span[1]


def with_parameters(model: body.BodyModel, spots: Sequence[Spot]) -> tuple[body.BodyModel, tuple[str, ...]]:
    """The model with one parameter at every spot, at the value that changes nothing, and their names.

    Spots of the volume are not the body's and get an empty name.
    """
    names = []
    for k, spot in enumerate(spots):
        if isinstance(spot, OfVolume):
            names.append("")
        elif isinstance(spot, SizeSpot):
            model = free_scale(model, spot.segment, 0.9)
            names.append(f"scale.{spot.segment}")
        else:
            names.append(f"spot.{k}")
            model = spot.put(model, body.Law((body.Term(1.0, parameter=names[-1]),)))
            added = body.Parameter(
                name=names[-1],
                value=0.0,
                unit="1",
                lower=-_OPEN,
                upper=_OPEN,
                group="effect",
                target=names[-1],
            )
            model = replace(model, parameters=(*model.parameters, added))
    return model, tuple(names)


@dataclass(frozen=True, slots=True, eq=False)
class Generators:
    """The derivative of all markers with respect to every spot."""

    tree: trees.Tree
    p: Array
    variables: NDArray[np.intp]
    volumes: Mapping[int, OfVolume]  # which spots are of the volume

    @classmethod
    def of(cls, item: MotionFit, spots: Sequence[Spot]) -> Generators:
        """For a recording as it is tracked."""
        opened, names = with_parameters(item.task.model, spots)
        tree = compile_model(opened, item.markers)
        number = {p.name: k for k, p in enumerate(opened.parameters)}
        free = np.flatnonzero(item.task.free)
        chosen = [tree.n_coordinates + number[name] for name in names if name]
        volumes = {k: spot for k, spot in enumerate(spots) if isinstance(spot, OfVolume)}
        return cls(
            tree,
            list_parameter_values(opened),
            np.concatenate([free, np.array(chosen, dtype=np.intp)]),
            volumes,
        )

    def at(self, item: MotionFit, rows: Frames) -> tuple[Array, Array, Array]:
        """Residuals (n, r), the pose's columns (n, n_free, r) and the spots' (n, n_spots, r), m."""
        poses = trees.pose_links(self.tree, np.ascontiguousarray(item.q[rows].T), self.p)
        placed = trees.place_tree_markers(self.tree, poses)
        rates = trees.compute_jacobian(self.tree, poses, placed, self.variables)
        n, count = placed.shape[-1], int(item.task.free.sum())
        if self.volumes:
            at = [count + k for k in self.volumes]
            of_body = np.delete(np.arange(len(rates) + len(at)), at)
            every = np.empty((len(rates) + len(at), *rates.shape[1:]))
            every[of_body] = rates
            speeds = np.moveaxis(item.speeds[rows], 0, -1)
            for k, spot in self.volumes.items():
                every[count + k] = placed if isinstance(spot, VolumeSpot) else spot.move(placed, speeds)
            rates = every
        measured = item.task.measured[rows]
        shown = np.isfinite(measured).reshape(n, -1)
        gap = np.where(shown, (measured - np.moveaxis(placed, -1, 0)).reshape(n, -1), 0.0)
        moved = trees.order_by_frame(rates)
        moved *= shown[:, None]
        return gap, moved[:, :count], moved[:, count:]
