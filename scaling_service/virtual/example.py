"""Virtual persons to try everything on: as sessions, with something hidden in recordings, and as files.

A search that does not know what was hidden is to find it.
"""

from __future__ import annotations

import csv
import dataclasses
import json
import sys
from collections import abc
from pathlib import Path
from typing import Any

import numpy as np

from scaling_service.bones import whole
from scaling_service.core.arrays import Array
from scaling_service.core.progress import show_nothing
from scaling_service.core.streams import stream
from scaling_service.files.image_markers import COLUMNS
from scaling_service.files.trc import write_trc
from scaling_service.model import body
from scaling_service.model import compile as compiling
from scaling_service.model.anatomy.lengths import find_joint_centres
from scaling_service.model.parameters import compute_axis
from scaling_service.model.poses import pose_neutral_frames
from scaling_service.model.subject import Session
from scaling_service.model.trial import Bone, ImageEvidence, ImagePose
from scaling_service.numerics.multibody.tree import pose_markers
from scaling_service.virtual import artefact, subject
from scaling_service.virtual.bones.person import make_virtual_bones

Progress = abc.Callable[[str], None]

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

RECORDED = subject.VirtualSettings(artefact=0.0, functional_s=5.0)
"""Chosen: the skin rests but for what is hidden, so that all there is to find is known; five seconds of each
movement are found to be enough, and are searched in seconds."""

SLIDING = artefact.Hidden(
    kind="soft_tissue_artefact",
    where=("RLFE",),
    parameters={"x_mm_per_deg": 0.24, "y_mm_per_deg": 0.32, "z_mm_per_deg": 0.0},
    driver=("knee_angle_r",),
)
"""A marker of the thigh that slides with the knee: 0.4 mm/deg in all, twice the usual size of a knee's share
(``THIGH_MM_PER_DEG``), in a person whose skin is still elsewhere."""

SWAPPED = artefact.Hidden(
    kind="marker_swap", where=("LLM", "LMM"), parameters={"start_s": 2.0, "end_s": 2.6}, trial="knee_l"
)
"""The two markers of an ankle exchanged for 0.6 s, as trackers do after one was hidden (chosen)."""

_M_PER_MM, _RAD_PER_DEG = 1e-3, np.pi / 180.0

PREFIX = "V"
"""Before every label, as trackers write it where several persons can be seen."""

DOCUMENT = "subject.json"
IMAGE_MARKERS = "image_markers.csv"

LABELS: abc.Mapping[str, str] = {
    f"{side}{marker}": f"{PREFIX}:{side}{label}"
    for side in "RL"
    for marker, label in (
        ("ASIS", "ASI"),
        ("PSIS", "PSI"),
        ("LFE", "KNE"),
        ("MFE", "KNM"),
        ("FH", "FH"),
        ("LM", "ANK"),
        ("MM", "MMA"),
    )
}
"""Model marker to its label in the recordings: as many laboratories write them."""

R_OURS_LAB = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""The recordings' axes: Z up, as most laboratories have it; the person walks along X."""

_MM = 1e3


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class VirtualImage:
    """What was imaged, and beside it the truth; all in the image's frame, m."""

    bones: abc.Mapping[str, Bone]
    """``pelvis``, ``femur_r``, ``tibia_r``, ``femur_l``, ``tibia_l`` to surfaces as reconstructed."""
    markers: abc.Mapping[
        str, tuple[str, body.Vector]
    ]  # skin markers as seen: model marker to (segment, position)
    centres: abc.Mapping[str, body.Vector]
    axes: abc.Mapping[str, body.Vector]
    landmarks: abc.Mapping[str, body.Vector]
    """``centres``, ``axes``, ``landmarks``: the truth under the names of ``ImageEvidence``: joint centres,
    knee axes (unit vectors to the right) and points on bone."""
    poses: abc.Mapping[str, ImagePose]  # segment to where its true frame lies


