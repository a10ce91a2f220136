"""What an image shows of a pelvis and a thigh, and of lengths from which other sizes are estimated."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection

import numpy as np

from scaling_service.capabilities.scaling.methods.marker_based import scale_linearly
from scaling_service.capabilities.scaling.methods.people_prior import ENDS, SPINES
from scaling_service.capabilities.shared.settings import CalibrationSettings
from scaling_service.core.errors import SubjectInvalid
from scaling_service.core.names import say_name
from scaling_service.model.anatomy import frames
from scaling_service.model.anatomy.lengths import find_segment, measure_segment_lengths
from scaling_service.model.anatomy.markers import find_canonical
from scaling_service.model.body import BodyModel
from scaling_service.model.results import Calibration
from scaling_service.model.subject import Session
from scaling_service.model.trial import ImageEvidence
from scaling_service.numerics.multibody.laws import Array

_DOUBTFUL, _DOUBTFUL_HIPS, _IMPOSSIBLE = 0.10, 0.15, 0.30
"""Chosen: how far a bone, or hips from each other, may be from the length by markers before it is warned of,
and before it is refused. Femurs by markers differed from images by 4 ± 14 mm over 26 persons (Puchaud 2019,
section 3.1), three deviations of which are a tenth of a femur, hips by up to 10 %."""


def find_imaged_spines(evidence: ImageEvidence) -> tuple[dict[str, Array], bool]:
    """The four spines in the image, (3,) m, and True; or the markers over them and False; or nothing."""
    skin = {find_canonical(name) or name: at for name, (_, at) in evidence.markers.items()}
    for points, bony in ((evidence.landmarks, True), (skin, False)):
        if all(name in points for name in SPINES):
            return {name: np.array(points[name]) for name in SPINES}, bony
    return {}, False


def find_imaged_pelvis(evidence: ImageEvidence) -> frames.Frames | None:
    """The pelvis frame of the spines, or of the markers over them, where all four are in the image."""
    spines, _ = find_imaged_spines(evidence)
    return frames.build_pelvis_frame(*spines.values()) if spines else None


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ImagedParts:
    """What of a model an image shows well enough to lay it there; ``thighs``, ``shanks``: sides."""

    pelvis: frames.Frames | None  # frame of its spines, where a hip centre is known, too
    thighs: tuple[str, ...]
    shanks: tuple[str, ...]  # each below its thigh


def find_imaged_parts(model: BodyModel, evidence: ImageEvidence) -> ImagedParts:
    """A pelvis by spines and a hip, a thigh by hip, knee and its condyles, a shank by the ankle below it."""
    known, pelvis = evidence.centres.keys(), find_imaged_pelvis(evidence)
    placed = find_segment(model, "pelvis", "") is not None and not known.isdisjoint(("hip_r", "hip_l"))
    thighs = tuple(
        side
        for side in "rl"
        if {f"hip_{side}", f"knee_{side}"} <= known
        and all(find_segment(model, role, side) is not None for role in ("femur", "tibia"))
        and (
            {f"{side.upper()}LFE", f"{side.upper()}MFE"} <= evidence.landmarks.keys()
            or (f"knee_{side}" in evidence.axes and pelvis is not None)
        )
    )
    shanks = tuple(side for side in thighs if f"ankle_{side}" in known)
    return ImagedParts(pelvis=pelvis if placed else None, thighs=thighs, shanks=shanks)


def find_epicondyles(evidence: ImageEvidence, side: str, knee: Array) -> tuple[Array, Array]:
    """The epicondyles, lateral first; where they are not known, points on the flexion axis in their stead.

    ``knee``: its centre, (3,), in the image, m. Raises SubjectInvalid: neither they nor the axis are known.
    """
    names = [f"{side.upper()}{name}" for name in ("LFE", "MFE")]
    if all(name in evidence.landmarks for name in names):
        lateral, medial = (np.array(evidence.landmarks[name]) for name in names)
        return lateral, medial
    axis, pelvis = evidence.axes.get(f"knee_{side}"), find_imaged_pelvis(evidence)
    if axis is None or pelvis is None:
        raise SubjectInvalid(
            f"neither the epicondyles nor the flexion axis of knee_{side} are known",
            field=f"bones.femur_{side}",
            remedy="Give the femur with its condyles",
        )
    right = pelvis.rotation[0, :, 2]
    outward = np.array(axis) * np.sign(np.array(axis) @ (right if side == "r" else -right))
    return knee + outward, knee - outward


def doubt_sizes(by_markers: BodyModel, by_image: BodyModel, imaged: Collection[str]) -> list[str]:
    """A warning for every bone whose length does not fit the markers.

    ``imaged``: segments whose bones were imaged. Raises SubjectInvalid: a length is out by so much that bones
    and recordings cannot be of one person, or the unit of either is wrong.
    """
    marked, shown = measure_segment_lengths(by_markers), measure_segment_lengths(by_image)
    parts = {"inter_hip": find_segment(by_image, "pelvis", "")}
    for side in "rl":
        parts |= {f"femur_{side}": find_segment(by_image, "femur", side)}
        parts |= {f"shank_{side}": find_segment(by_image, "tibia", side)}
    notes = []
    for name in sorted(marked.keys() & shown.keys() & parts.keys()):
        off = shown[name] / marked[name] - 1.0
        bone, skin = 1e3 * shown[name], 1e3 * marked[name]
        said = f"{say_name(name)} is {bone:.0f} mm by the bones and {skin:.0f} mm by the markers"
        if parts[name] in imaged and abs(off) > _IMPOSSIBLE:
            raise SubjectInvalid(
                said,
                field="bones",
                remedy="Check that bones and recordings are of one person, and the unit of the bones",
            )
        if parts[name] in imaged and abs(off) > (_DOUBTFUL_HIPS if name == "inter_hip" else _DOUBTFUL):
            notes.append(f"EB: {said}: check that they are of one person, and the unit of the bones")
    return notes


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
        for name, (first, second) in ENDS.items()
        if name in measure_segment_lengths(model) and first in centres and second in centres
    }


def shows_sizes(evidence: ImageEvidence, model: BodyModel) -> bool:
    """Whether an image shows a part of a model whole, or a length of it."""
    parts = find_imaged_parts(model, evidence)
    return parts.pelvis is not None or bool(parts.thighs) or bool(find_lengths(evidence, model))


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
    return start if session.scale_setup is not None or not legs else scale_linearly(session, settings, legs)


def size_by_lengths(
    session: Session, settings: CalibrationSettings, start: Calibration, evidence: ImageEvidence
) -> Calibration:
    """The marker-based model with bones among what its sizes are estimated from, each with its deviation."""
    lengths = find_lengths(evidence, start.model)
    if not lengths or session.scale_setup is not None:
        raise SubjectInvalid(
            "the images show neither a pelvis with a hip, nor a whole thigh, nor a length of a bone"
            if not lengths
            else "a scale set-up sizes all segments, and the images show no pelvis with a hip and no thigh",
            field="bones",
            remedy="Give pelvis and femur, or femur and tibia of one side, for a model with these segments",
        )
    found = scale_linearly(session, settings, lengths)
    parts = {name: name.replace("shank", "tibia").replace("inter_hip", "pelvis") for name in lengths}
    own = [s for part in parts.values() if (s := find_segment(found.model, *_split_role(part))) is not None]
    sizes = ", ".join(f"{say_name(name)} {1e3 * length:.0f} mm" for name, length in lengths.items())
    notes = [
        f"EB: neither a pelvis with a hip nor a whole thigh was imaged: bones give {sizes}; joints' axes and "
        "centres stay as markers have them, and other sizes are those of persons with such bones, as far as "
        "markers allow"
    ]
    return dataclasses.replace(
        found,
        method="EB",
        warnings=(*found.warnings, *notes),
        bone_sized=dict.fromkeys(own, "own"),
    )


def _split_role(part: str) -> tuple[str, str]:
    """``femur_r`` as role and side; the pelvis has none."""
    role, _, side = part.rpartition("_") if part != "pelvis" else (part, "", "")
    return role, side
