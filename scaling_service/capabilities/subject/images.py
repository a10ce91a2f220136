"""What a subject's bones and image markers say."""

from __future__ import annotations

import dataclasses
from collections import abc

import numpy as np

from scaling_service.bones import images, results, whole
from scaling_service.core.errors import SubjectInvalid
from scaling_service.core.names import say_name
from scaling_service.core.notes import Note
from scaling_service.files.image_markers import read_image_markers
from scaling_service.model import body, trial
from scaling_service.model.anatomy.bones import find_body
from scaling_service.model.anatomy.markers import find_canonical, match_labels
from scaling_service.model.builtin import BUILTIN_NAMES
from scaling_service.model.subject import Subject

_OTHER_FRAME_M = 0.1
"""Median distance of markers from their landmarks on the bones. Chosen: twice the largest of an MRI (18 to
49 mm, skin and half a marker between them); bones in another frame give 0.1 to 0.6 m."""

_BONES_UNUSED = Note(
    code="bones_unused",
    problem="bones are used with built-in and .osim models only: image-based methods were left out",
    remedy="Choose a built-in model of the legs to use the bones",
)


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Imaged:
    """Bones and markers of one image as they were read, in its frame, m; no model is known yet.

    ``landmarks`` and ``surfaces``: bone to what was found on it, and to its vertices and faces. ``markers``:
    label to the bone it sits on, and where.
    """

    landmarks: abc.Mapping[str, results.BoneLandmarks] = dataclasses.field(default_factory=dict)
    surfaces: abc.Mapping[str, images.Arrays] = dataclasses.field(default_factory=dict)
    markers: abc.Mapping[str, tuple[str, body.Vector]] = dataclasses.field(default_factory=dict)
    notes: tuple[Note, ...] = ()


def read_images(subject: Subject) -> Imaged | None:
    """Read a subject's bones and image markers, None where there are none, and find the bones' landmarks.

    With a model that takes no bones nothing is read, and a note says so. Raises InputError: a file cannot be
    read, or a mesh is not the bone that it is said to be.
    """
    if not subject.bones:
        return None
    if not takes_bones(subject):
        return Imaged(notes=(_BONES_UNUSED,))
    imaged = images.read_bones(subject.bones, subject.bone_units)
    try:
        found = imaged.widen(whole.find_landmarks(imaged.meshes))
        of_image = (*whole.check_joined(found), *imaged.tell())
    except results.MeshRefused as error:
        file = subject.bones.get(error.field or "", subject.bones.get(images.SEGMENTATION))
        name = f"bones.{error.field}" if error.field in subject.bones else error.field
        raise results.MeshRefused(error.problem, file=file, field=name, remedy=error.remedy) from None
    notes: list[Note] = []
    for name, bone in found.items():
        called = say_name(name)
        notes.extend(Note(code="bone", place=name, called=called, problem=text) for text in bone.warnings)
        notes.extend(
            Note(
                code="landmark_refused",
                place=name,
                called=called,
                problem=f"{say_name(point)} was not taken: {why}",
                remedy="Look at the surface of the bone there; without the point, the others are used",
            )
            for point, why in bone.refused.items()
        )
    return Imaged(
        landmarks=found,
        surfaces=imaged.meshes,
        markers={} if subject.image_markers is None else read_image_markers(subject.image_markers),
        notes=(*notes, *(Note(code="image", problem=text) for text in of_image)),
    )


def place_images(
    imaged: Imaged, model: body.BodyModel, wanted: abc.Sequence[str], marker_map: abc.Mapping[str, str]
) -> trial.ImageEvidence | None:
    """What an image says of a model, under its names; None without landmarks.

    ``wanted``: markers to look for. ``marker_map``: model marker to label, as the subject file says. Markers
    on segments that the model does not have are left out. Raises SubjectInvalid: markers and bones are not in
    one frame.
    """
    if not imaged.landmarks:
        return None
    explicit = {marker: label for marker, label in marker_map.items() if label in imaged.markers}
    names = match_labels(list(imaged.markers), wanted, explicit).mapped
    placed = {marker: imaged.markers[label] for marker, label in names.items()}
    markers = {
        marker: (segment, at)
        for marker, (bone, at) in placed.items()
        if (segment := find_body(model, bone) or bone) in model.segment_names
    }
    bones = {find_body(model, name) or name: trial.Bone(*shape) for name, shape in imaged.surfaces.items()}
    found = whole.collect_evidence(imaged.landmarks, markers, bones)
    roles = {find_canonical(marker) or marker: np.array(at) for marker, (_, at) in markers.items()}
    away = [np.linalg.norm(roles[n] - at) for n, at in found.landmarks.items() if n in roles]
    if away and np.median(away) > _OTHER_FRAME_M:
        raise SubjectInvalid(
            f"its markers lie {1e3 * np.median(away):.0f} mm from their landmarks on the bones",
            field="image_markers",
            remedy="Give markers and bones in the frame and unit of one image, in mm",
        )
    return found


def takes_bones(subject: Subject) -> bool:
    """Whether bones can be used with the subject's model."""
    return subject.model in BUILTIN_NAMES or subject.model.lower().endswith(".osim")
