"""What a subject's bones and image markers say."""

from __future__ import annotations

from scaling_service.bones import images, results, whole
from scaling_service.core.notes import Note
from scaling_service.files.image_markers import read_image_markers
from scaling_service.model import body, trial
from scaling_service.model.anatomy.bones import find_body
from scaling_service.model.anatomy.markers import match_labels
from scaling_service.model.builtin import BUILTIN_NAMES
from scaling_service.model.subject import Subject

_BONES_UNUSED = Note(
    code="bones_unused",
    problem="bones are used with built-in and .osim models only: image-based methods were left out",
    remedy="Choose a built-in model of the legs to use the bones",
)


def gather_images(
    subject: Subject, model: body.BodyModel
) -> tuple[trial.ImageEvidence | None, tuple[Note, ...]]:
    """What a subject's bones and image markers say, and what to tell of it.

    Returns ``evidence``: None where there are no bones, or they cannot be used with the model. Raises
    InputError: a file cannot be read, or a mesh is not the bone that it is said to be.
    """
    if not subject.bones:
        return None, ()
    if not takes_bones(subject):
        return None, (_BONES_UNUSED,)
    imaged = images.read_bones(subject.bones, subject.bone_units)
    try:
        found = imaged.widen(whole.find_landmarks(imaged.meshes))
        of_image = (*whole.check_joined(found), *imaged.tell())
    except results.MeshRefused as error:
        file = subject.bones.get(error.field or "", subject.bones.get(images.SEGMENTATION))
        field = f"bones.{error.field}" if error.field in subject.bones else error.field
        raise results.MeshRefused(error.problem, file=file, field=field, remedy=error.remedy) from None
    bones = {find_body(model, name) or name: trial.Bone(*shape) for name, shape in imaged.meshes.items()}
    # Image markers under the model's names, those on segments that the model has
    if subject.image_markers is None:
        markers = {}
    else:
        seen = read_image_markers(subject.image_markers)
        wanted = list(dict.fromkeys([*model.marker_names, *subject.extra_markers]))
        explicit = {marker: label for marker, label in subject.marker_map.items() if label in seen}
        names = match_labels(list(seen), wanted, explicit).mapped
        placed = {marker: seen[label] for marker, label in names.items()}
        markers = {
            marker: (segment, at)
            for marker, (bone, at) in placed.items()
            if (segment := find_body(model, bone) or bone) in model.segment_names
        }
    evidence = whole.collect_evidence(found, markers, bones)
    notes: list[Note] = []
    for name, bone in found.items():
        notes.extend(Note(code="bone", place=name, problem=text) for text in bone.warnings)
        notes.extend(
            Note(
                code="landmark_refused",
                place=name,
                problem=f"{point} was not taken: {why}",
                remedy="Look at the surface of the bone there; without the point, the others are used",
            )
            for point, why in bone.refused.items()
        )
    return evidence, (*notes, *(Note(code="image", problem=text) for text in of_image))


def takes_bones(subject: Subject) -> bool:
    """Whether bones can be used with the subject's model."""
    return subject.model in BUILTIN_NAMES or subject.model.lower().endswith(".osim")
