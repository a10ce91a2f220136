"""The points that lengths are measured between, on a person's recording and on a model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from scaling_service.capabilities.scaling.methods.functional import FunctionalJoints
from scaling_service.model.anatomy.centres import (
    BodySizes,
    Centre,
    Points,
    construct_centres,
    lift_ankle,
    with_mirrored_psis,
)
from scaling_service.model.anatomy.hip_centre import chord_centre
from scaling_service.model.anatomy.lengths import joint_centres
from scaling_service.model.anatomy.markers import canonical, strip_prefix
from scaling_service.model.body import BodyModel
from scaling_service.model.poses import neutral_frames
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.laws import Array

_MIDDLES: Mapping[str, tuple[str, str]] = MappingProxyType({"knee": ("LFE", "MFE"), "ankle": ("LM", "MM")})
"""Joints whose centre is measured at the middle of two landmarks, on the model as on the person."""

UNKNOWN_SIZES = BodySizes()
"""Nothing but markers."""

_NOTHING: Points = MappingProxyType({})


@dataclass(frozen=True, slots=True, eq=False)
class PersonPoints:
    """Landmarks of one recording, and the joint centres that they give.

    Parameters
    ----------
    landmarks : mapping
        Canonical name to trajectory, (n_frames, 3), m.
    sizes : BodySizes
    regression : str
        Of the hip centres.
    standing : bool
        Whether the person stands still; in movement skin moves.
    scale : float
        The person's size over that of the adults on whom palpation was studied.
    hips : mapping
        Hip centres that are known better than by regression.
    centres : mapping
        ``hip_r``, ``knee_r``, ``ankle_r`` and the left ones.
    """

    landmarks: Points
    sizes: BodySizes
    regression: str
    standing: bool
    scale: float = 1.0
    hips: Points = field(default_factory=lambda: _NOTHING)
    centres: Mapping[str, Centre] = field(default_factory=lambda: MappingProxyType({}))

    @property
    def points(self) -> Points:
        """Landmarks and centres alike."""
        return name_points(self.landmarks, self.centres)


def name_points(landmarks: Points, centres: Mapping[str, Centre]) -> Points:
    """Landmarks and centres in one mapping, with a missing PSIS as the other's mirror image.

    An ankle is there also by how it was found, such as ``ankle_r_middle``.
    """
    named = {name: centre.at for name, centre in centres.items()}
    kinds = {
        f"{name}_{c.kind}": c.at
        for name, c in centres.items()
        if name.startswith("ankle") and "chord" not in name
    }
    return {**with_mirrored_psis(landmarks), **named, **kinds}


def person_points(
    trial: Trial,
    *,
    standing: bool,
    regression: str,
    sizes: BodySizes = UNKNOWN_SIZES,
    joints: FunctionalJoints | None = None,
    scale: float = 1.0,
) -> PersonPoints:
    """Landmarks of a recording by canonical name, with the joint centres.

    Parameters
    ----------
    standing : bool
        Only a standing trial gives the leg length that the fuller regressions use, where it was not measured.
    regression : str
        Gives the hip centres that ``joints`` does not.
    sizes : BodySizes
    joints : FunctionalJoints, optional
    scale : float
        See :class:`PersonPoints`.
    """
    landmarks = read_landmarks(trial)
    if standing:
        sizes = sizes.with_leg_lengths(standing_leg_lengths(landmarks))
    hips = {} if joints is None else {f"hip_{side}": joints.hip_in(trial, side) for side in joints.hips}
    centres = construct_centres(landmarks, sizes, regression, hips=hips)
    return PersonPoints(landmarks, sizes, regression, standing, scale, hips, centres)


def read_landmarks(trial: Trial) -> dict[str, Array]:
    """A recording's landmarks by canonical name; other labels by their own, in capitals, no prefix."""
    points: dict[str, Array] = {}
    for label in trial.labels:
        points.setdefault(_name(label), trial.position(label))
    return points


def _name(label: str) -> str:
    return canonical(label) or strip_prefix(label).upper()


def standing_leg_lengths(points: Points) -> dict[str, float]:
    """ASIS to medial malleolus by side, means over the frames that show both (m)."""
    found = {}
    for side in "rl":
        ends = [points.get(f"{side.upper()}{name}") for name in ("ASIS", "MM")]
        if ends[0] is not None and ends[1] is not None:
            distance = np.linalg.norm(ends[0] - ends[1], axis=1)
            if np.isfinite(distance).any():
                found[side] = float(np.nanmean(distance))
    return found


def model_points(model: BodyModel) -> Points:
    """The same points on the model in its neutral pose, one frame."""
    points: dict[str, Array] = {}
    frames = neutral_frames(model)
    for marker in model.markers:
        rotation, origin = frames[marker.segment]
        points.setdefault(_name(marker.name), (origin + rotation @ np.array(marker.nominal))[None])
    if "SACR" not in points and {"RPSIS", "LPSIS"} <= points.keys():
        points["SACR"] = (points["RPSIS"] + points["LPSIS"]) / 2.0
    own = joint_centres(model)
    for side in "rl":
        if f"femur_{side}" in frames:
            points[f"hip_{side}"] = frames[f"femur_{side}"][1][None]
        for joint, landmarks in _MIDDLES.items():
            ends = [points.get(f"{side.upper()}{landmark}") for landmark in landmarks]
            if ends[0] is not None and ends[1] is not None:
                points[f"{joint}_{side}"] = (ends[0] + ends[1]) / 2.0
            elif f"{joint}_{side}" in own:
                segment, at = own[f"{joint}_{side}"]
                rotation, origin = frames[segment]
                points[f"{joint}_{side}"] = (origin + rotation @ np.array(at))[None]
        points |= _ankle_kinds(points, side)
    return points


def _ankle_kinds(points: Points, side: str) -> Points:
    """A model's ankle as it would be found between the malleoli, and from the lateral one."""
    ankle, knee = points.get(f"ankle_{side}"), points.get(f"knee_{side}")
    if ankle is None:
        return {}
    lateral = points.get(f"{side.upper()}LM")
    chord = None
    if lateral is not None and knee is not None:
        chord = chord_centre(knee, lateral, 2.0 * lateral - ankle, np.linalg.norm(lateral - ankle, axis=1))
        chord = lift_ankle(chord, knee)
    return {
        f"ankle_{side}_middle": ankle,
        f"ankle_{side}_chord": ankle if chord is None or not np.isfinite(chord).all() else chord,
    }
