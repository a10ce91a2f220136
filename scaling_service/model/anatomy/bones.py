"""Which segment of a model is which bone: as stated, by its name, or by the tree of its joints."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from typing import get_args

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.core.errors import SubjectInvalid
from scaling_service.core.names import say_name
from scaling_service.core.notes import Note
from scaling_service.documents.subject import BoneName
from scaling_service.model import body, poses
from scaling_service.model.anatomy import lengths

BONES: tuple[str, ...] = get_args(BoneName)
"""Bones of the pelvis and the legs, by the names of OpenSim's bodies."""

_ALIKE = 0.15  # chosen: share by which a stretch of one leg may be longer than the other's
_APART = 0.8
"""Chosen: most that two limbs of one pair lie apart, in lengths of their upper stretch. Hips lie 0.17 m apart
over thighs of 0.43 m, shoulders 0.36 m over upper arms of 0.30 m (Winter 2009)."""
_ACROSS = 0.85
"""Chosen: most of a foot's direction that lies along the shank, as a cosine. Its farthest point lies 50 to 80
deg off the shank; a hand's, or a trunk's, less than 20 off what it hangs on."""
_LONG = 0.25  # chosen: least share of a leg that a long bone has; thigh and shank have 0.4, a foot 0.15
_ONE_FOOT_M = 0.07  # chosen: the subtalar joint lies 20 to 45 mm from the ankle, the toes' 100 and more


def assign_bones(model: body.BodyModel, said: Mapping[str, str]) -> tuple[body.BodyModel, tuple[Note, ...]]:
    """The model with its bones stated where its segments' names do not say them, and a note on each of these.

    ``said``: bone to the segment that a person names for it. Without that, names count; where they leave out
    a femur, the tree of the joints is looked at.
    Raises SubjectInvalid: there is no such segment, or it is named for two bones.
    """
    for bone, segment in said.items():
        if segment not in model.segment_names:
            raise SubjectInvalid(
                f"the model has no segment '{segment}'",
                field=f"bone_bodies.{bone}",
                remedy=f"Its segments are {', '.join(model.segment_names)}",
            )
        others = {other for other, name in said.items() if name == segment} - {bone}
        if others and not {bone[:5], *(other[:5] for other in others)} <= {"talus", "calcn"}:
            raise SubjectInvalid(
                f"'{segment}' is named for {min(others)} as well",
                field=f"bone_bodies.{bone}",
                remedy="Name each segment for one bone; only talus and calcn may be one",
            )
    named = {
        bone: name for bone in BONES if bone not in said and (name := find_body(model, bone)) is not None
    }
    nameless = [side for side in "rl" if f"femur_{side}" not in {**named, **said}]
    taken = {*named.values(), *said.values()}
    seen = {
        bone: name
        for bone, name in (find_bones_by_tree(model) if nameless else {}).items()
        if bone not in {**named, **said} and name not in taken and (bone == "pelvis" or bone[-1] in nameless)
    }
    stated = {**seen, **said}
    notes = [
        Note(
            code="bones",
            problem=f"bones by {source}: "
            f"{', '.join(f'{say_name(bone)} is {name!r}' for bone, name in pairs.items())}{more}",
        )
        for source, pairs, more in (
            ("the subject file", said, ""),
            ("the tree of the model's joints", seen, "; name others under `bone_bodies:`"),
        )
        if pairs
    ]
    return dataclasses.replace(model, bones=tuple(stated.items())) if stated else model, tuple(notes)


def find_body(model: body.BodyModel, bone: str) -> str | None:
    """The segment that one of :data:`BONES` belongs to, None if the model has none."""
    kind, _, side = bone.partition("_")
    return (
        None if bone not in BONES else lengths.find_segment(model, "foot" if kind == "talus" else kind, side)
    )


def find_bones_by_tree(model: body.BodyModel) -> dict[str, str]:
    """Bones of the legs and the pelvis by how the model's joints hang on one another, whatever their names.

    A leg has two long stretches between joints that turn, thigh and shank, and below them a foot that points
    across. Two that are as long, and hang no further apart than hips do, are a pair; the pelvis is where they
    part. Up is along the legs and forward along the feet, so that right is known whatever the model's axes
    are. Empty where there are no such stretches; of one leg alone the pelvis is where its root ends.
    """
    legs = _find_legs(model)
    if not legs:
        return {}
    inside = [leg.hip for leg in legs] if len(legs) > 1 else [*_list_points(model, [legs[0].pelvis])]
    middle, right = np.mean(inside, axis=0), _point_right(legs)
    found = {"pelvis": legs[0].pelvis}
    for leg in legs:
        side = "r" if (leg.hip - middle) @ right > 0.0 else "l"
        found |= {f"{bone}_{side}": name for bone, name in leg.bones.items()}
    return found