def make_virtual_image(person: subject.VirtualSubject, *, progress: Progress | None = None) -> VirtualImage:
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
    # The standing person's segments in an image that lies anywhere and is turned anyhow
    rng = stream(person.seed, "image", "frame")
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    shift = _FRAME_M * rng.normal(size=3)
    frames = pose_neutral_frames(person.model, person.artefact.reference)
    poses = {
        name: ImagePose(turn @ rotation, turn @ origin + shift)
        for name, (rotation, origin) in frames.items()
        if name in person.model.segment_names
    }
    found = make_virtual_bones(person, progress=progress)
    bones = {}
    for name, (vertices, faces) in found.meshes.items():
        # A bone's surface in the image, as reconstructed
        pose = poses[name]
        spread = 1e-3 * person.settings.image * SURFACE_MM / _MEAN_OF_NORMAL
        # A smooth random field of vectors at points (n, 3), each component of SD 1: a sum of plane waves
        # whose wave vectors are normal, so that the field's correlation falls with distance as a Gaussian
        # does (random Fourier features; Rahimi and Recht 2007).
        rng = stream(person.seed, "image", "surface", name)
        waves = rng.normal(size=(3, 3, _WAVES)) / SURFACE_LENGTH_M
        phases = rng.uniform(0.0, 2.0 * np.pi, (3, _WAVES))
        field = [np.cos(vertices @ k + phase).sum(axis=1) for k, phase in zip(waves, phases, strict=True)]
        away = np.asarray(np.sqrt(2.0 / _WAVES) * np.column_stack(field))
        bones[name] = Bone(_place_points(pose, vertices + spread * away), faces)
    knees = {knee: compute_axis(tilt) for knee, tilt in person.tilts.items()}
    # Where the person wears them, misplaced as in the recordings, as far as they can be located
    spread = 1e-3 * person.settings.image * MARKER_MM
    worn = {}
    for marker in person.model.markers:
        if marker.weight > 0.0:
            at = _place_points(poses[marker.segment], np.array(marker.nominal))
            error = spread * stream(person.seed, "image", "marker", marker.name).normal(size=3)
            worn[marker.name] = (marker.segment, body.to_vector(at + error))
    return VirtualImage(
        bones=bones,
        markers=worn,
        centres={
            name: body.to_vector(_place_points(poses[segment], np.array(at)))
            for name, (segment, at) in find_joint_centres(person.model).items()
        },
        axes={
            knee: body.to_vector(poses[f"femur_{knee[-1]}"].rotation @ axis) for knee, axis in knees.items()
        },
        landmarks={
            name: body.to_vector(_place_points(poses[segment], at))
            for name, (segment, at) in found.landmarks.items()
        },
        poses=poses,
    )


def read_image_evidence(image: VirtualImage, *, progress: Progress | None = None) -> ImageEvidence:
    """What landmarking reads from an image; the truth in it is not looked at.

    ``progress``: called with the name of each bone before its turn. MeshRefused: landmarking refuses a bone.
    """
    meshes = {name: (bone.vertices, bone.faces) for name, bone in image.bones.items()}
    return whole.collect_evidence(whole.find_landmarks(meshes, progress=progress), image.markers, image.bones)


def _place_points(pose: ImagePose, points: Array) -> Array:
    """Points of a segment, (n, 3) or (3,), in the image, m."""
    return points @ pose.rotation.T + pose.origin


def make_demo_session(
    seed: int,
    settings: subject.VirtualSettings | None = None,
    *,
    images: bool = False,
    progress: abc.Callable[[str], None] | None = None,
) -> tuple[Session, subject.VirtualSubject]:
    """A virtual subject as a session, recordings processed: functional movements fit, gait is held out.

    ``images``: whether the person's bones were imaged too; making them and reading their landmarks takes
    seconds. ``progress``: called with what is done, where bones are made.
    """
    person = subject.make_virtual_subject(seed, settings or subject.VirtualSettings())
    trials = {name: subject.process_recording(trial, person.generic) for name, trial in person.trials.items()}
    session = subject.make_session(person, person.generic, trials)
    if images:
        report = progress or show_nothing
        image = make_virtual_image(person, progress=lambda bone: report(f"making the {bone}"))
        found = read_image_evidence(image, progress=lambda bone: report(f"landmarks of the {bone}"))
        session = dataclasses.replace(session, images=found)
    return session, person


