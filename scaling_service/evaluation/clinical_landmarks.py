"""Where a model carries the joint centres and landmarks that conventional joint angles are made from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from scaling_service.anatomy.conventional import heel_level
from scaling_service.anatomy.frames import Side
from scaling_service.anatomy.lengths import joint_centres, segment_of
from scaling_service.anatomy.markers import canonical, strip_prefix
from scaling_service.models.body import BodyModel, Marker
from scaling_service.models.neutral import Frame, marker_position, model_values, neutral_frames
from scaling_service.models.poses import placed_markers
from scaling_service.models.results import Array, Motion

_PELVIS = ("RASIS", "LASIS", "RPSIS", "LPSIS", "SACR")
_LEG = ("LFE", "LM", "HEE", "TOE", "MT1", "MT5")


def clinical_landmarks(model: BodyModel) -> dict[str, Marker]:
    """The landmarks of :data:`~scaling_service.anatomy.conventional.Points` that a model has.

    Joint centres are the model's, the others its markers of that name or alias. A shank's frontal plane is
    the thigh's where all turns of the model are zero: knee rotation counts from there, and tibial torsion
    does not enter it. In that pose soles are level: heel and toe marker count as equally high.

    Returns
    -------
    dict
        Landmark to a marker at its place on a segment; without those that the model does not have.
    """
    placed = {name: Marker.at(name, frame, at) for name, (frame, at) in _centres(model).items()}
    for name in (*_PELVIS, *(f"{letter}{name}" for letter in "RL" for name in _LEG)):
        found = next((m for m in model.markers if _means(m.name, name)), None)
        if found is not None:
            placed[name] = replace(found, name=name)
    pose = neutral_frames(model, _straight(model))
    for side in ("r", "l"):
        placed |= _knee_axis(model, placed, pose, side)
        placed |= _level_heel(model, placed, pose, side)
    return placed


def moved_landmarks(model: BodyModel, motion: Motion, placed: Mapping[str, Marker]) -> dict[str, Array]:
    """Landmark to its trajectory in a motion of the model, (n_frames, 3), m.

    NaN where it hangs on a coordinate that the recording, or this frame of it, does not determine.
    """
    q = np.full((len(motion.times), len(model.coordinates)), np.nan)
    for k, name in enumerate(model.coordinate_names):
        if name in motion.estimated:
            q[:, k] = motion.q[:, motion.coordinates.index(name)]
    names = tuple(placed)
    where = placed_markers(model.with_markers(tuple(placed.values())), names, q)
    return {name: where[:, k] for k, name in enumerate(names)}


def _centres(model: BodyModel) -> dict[str, tuple[str, tuple[float, float, float]]]:
    letters = {"hip": "HJC", "knee": "KJC", "ankle": "AJC"}
    return {
        f"{name[-1].upper()}{letters[joint]}": where
        for name, where in joint_centres(model).items()
        if (joint := name[:-2]) in letters and name[-2:] in ("_r", "_l")
    }


def _means(label: str, landmark: str) -> bool:
    return canonical(label) == landmark or strip_prefix(label).upper() == landmark


def _straight(model: BodyModel) -> dict[str, float]:
    """Every turn at zero: upright, knees straight, soles level."""
    return {c.name: 0.0 for c in model.coordinates if c.kind == "rotation"}


def _in_pose(model: BodyModel, pose: Mapping[str, Frame], marker: Marker) -> Array:
    """A marker in ground, (1, 3), m."""
    rotation, origin = pose[marker.segment]
    return np.asarray(origin + rotation @ marker_position(marker, model_values(model)))[None]


def _on(pose: Mapping[str, Frame], segment: str, name: str, point: Array) -> Marker:
    """A marker on a segment where a point of ground, (3,), is in a pose."""
    rotation, origin = pose[segment]
    x, y, z = (float(v) for v in rotation.T @ (point - origin))
    return Marker.at(name, segment, (x, y, z))


def _knee_axis(
    model: BodyModel, placed: Mapping[str, Marker], pose: Mapping[str, Frame], side: Side
) -> dict[str, Marker]:
    """Beside the ankle as the knee marker is beside the knee, on the shank."""
    letter, shank = side.upper(), segment_of(model, "tibia", side)
    names = [f"{letter}{name}" for name in ("KJC", "LFE", "AJC")]
    if shank is None or not all(name in placed for name in names):
        return {}
    knee, lateral, ankle = (_in_pose(model, pose, placed[name])[0] for name in names)
    name = f"{letter}KAX"
    return {name: _on(pose, shank, name, ankle + lateral - knee)}


def _level_heel(
    model: BodyModel, placed: Mapping[str, Marker], pose: Mapping[str, Frame], side: Side
) -> dict[str, Marker]:
    """The heel at the toe's height; the toe between the metatarsal heads where it has no own marker."""
    letter = side.upper()
    at = {name: _in_pose(model, pose, m) for name, m in placed.items() if name.startswith(letter)}
    heel, toe, heads = f"{letter}HEE", f"{letter}TOE", (f"{letter}MT1", f"{letter}MT5")
    made = {}
    if toe not in at and all(head in at for head in heads):
        at[toe] = (at[heads[0]] + at[heads[1]]) / 2.0
        made[toe] = _on(pose, placed[heads[0]].segment, toe, at[toe][0])
    if heel in at and toe in at:
        made[heel] = _on(pose, placed[heel].segment, heel, heel_level(at, side)[0])
    return made
