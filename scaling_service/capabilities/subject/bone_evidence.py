"""From bones and image markers on disk to what images say of a person."""

from __future__ import annotations

from collections.abc import Iterator

from scaling_service.bones.evidence import evidence_of
from scaling_service.bones.refusals import MeshRefused
from scaling_service.bones.results import BoneLandmarks
from scaling_service.bones.whole import UNITS, find_landmarks
from scaling_service.files.image_markers import read_image_markers
from scaling_service.files.mesh import read_mesh
from scaling_service.model.anatomy.markers import match_labels
from scaling_service.model.body import BodyModel, Vector
from scaling_service.model.builtin import BUILTIN_NAMES
from scaling_service.model.subject import Subject
from scaling_service.model.trial import Bone, ImageEvidence


def gather(subject: Subject, model: BodyModel) -> tuple[ImageEvidence | None, tuple[str, ...]]:
    """What a subject's bones and image markers say, and what to tell of it.

    Returns
    -------
    evidence : ImageEvidence or None
        None where there are no bones, or they cannot be used with the model.
    notes : tuple of str

    Raises
    ------
    InputError
        A file cannot be read, or a mesh is not the bone that it is said to be.
    """
    if not subject.bones:
        return None, ()
    if subject.model not in BUILTIN_NAMES:
        return None, ("bones are used with built-in leg models only: image-based methods were left out",)
    scale = UNITS[subject.bone_units]
    meshes = {name: read_mesh(path) for name, path in subject.bones.items()}
    shapes = {name: (scale * mesh.vertices, mesh.faces) for name, mesh in meshes.items()}
    try:
        found = find_landmarks(shapes)
    except MeshRefused as error:
        file = subject.bones.get(error.field or "")
        field = f"bones.{error.field}" if error.field in subject.bones else error.field
        raise MeshRefused(error.problem, file=file, field=field, remedy=error.remedy) from None
    bones = {name: Bone(*shape) for name, shape in shapes.items()}
    evidence = evidence_of(found, _markers(subject, model), bones)
    told = [f"{name}: {text}" for name, bone in found.items() for text in (*bone.warnings, *_refused(bone))]
    return evidence, tuple(told)


def _refused(bone: BoneLandmarks) -> Iterator[str]:
    return (f"{point} was not taken: {why}" for point, why in bone.refused.items())


def _markers(subject: Subject, model: BodyModel) -> dict[str, tuple[str, Vector]]:
    """Image markers under the model's names, those on segments that the model has."""
    if subject.image_markers is None:
        return {}
    seen = read_image_markers(subject.image_markers)
    wanted = list(dict.fromkeys([*model.marker_names, *subject.extra_markers]))
    explicit = {marker: label for marker, label in subject.marker_map.items() if label in seen}
    names = match_labels(list(seen), wanted, explicit).mapped
    return {m: seen[label] for m, label in names.items() if seen[label][0] in model.segment_names}
