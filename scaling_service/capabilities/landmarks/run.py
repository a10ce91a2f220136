"""Landmarks of bones: load meshes, find, write ``landmarks.json``."""

from __future__ import annotations

import time
from collections import abc
from pathlib import Path
from typing import Any, Literal

import numpy as np

from scaling_service.bones import images, results, whole
from scaling_service.capabilities.landmarks import result as documents
from scaling_service.capabilities.subject.reading import hash_file
from scaling_service.core.arrays import Array
from scaling_service.core.errors import InputError
from scaling_service.core.names import say_name
from scaling_service.core.progress import Progress, show_nothing
from scaling_service.documents import writing

FILE_NAME = "landmarks.json"
DETECT = "detect"  # in place of a unit: the one in which the bones have the size of bones

_MM = 1e3


def landmark_bones(
    bones: abc.Mapping[str, Path], *, units: str = DETECT, progress: Progress = show_nothing
) -> documents.LandmarksDocument:
    """Find the landmarks of the bones of one image.

    ``bones``: ``pelvis``, ``femur_r``, … to a mesh file, all in the image's axes, or ``segmentation`` to a
    label map or a folder. ``units``: of all files:
    ``mm``, ``cm``, ``m`` or ``detect``. InputError: a file cannot be read, or a mesh cannot be used; with
    file, bone and remedy.
    """
    began = time.perf_counter()
    if not bones:
        raise InputError("no bone is given", remedy=f"Give at least one of --{', --'.join(whole.BONES)}")
    imaged = images.read_bones(bones, None if units == DETECT else units)
    shapes = imaged.meshes
    done: list[str] = []

    def starting(name: str) -> None:
        progress(name, len(done) / len(shapes))
        done.append(name)

    try:
        found = imaged.widen(whole.find_landmarks(shapes, progress=starting))
    except results.MeshRefused as error:
        file = bones.get(error.field or "", bones.get(images.SEGMENTATION))
        raise results.MeshRefused(error.problem, file=file, field=error.field, remedy=error.remedy) from None
    try:
        doubts = whole.check_joined(found)
    except results.MeshRefused as error:  # bones may each lie in a frame of their own
        doubts = (
            f"{say_name(error.field or '')}: {error.problem}: another frame or person, which image-based "
            "methods refuse",
        )
    notes = (*doubts, *imaged.tell())
    described: dict[str, Any] = {name: _describe(landmarks) for name, landmarks in found.items()}
    return documents.LandmarksDocument(
        code_version=writing.code_version(),
        settings={"units": imaged.unit, "units_from": "size" if units == DETECT else "given"},
        input_hashes={
            file.name: hash_file(file) for path in bones.values() for file in images.list_files_of(path)
        },
        warnings=list(notes),
        wall_s=round(time.perf_counter() - began, 3),
        **described,
    )


def save_landmarks(document: documents.LandmarksDocument, folder: str | Path) -> Path:
    """Write ``landmarks.json`` into a folder, complete or not at all; returns its path.

    Raises InputError: the folder cannot be made or written to.
    """
    with writing.all_or_nothing(Path(folder)) as scratch:
        writing.write_json(scratch / FILE_NAME, document, without=list_absent(document))
    return Path(folder) / FILE_NAME


def list_absent(document: documents.LandmarksDocument) -> set[str]:
    """Bones that no surface showed: they do not stand in the file."""
    return {bone for bone in whole.BONES if getattr(document, bone) is None}


def _describe(bone: results.BoneLandmarks) -> dict[str, Any]:
    """One bone's part of the document; points are named as found, with their unit."""
    fits = {name: _fit("sphere", ball, ball.centre) for name, ball in bone.spheres.items()}
    for name, tube in bone.cylinders.items():
        fits[name] = _fit("cylinder", tube, tube.point, _to_unit(tube.axis))
    fields: dict[str, Any] = {f"{name}_mm": _to_mm(point) for name, point in bone.points.items()}
    if bone.bone == "femur":
        knee, condyles, head = (
            bone.axes.get("knee"),
            bone.cylinders.get("condyles"),
            bone.spheres.get("head"),
        )
        apart = None
        if knee is not None and condyles is not None:
            apart = round(float(np.rad2deg(np.arccos(np.clip(knee @ condyles.axis, -1.0, 1.0)))), 3)
        fields |= {
            "head_radius_mm": None if head is None else round(head.radius * _MM, 4),
            "knee_axis": None if knee is None else _to_unit(knee),
            "knee_axis_cylinder": None if condyles is None else _to_unit(condyles.axis),
            "knee_axes_apart_deg": apart,
        }
    elif bone.bone == "tibia":
        talus = "ankle" in bone.axes
        source = ("talus" if talus else "malleoli") if "ankle_centre" in bone.points else None
        fields |= {
            "plateau_axis": _to_unit(bone.axes["plateau"]) if "plateau" in bone.axes else None,
            "ankle_centre_from": source,
            "ankle_axis": _to_unit(bone.axes["ankle"]) if talus else None,
        }
    else:
        fields |= {f"{name}_axis": _to_unit(axis) for name, axis in bone.axes.items()}
    if bone.bone == "pelvis":
        fields["pose_odds_log10"] = None if bone.pose_odds is None else round(bone.pose_odds, 1)
    return fields | {
        "side": bone.side,
        "side_from": bone.side_from,
        "fit_rms_mm": max((fit.rms_mm for fit in fits.values()), default=None),
        "fits": fits,
        "deviations_mm": {name: round(_MM * size, 2) for name, size in bone.deviations.items()},
        "deviations_deg": {
            f"{name}_axis": round(float(np.rad2deg(size)), 2) for name, size in bone.axis_deviations.items()
        },
        "definitions": {k: v for k, v in bone.definitions.items() if k in bone.points},
        "refused": dict(bone.refused),
        "warnings": list(bone.warnings),
    }


def _fit(
    shape: Literal["sphere", "cylinder"],
    found: results.Sphere | results.Cylinder,
    centre: Array,
    axis: documents.Vector | None = None,
) -> documents.ShapeFit:
    return documents.ShapeFit(
        shape=shape,
        centre_mm=_to_mm(centre),
        radius_mm=round(found.radius * _MM, 4),
        axis=axis,
        rms_mm=round(found.quality.rms * _MM, 4),
        covered=round(found.quality.covered, 4),
    )


def _to_mm(point: Array) -> documents.Vector:
    x, y, z = (round(float(value) * _MM, 4) for value in point)
    return x, y, z


def _to_unit(direction: Array) -> documents.Vector:
    x, y, z = (round(float(value), 8) for value in direction)
    return x, y, z
