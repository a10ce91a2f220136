"""Which segment of a model is which bone: as stated, by its name, or by the tree of its joints."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import get_args

import numpy as np

from scaling_service.core.errors import SubjectInvalid
from scaling_service.documents.subject import BoneName
from scaling_service.model.anatomy.lengths import find_segment, list_chain
from scaling_service.model.body import GROUND, BodyModel, Segment
from scaling_service.model.poses import follow, list_model_values, pose_neutral_frames
from scaling_service.numerics.multibody.laws import Array

BONES: tuple[str, ...] = get_args(BoneName)
"""Bones of the pelvis and the legs, by the names of OpenSim's bodies."""

_MIRRORED_M = 0.1  # chosen: how far the tip of one leg may lie from the other's mirror image
_LONG = 0.25  # chosen: least share of a leg that a long bone has; thigh and shank have 0.4, a foot 0.15
_ONE_FOOT_M = 0.07  # chosen: the subtalar joint lies 20 to 45 mm from the ankle, the toes' 100 and more


def assign_bones(model: BodyModel, said: Mapping[str, str]) -> tuple[BodyModel, tuple[str, ...]]:
    """The model with its bones stated where its segments' names do not say them, and a note on each of these.

    ``said``: bone to the segment that a person names for it. Without that, names count; where they leave out
    a femur, the tree of the joints is looked at.
    Raises SubjectInvalid: there is no such segment, or it is named for two bones.
    """
    _check_said(model, said)
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
        f"bones by {source}: {', '.join(f'{bone} is {name}' for bone, name in pairs.items())}{remedy}"
        for source, pairs, remedy in (
            ("the subject file", said, ""),
            ("the tree of the model's joints", seen, "; name others under `bone_bodies:`"),
        )
        if pairs
    ]
    return replace(model, bones=tuple(stated.items())) if stated else model, tuple(notes)


def _check_said(model: BodyModel, said: Mapping[str, str]) -> None:
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


def find_body(model: BodyModel, bone: str) -> str | None:
    """The segment that one of :data:`BONES` belongs to, None if the model has none."""
    kind, _, side = bone.partition("_")
    return None if bone not in BONES else find_segment(model, "foot" if kind == "talus" else kind, side)


def find_bones_by_tree(model: BodyModel) -> dict[str, str]:
    """Bones of the legs and the pelvis by how the model's joints hang on one another, whatever their names.

    In the neutral pose the legs are the chain that reaches lowest and its mirror image; the pelvis is where
    they part. In each, the first two stretches between joints that turn and are long are thigh and shank.
    Empty where there are no two such stretches; of one leg alone the pelvis is where its root ends.
    """
    frames = pose_neutral_frames(model)
    parents = {segment.parent for segment in model.segments}
    tips = [segment.name for segment in model.segments if segment.name not in parents]
    first = min(tips, key=lambda tip: frames[tip][1][1])
    mirrored = frames[first][1] * (1.0, 1.0, -1.0)
    apart = {tip: float(np.linalg.norm(frames[tip][1] - mirrored)) for tip in tips if tip != first}
    legs = [first, *(tip for tip in sorted(apart, key=apart.__getitem__)[:1] if apart[tip] < _MIRRORED_M)]
    chains = [[s.name for s in list_chain(model, GROUND, tip)] for tip in legs]
    shared = [name for name in chains[0] if all(name in chain for chain in chains)] if len(chains) > 1 else []
    found: dict[str, str] = {}
    for chain in chains:
        pelvis = shared[-1] if shared else chain[0]
        leg = _list_leg_bones(model, chain[chain.index(pelvis) + 1 :])
        if leg:
            rotation, origin = frames[pelvis]
            side = "r" if (frames[leg["femur"]][1] - origin) @ rotation[:, 2] > 0.0 else "l"
            found |= {"pelvis": pelvis} | {f"{bone}_{side}": name for bone, name in leg.items()}
    return found


def _list_leg_bones(model: BodyModel, chain: list[str]) -> dict[str, str]:
    """Thigh, shank, talus and heel of a chain below the pelvis; empty where it is no leg."""
    places = dict(_list_turning_places(model, chain))
    names, at = list(places), np.array(list(places.values())).reshape(-1, 3)
    gaps = np.linalg.norm(np.diff(at, axis=0), axis=1)
    long = [k for k, gap in enumerate(gaps) if gap > _LONG * gaps.sum()]
    if len(long) < 2:
        return {}
    thigh, shank = long[:2]
    foot = names[shank + 1 :]
    near = [n for n in foot if np.linalg.norm(places[n] - places[foot[0]]) < _ONE_FOOT_M]
    return {"femur": names[thigh], "tibia": names[shank], "talus": foot[0], "calcn": near[-1]}


def _list_turning_places(model: BodyModel, names: list[str]) -> Iterator[tuple[str, Array]]:
    """The segments of a chain that turn against their parents, and where, (3,) m, in the neutral pose."""
    frames, values = pose_neutral_frames(model), list_model_values(model)
    for segment in map(model.segment, names):
        first = _find_first_turn(segment)
        if first is not None:
            yield segment.name, follow(segment.joints[:first], values, frames[segment.parent])[1]


def _find_first_turn(segment: Segment) -> int | None:
    turns = (k for k, j in enumerate(segment.joints) if j.turns)
    return next(turns, None)