def make_hidden_session(
    seed: int, settings: subject.VirtualSettings = RECORDED
) -> tuple[Session, subject.VirtualSubject, tuple[artefact.Hidden, ...]]:
    """A person's own model, recordings that hold more than it, and what was hidden.

    The model is the person's: sizes, knee axes and markers are right. Functional movements fit, walking is
    held out; recordings are neither smoothed nor filled.
    """
    person = subject.make_virtual_subject(seed, settings)
    # The model with the marker that slides
    (name,), (driver,) = SLIDING.where, SLIDING.driver
    gains = [_M_PER_MM / _RAD_PER_DEG * SLIDING.parameters[f"{axis}_mm_per_deg"] for axis in "xyz"]
    moved = artefact.glide_marker(person.model.marker(name), {driver: body.to_vector(gains)})
    sliding = person.model.with_markers(tuple(moved if m.name == name else m for m in person.model.markers))
    trials = {}
    for name, trial in person.trials.items():
        # The recording with the marker where its skin took it; noise and gaps stay.
        q, names = person.motions[trial.name], trial.labels
        away = _place_marker(sliding, names, q) - _place_marker(person.model, names, q)
        markers = trial.markers + away
        if name == SWAPPED.trial:
            pair = [trial.index(label) for label in SWAPPED.where]
            start, end = SWAPPED.parameters["start_s"], SWAPPED.parameters["end_s"]
            rows = np.flatnonzero((trial.times >= start - 1e-9) & (trial.times <= end + 1e-9))
            markers[rows[:, None], pair] = markers[rows[:, None], pair[::-1]]
        trials[name] = dataclasses.replace(trial, markers=markers)
    return subject.make_session(person, person.model, trials), person, (SLIDING, SWAPPED)


def _place_marker(model: body.BodyModel, names: tuple[str, ...], q: Array) -> Array:
    return pose_markers(compiling.compile_model(model, names), q, compiling.list_parameter_values(model))


def write_example(
    folder: Path,
    name: str = "example",
    seed: int = 0,
    *,
    imaged: bool = True,
    strides: float = RECORDED.strides,
) -> dict[str, Any]:
    """Write a virtual person's files, and the document that names them as ``subject.json``.

    Functional movements fit, walking is held out; bones are imaged. In the recordings two things are hidden
    that a model does not have: a marker slides with the knee, and two labels are exchanged for a while.

    ``folder``: is there, and empty. ``name``: of the subject. ``seed``: decides the person.
    ``imaged``: whether there are bones. ``strides``: of each walk. Returns the document.
    """
    session, person, _hidden = make_hidden_session(seed, dataclasses.replace(RECORDED, strides=strides))
    for trial in ((session.static,) if session.static is not None else ()) + session.dynamic:
        file = folder / f"{trial.name}.trc"
        named = trial.relabel(dict(LABELS))
        write_trc(file, dataclasses.replace(named, markers=trial.markers @ R_OURS_LAB))
    known = session.subject
    document = {
        "subject": {
            "id": name,
            "sex": known.sex,
            "height_m": round(known.height_m or 0.0, 3),
            "mass_kg": round(known.mass_kg or 0.0, 1),
        },
        "model": known.model,
        "trials": {
            "static": "static.trc",
            "calibration": [f"{trial.name}.trc" for trial in session.calibration],
            "evaluation": [f"{trial.name}.trc" for trial in session.evaluation],
        },
    }
    if imaged:
        import trimesh  # only here: it takes a third of a second
        from trimesh.exchange.stl import export_stl

        image = make_virtual_image(person)
        for segment, bone in image.bones.items():
            (folder / f"{segment}.stl").write_bytes(
                bytes(export_stl(trimesh.Trimesh(_MM * bone.vertices, bone.faces, process=False)))
            )
        file = folder / IMAGE_MARKERS
        with file.open("w", encoding="utf-8", newline="") as stream:
            rows = csv.writer(stream)
            rows.writerow(COLUMNS)
            for marker, (segment, at) in image.markers.items():
                rows.writerow([marker, segment, *(f"{_MM * value:.3f}" for value in at)])
        document["bones"] = {"units": "mm"} | {bone: f"{bone}.stl" for bone in image.bones}
        document["image_markers"] = IMAGE_MARKERS
    (folder / DOCUMENT).write_text(json.dumps(document, indent=1), encoding="utf-8")
    return document


if __name__ == "__main__":
    write_example(Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]))
