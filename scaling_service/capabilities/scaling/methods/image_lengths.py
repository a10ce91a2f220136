"""Lengths of imaged bones among what a person's other sizes are estimated from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scaling_service.capabilities.scaling.methods.image_points import doubt_sizes
from scaling_service.capabilities.scaling.methods.marker_based import scale_linearly
from scaling_service.capabilities.shared.settings import CalibrationSettings
from scaling_service.core.errors import SubjectInvalid
from scaling_service.model.anatomy.lengths import find_segment, measure_segment_lengths
from scaling_service.model.body import BodyModel
from scaling_service.model.results import Calibration
from scaling_service.model.subject import Session
from scaling_service.model.trial import ImageEvidence

_ENDS = {"inter_hip": ("hip_r", "hip_l")} | {
    f"{name}_{side}": (f"{upper}_{side}", f"{lower}_{side}")
    for side in "rl"
    for name, upper, lower in (("femur", "hip", "knee"), ("shank", "knee", "ankle"))
}


def find_lengths(evidence: ImageEvidence, model: BodyModel) -> dict[str, float]:
    """Lengths between imaged joint centres, m, of those that the model has.

    Raises SubjectInvalid: a thigh of one side comes with a shank of the other.
    """
    centres = evidence.centres
    for side, other in ("rl", "lr"):
        if f"knee_{side}" in centres and f"ankle_{side}" not in centres and f"ankle_{other}" in centres:
            raise SubjectInvalid(
                f"a femur of one side ({side}) comes with a tibia of the other",
                field="bones",
                remedy="Give pelvis, femur and tibia of one side at least",
            )
    return {
        name: float(np.linalg.norm(np.subtract(centres[first], centres[second])))
        for name, (first, second) in _ENDS.items()
        if name in measure_segment_lengths(model) and first in centres and second in centres
    }


def size_beside_legs(
    session: Session, settings: CalibrationSettings, start: Calibration, evidence: ImageEvidence
) -> Calibration:
    """The marker-based model of a person with such legs: what was not imaged is estimated beside what was.

    How far apart the hips are says little of the rest of a pelvis, so that it plays no part. A scale set-up
    sizes all segments itself.
    """
    legs = {
        name: length for name, length in find_lengths(evidence, start.model).items() if name != "inter_hip"
    }
    return start if session.scale_setup is not None else scale_linearly(session, settings, legs)


def size_by_lengths(
    session: Session, settings: CalibrationSettings, start: Calibration, evidence: ImageEvidence
) -> Calibration:
    """The marker-based model with bones among what its sizes are estimated from, each with its deviation."""
    lengths = find_lengths(evidence, start.model)
    if not lengths or session.scale_setup is not None:
        raise SubjectInvalid(
            "the images show neither a pelvis and one whole leg of the model nor a length of a bone"
            if not lengths
            else "a scale set-up sizes all segments, and the images show no pelvis and one whole leg",
            field="bones",
            remedy="Give pelvis, femur and tibia of at least one side, for a model with these segments",
        )
    found = scale_linearly(session, settings, lengths)
    parts = {name: name.replace("shank", "tibia").replace("inter_hip", "pelvis") for name in lengths}
    own = [s for part in parts.values() if (s := find_segment(found.model, *_split_role(part))) is not None]
    sizes = ", ".join(f"{name} {1e3 * length:.0f} mm" for name, length in lengths.items())
    notes = [
        f"EB: no pelvis with one whole leg was imaged: bones give {sizes}; joints' axes and centres stay as "
        "markers have them, and other sizes are those of persons with such bones, as far as markers allow"
    ]
    doubts = doubt_sizes(start.model, found.model, own)
    return replace(
        found,
        method="EB",
        warnings=(*found.warnings, *notes, *doubts),
        bone_sized=dict.fromkeys(own, "own"),
    )


def _split_role(part: str) -> tuple[str, str]:
    """``femur_r`` as role and side; the pelvis has none."""
    role, _, side = part.rpartition("_") if part != "pelvis" else (part, "", "")
    return role, side
