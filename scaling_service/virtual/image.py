"""A virtual person's image: bones and skin markers in a frame of its own, with the image's errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from scaling_service.bones.whole import collect_evidence, find_landmarks
from scaling_service.core.streams import stream
from scaling_service.model.anatomy.lengths import find_joint_centres
from scaling_service.model.body import Vector, to_vector
from scaling_service.model.parameters import compute_axis
from scaling_service.model.poses import pose_neutral_frames
from scaling_service.model.trial import Bone, ImageEvidence, ImagePose
from scaling_service.numerics.multibody.laws import Array
from scaling_service.virtual.bones.person import make_virtual_bones
from scaling_service.virtual.subject import VirtualSubject

Progress = Callable[[str], None]

MARKER_MM = 0.35
"""SD of each coordinate of a marker: reproducibility of spheres set on biplanar radiographs (Sauret et al.
2016, as given by Puchaud 2019, section 2.2.3)."""

SURFACE_MM = 1.0
"""Mean distance between a bone reconstructed from biplanar radiographs and from computed tomography: Baudoin
et al. 2008, Med Biol Eng Comput 46:799, upper ends of 13 femurs."""

SURFACE_LENGTH_M = 0.04
"""Distance over which surface errors are alike; chosen, about an end of a bone: a template fitted to contours
is wrong by whole ends, not by points."""

_WAVES = 64  # chosen: in the random field, enough for a normal distribution
_MEAN_OF_NORMAL = float(np.sqrt(2.0 / np.pi))  # mean of |u| for u of SD 1
_FRAME_M = 0.5  # chosen: SD of the image's origin about the standing person's


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class VirtualImage:
    """What was imaged, and beside it the truth; all in the image's frame, m."""

    bones: Mapping[str, Bone]
    """``pelvis``, ``femur_r``, ``tibia_r``, ``femur_l``, ``tibia_l`` to surfaces as reconstructed."""
    markers: Mapping[str, tuple[str, Vector]]  # skin markers as seen: model marker to (segment, position)
    centres: Mapping[str, Vector]
    axes: Mapping[str, Vector]
    landmarks: Mapping[str, Vector]
    """``centres``, ``axes``, ``landmarks``: the truth under the names of ``ImageEvidence``: joint centres,
    knee axes (unit vectors to the right) and points on bone."""
    poses: Mapping[str, ImagePose]  # segment to where its true frame lies


def make_virtual_image(person: VirtualSubject, *, progress: Progress | None = None) -> VirtualImage:
    """Image a person, standing as in the standing trial but at rest.

    The size of all errors is the person's ``settings.image``; zero is an exact image.

    ``progress``: called with the name of each bone before its turn.

    Examples
    --------
    >>> from scaling_service.virtual.subject import VirtualSettings, make_virtual_subject
    >>> short = VirtualSettings(functional_s=0.1, static_s=0.1, gait_trials=0)
    >>> sorted(make_virtual_image(make_virtual_subject(1, short)).bones)
    ['femur_l', 'femur_r', 'pelvis', 'tibia_l', 'tibia_r']
    """
    poses = _pose_segments(person)
    found = make_virtual_bones(person, progress=progress)
    bones = {
        name: Bone(_reconstruct_surface(person, name, poses[name], vertices), faces)
        for name, (vertices, faces) in found.meshes.items()
    }
    knees = {knee: compute_axis(tilt) for knee, tilt in person.tilts.items()}
    return VirtualImage(
        bones=bones,
        markers=_place_markers(person, poses),
        centres={
            name: to_vector(_place_points(poses[segment], np.array(at)))
            for name, (segment, at) in find_joint_centres(person.model).items()
        },
        axes={knee: to_vector(poses[f"femur_{knee[-1]}"].rotation @ axis) for knee, axis in knees.items()},
        landmarks={
            name: to_vector(_place_points(poses[segment], at))
            for name, (segment, at) in found.landmarks.items()
        },
        poses=poses,
    )


def read_image_evidence(image: VirtualImage, *, progress: Progress | None = None) -> ImageEvidence:
    """What landmarking reads from an image; the truth in it is not looked at.

    ``progress``: called with the name of each bone before its turn. MeshRefused: landmarking refuses a bone.
    """
    meshes = {name: (bone.vertices, bone.faces) for name, bone in image.bones.items()}
    return collect_evidence(find_landmarks(meshes, progress=progress), image.markers, image.bones)


def _pose_segments(person: VirtualSubject) -> dict[str, ImagePose]:
    """The standing person's segments in an image that lies anywhere and is turned anyhow."""
    rng = stream(person.seed, "image", "frame")
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    shift = _FRAME_M * rng.normal(size=3)
    frames = pose_neutral_frames(person.model, person.artefact.reference)
    return {
        name: ImagePose(turn @ rotation, turn @ origin + shift)
        for name, (rotation, origin) in frames.items()
        if name in person.model.segment_names
    }


def _place_points(pose: ImagePose, points: Array) -> Array:
    """Points of a segment, (n, 3) or (3,), in the image, m."""
    return points @ pose.rotation.T + pose.origin


def _place_markers(person: VirtualSubject, poses: Mapping[str, ImagePose]) -> dict[str, tuple[str, Vector]]:
    """Where the person wears them, misplaced as in the recordings, as far as they can be located."""
    spread = 1e-3 * person.settings.image * MARKER_MM
    found = {}
    for marker in person.model.markers:
        if marker.weight > 0.0:
            at = _place_points(poses[marker.segment], np.array(marker.nominal))
            error = spread * stream(person.seed, "image", "marker", marker.name).normal(size=3)
            found[marker.name] = (marker.segment, to_vector(at + error))
    return found


def _reconstruct_surface(person: VirtualSubject, bone: str, pose: ImagePose, vertices: Array) -> Array:
    """A bone's surface in the image, as reconstructed."""
    spread = 1e-3 * person.settings.image * SURFACE_MM / _MEAN_OF_NORMAL
    return _place_points(
        pose, vertices + spread * _draw_waves(stream(person.seed, "image", "surface", bone), vertices)
    )


def _draw_waves(rng: np.random.Generator, points: Array) -> Array:
    """A smooth random field of vectors at points (n, 3), each component of SD 1.

    A sum of plane waves whose wave vectors are normal, so that the field's correlation falls with distance
    as a Gaussian does (random Fourier features; Rahimi and Recht 2007).
    """
    waves = rng.normal(size=(3, 3, _WAVES)) / SURFACE_LENGTH_M
    phases = rng.uniform(0.0, 2.0 * np.pi, (3, _WAVES))
    field = [np.cos(points @ k + phase).sum(axis=1) for k, phase in zip(waves, phases, strict=True)]
    return np.asarray(np.sqrt(2.0 / _WAVES) * np.column_stack(field))
