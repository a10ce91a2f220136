"""Key points of a video pose network as points of a model: guesses of joint centres, off by what they are.

Names as Pose2Sim and Sports2D write those of BODY_25 and HALPE_26 (``marker_sets/video_keypoints.yaml``).
They lie up to 50 mm from joint centres by markers (Needham et al. 2021, Sci Rep 11:20673).
"""

from __future__ import annotations

from collections import abc
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.core.notes import Note
from scaling_service.model import body
from scaling_service.model.anatomy import lengths
from scaling_service.model.anatomy.marker_sets import recognise
from scaling_service.model.anatomy.markers import strip_prefix
from scaling_service.model.anatomy.rotations import read_rotation_table
from scaling_service.model.places import tell_landmarks

_JOINTS: abc.Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "Hip": ("hip", "pelvis"),
        "Knee": ("knee", "tibia"),
        "Ankle": ("ankle", "tibia"),
        "Shoulder": ("shoulder", "torso"),
        "Elbow": ("elbow", "ulna"),
        "Wrist": ("wrist", "ulna"),
    }
)
"""Key point without its side to its joint, and the segment that it is put on."""

_FEET: abc.Mapping[str, tuple[str, float]] = MappingProxyType(
    {"Heel": ("HEE", 0.0), "BigToe": ("MT1", 0.055), "SmallToe": ("MT5", 0.045)}
)
"""Key point to the landmark of a foot, and how far before it, m (chosen: a great toe, a little toe)."""


def add_key_points(model: body.BodyModel, labels: abc.Iterable[str]) -> body.BodyModel:
    """The model with the key points that these labels name, where they are those of a video pose network.

    The model as it is where labels are of another set, or it has such markers.

    Examples
    --------
    >>> from scaling_service.model.builtin import load_builtin
    >>> labels = [f"{side}{name}" for side in "RL" for name in ("Hip", "Knee", "Ankle", "Heel", "BigToe")]
    >>> whole = [*labels, "RShoulder", "LShoulder", "RElbow", "LElbow", "RWrist", "LWrist", "Neck", "Nose"]
    >>> added = add_key_points(load_builtin("lower_limb_feet_18dof"), [*whole, "RSmallToe", "LSmallToe"])
    >>> [m.name for m in added.markers if m.noise][:3]
    ['RHip', 'RKnee', 'RAnkle']
    """
    named = list(dict.fromkeys(strip_prefix(label) for label in labels))
    found = recognise(named)
    if found is None or not found.key_points or set(named) & set(model.marker_names):
        return model
    sd, added = read_rotation_table().centre, []
    landmarks = {landmark: name for name, landmark in tell_landmarks(model).items()}
    for side in "RL":
        for name, (joint, part) in _JOINTS.items():
            ends = lengths.find_joint_ends(model, joint, side.lower())
            segment = lengths.find_segment(model, part, "" if part in ("pelvis", "torso") else side.lower())
            if segment in ends:
                added.append(_make(f"{side}{name}", segment, ends[segment], sd))
        for name, (landmark, before) in _FEET.items():
            own = landmarks.get(f"{side}{landmark}")
            if own is not None:
                marker = model.marker(own)
                at = np.add(marker.nominal, (before, 0.0, 0.0))
                added.append(_make(f"{side}{name}", marker.segment, at, sd))
    shoulders = [m for m in added if m.name.endswith("Shoulder")]
    if len(shoulders) == 2 and shoulders[0].segment == shoulders[1].segment:
        middle = np.mean([m.nominal for m in shoulders], axis=0)
        added.append(_make("Neck", shoulders[0].segment, middle, sd))
    return model.with_markers((*model.markers, *added))


def _make(name: str, segment: str, at: Array, sd: float) -> body.Marker:
    return replace(body.Marker.at(name, segment, body.to_vector(at), anatomical=False), noise=sd)


def tell_key_points(model: body.BodyModel, labels: abc.Iterable[str]) -> tuple[Note, ...]:
    """That key points are followed, and how far they are taken to be off; nothing where markers are, too."""
    seen = list(labels)
    if not model.shows_key_points_alone(seen):
        return ()
    off = max(1e3 * m.noise for m in model.markers if m.noise is not None and m.name in seen)
    said = (
        f"key points of video stand for joint centres, each off by {off:.0f} mm along an axis; what they do "
        "not show, such as the pelvis's tilt, is not told, or held by what is ordinary, as deviations say"
    )
    remedy = "Nothing is to be done; markers on the pelvis show its tilt"
    return (Note(code="key_points", severity="note", problem=said, remedy=remedy),)