def find_rightward(model: body.BodyModel) -> Array | None:
    """To the right in the neutral pose by the model's legs and feet, (3,), of length 1; None without."""
    legs = _find_legs(model)
    return _point_right(legs) if legs else None


def _find_legs(model: body.BodyModel) -> tuple[_Leg, ...]:
    parents = {segment.parent for segment in model.segments}
    tips = [segment.name for segment in model.segments if segment.name not in parents]
    chains = [[segment.name for segment in lengths.list_chain(model, body.GROUND, tip)] for tip in tips]
    pairs = [pair for one, other in combinations(chains, 2) if (pair := _pair_legs(model, one, other))]
    alone = [(leg,) for chain in chains if (leg := _read_leg(model, chain[0], chain[1:]))]
    return max(pairs or alone, key=lambda legs: legs[0].length, default=())


def _point_right(legs: Sequence[_Leg]) -> Array:
    right = np.cross(np.sum([leg.forward for leg in legs], axis=0), np.sum([leg.up for leg in legs], axis=0))
    return np.asarray(right / np.linalg.norm(right))


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class _Leg:
    """A chain that may be a leg, in the neutral pose; places and directions in ground, (3,), m."""

    pelvis: str  # what it hangs on
    bones: Mapping[str, str]  # ``femur``, ``tibia``, ``talus``, ``calcn`` to segment
    hip: Array
    thigh: float  # m
    shank: float  # m
    up: Array  # from ankle to hip
    forward: Array  # along the foot, across the shank

    @property
    def length(self) -> float:
        """Of thigh and shank, m."""
        return self.thigh + self.shank


def _pair_legs(model: body.BodyModel, one: list[str], other: list[str]) -> tuple[_Leg, ...]:
    """The legs that two chains from the root are; none where one is not as the other, or far from it."""
    shared = [name for name in one if name in other]
    if not shared:
        return ()
    legs = [_read_leg(model, shared[-1], chain[len(shared) :]) for chain in (one, other)]
    if legs[0] is None or legs[1] is None:
        return ()
    first, second = legs[0], legs[1]
    alike = all(
        abs(np.log(a / b)) < _ALIKE for a, b in ((first.thigh, second.thigh), (first.shank, second.shank))
    )
    near = np.linalg.norm(first.hip - second.hip) < _APART * first.thigh
    return (first, second) if alike and near else ()


def _read_leg(model: body.BodyModel, pelvis: str, chain: list[str]) -> _Leg | None:
    """Thigh, shank, talus and heel of a chain below the pelvis; None where it is no leg."""
    places = dict(_list_turning_places(model, chain))
    names, at = list(places), np.array(list(places.values())).reshape(-1, 3)
    gaps = np.linalg.norm(np.diff(at, axis=0), axis=1)
    long = [k for k, gap in enumerate(gaps) if gap > _LONG * gaps.sum()]
    if len(long) < 2:
        return None
    thigh, shank = long[:2]
    foot = names[shank + 1 :]
    near = [n for n in foot if np.linalg.norm(places[n] - places[foot[0]]) < _ONE_FOOT_M]
    ankle, along = at[shank + 1], (at[shank] - at[shank + 1]) / gaps[shank]
    points = np.array(list(_list_points(model, chain[chain.index(foot[0]) :]))) - ankle
    farthest = points[int(np.argmax(np.linalg.norm(points, axis=1)))]
    across = farthest - (farthest @ along) * along
    if np.linalg.norm(across) <= np.sqrt(1.0 - _ACROSS**2) * np.linalg.norm(farthest):
        return None
    return _Leg(
        pelvis=pelvis,
        bones={"femur": names[thigh], "tibia": names[shank], "talus": foot[0], "calcn": near[-1]},
        hip=at[thigh],
        thigh=float(gaps[thigh]),
        shank=float(gaps[shank]),
        up=at[thigh] - ankle,
        forward=across,
    )


def _list_points(model: body.BodyModel, segments: Sequence[str]) -> Iterator[Array]:
    """Where segments turn and have their mass and markers in the neutral pose, (3,) m."""
    frames, markers = poses.pose_neutral_frames(model), poses.pose_neutral_markers(model)
    yield from dict(_list_turning_places(model, segments)).values()
    for segment in map(model.segment, segments):
        if segment.mass > 0.0:
            rotation, origin = frames[segment.name]
            yield origin + rotation @ np.array(segment.com)
    yield from (markers[m.name] for m in model.markers if m.segment in segments)


def _list_turning_places(model: body.BodyModel, names: Sequence[str]) -> Iterator[tuple[str, Array]]:
    """The segments of a chain that turn against their parents, and where, (3,) m, in the neutral pose."""
    frames, values = poses.pose_neutral_frames(model), poses.list_model_values(model)
    for segment in map(model.segment, names):
        turns = (k for k, j in enumerate(segment.joints) if j.turns)
        first = next(turns, None)
        if first is not None:
            yield segment.name, poses.follow(segment.joints[:first], values, frames[segment.parent])[1]
