"""From landmarks of bones to what images say of a model's joints and markers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from scaling_service.bones.results import Array, BoneLandmarks
from scaling_service.model.body import Vector
from scaling_service.model.trial import Bone, ImageEvidence

_CENTRES = {"femur": {"hip_centre": "hip", "knee_centre": "knee"}, "tibia": {"ankle_centre": "ankle"}}
_LANDMARKS = {
    "pelvis": {"asis_r": "RASIS", "asis_l": "LASIS", "psis_r": "RPSIS", "psis_l": "LPSIS"},
    "femur": {"epicondyle_lateral": "LFE", "epicondyle_medial": "MFE"},
    "tibia": {"fibula_head": "FH", "malleolus_lateral": "LM", "malleolus_medial": "MM"},
}
"""Points on bone, by bone, and the markers that are put on them; of a leg without its side."""


def evidence_of(
    found: Mapping[str, BoneLandmarks],
    markers: Mapping[str, tuple[str, Vector]],
    bones: Mapping[str, Bone],
) -> ImageEvidence:
    """Landmarks under the names of a built-in leg model's joints and markers.

    Parameters
    ----------
    found : mapping
        Bone (``pelvis``, ``femur_r`` …) to its landmarks, all of one image.
    markers : mapping
        Skin markers seen in that image: model marker to (segment, position in m).
    bones : mapping
        The surfaces themselves.
    """
    return ImageEvidence(
        dict(_centres(found)),
        {f"knee_{b.side}": _vector(b.axes["knee"]) for b in found.values() if "knee" in b.axes},
        dict(_landmarks(found)),
        dict(markers),
        "landmarks of bone meshes",
        dict(bones),
    )


def _centres(found: Mapping[str, BoneLandmarks]) -> Iterator[tuple[str, Vector]]:
    """Joint centres; a hip whose femur is not there is the centre of its socket."""
    pelvis = found.get("pelvis")
    for side in "rl" if pelvis is not None else "":
        if pelvis is not None and f"acetabulum_{side}" in pelvis.points:
            yield f"hip_{side}", _vector(pelvis.points[f"acetabulum_{side}"])
    for bone in found.values():
        for point, joint in _CENTRES.get(bone.bone, {}).items():
            if point in bone.points:
                yield f"{joint}_{bone.side}", _vector(bone.points[point])


def _landmarks(found: Mapping[str, BoneLandmarks]) -> Iterator[tuple[str, Vector]]:
    for bone in found.values():
        letter = (bone.side or "").upper()
        for point, marker in _LANDMARKS.get(bone.bone, {}).items():
            if point in bone.points:
                yield f"{letter}{marker}", _vector(bone.points[point])


def _vector(point: Array) -> Vector:
    x, y, z = point.tolist()
    return (x, y, z)
