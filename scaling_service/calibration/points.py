"""The points that lengths are measured between, on a person's recording and on a model."""

from __future__ import annotations

import numpy as np

from scaling_service.anatomy.hip_centre import hip_centres
from scaling_service.anatomy.markers import canonical
from scaling_service.calibration.functional import FunctionalJoints
from scaling_service.calibration.measurements import Points
from scaling_service.kernels.laws import Array
from scaling_service.models.body import BodyModel
from scaling_service.models.neutral import neutral_frames
from scaling_service.models.trial import Trial

_PELVIS = ("RASIS", "LASIS", "RPSIS", "LPSIS")


def person_points(
    trial: Trial, *, standing: bool, regression: str, joints: FunctionalJoints | None = None
) -> Points:
    """Landmarks of a recording by canonical name, with the hip centres.

    Parameters
    ----------
    standing : bool
        Only a standing trial gives the leg length that the fuller regressions use.
    regression : str
        Gives the hip centres that ``joints`` does not.
    joints : FunctionalJoints, optional
    """
    points: dict[str, Array] = {}
    for label in trial.labels:
        landmark = canonical(label)
        if landmark is not None:
            points.setdefault(landmark, trial.position(label))
    sacrum = points.get("SACR")  # stands for both PSIS where they were not marked
    pelvis = [points.get(name, sacrum if name.endswith("PSIS") else None) for name in _PELVIS]
    known = [p for p in pelvis if p is not None]
    if len(known) == len(_PELVIS):
        legs = [_leg_length(points, side) if standing else None for side in "RL"]
        hips = hip_centres(*known, regression=regression, leg_length_r=legs[0], leg_length_l=legs[1])
        points |= {"hip_r": hips.right_ground, "hip_l": hips.left_ground}
    if joints is not None:
        points |= {f"hip_{side}": joints.hip_in(trial, side) for side in joints.hips}
    return points


def _leg_length(points: Points, side: str) -> float | None:
    """ASIS to medial malleolus, mean over the frames that show both (m)."""
    ends = (points.get(f"{side}ASIS"), points.get(f"{side}MM"))
    if ends[0] is None or ends[1] is None:
        return None
    distance = np.linalg.norm(ends[0] - ends[1], axis=1)
    return float(np.nanmean(distance)) if np.isfinite(distance).any() else None


def model_points(model: BodyModel) -> Points:
    """The same points on the model in its neutral pose, one frame."""
    points: dict[str, Array] = {}
    frames = neutral_frames(model)
    for marker in model.markers:
        landmark = canonical(marker.name)
        if landmark is not None:
            rotation, origin = frames[marker.segment]
            points.setdefault(landmark, (origin + rotation @ np.array(marker.nominal))[None])
    for side in "rl":
        if f"femur_{side}" in frames:
            points[f"hip_{side}"] = frames[f"femur_{side}"][1][None]
    return points
