"""The bones of one image from what a segmentation calls them: sides, both hip bones, tibia and fibula."""

from __future__ import annotations

import re
from collections import abc
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scaling_service.bones import mesh as bones_mesh
from scaling_service.bones import results, whole
from scaling_service.bones.surface import STRAY_SHARE
from scaling_service.core import errors
from scaling_service.core.names import say_name
from scaling_service.files import mesh as files_mesh
from scaling_service.files import segmentation
from scaling_service.numerics.multibody.laws import Array

Arrays = tuple[Array, NDArray[np.intp]]
"""Vertices (n, 3) and faces (m, 3)."""

SEGMENTATION = "segmentation"
"""Beside names of bones: one file or folder with several of them."""

_KINDS = {
    "pelvis": r"pelvis|hip|hips|coxa\w*|coxal|innominate|os_coxae|hemipelvis|ilium|beckenknochen",
    "femur": r"femur|femora|thighbone",
    "tibia": r"tibia|tibiae|shank",
    "fibula": r"fibula|fibulae",
    "talus": r"talus|tali|astragalus",
}
"""What bones are called: TotalSegmentator, 3D Slicer, Mimics and common words; others are passed over."""

_SIDES = {"r": r"right|r|rt|dx", "l": r"left|l|lt|sin"}
_MM = 1e-3
_TOLD = 6  # chosen: labels named in a sentence

_TWO_LEGS_M = 0.06  # chosen: shanks of two legs are 0.1-0.3 m apart, pieces of one bone less
_ASIDE_M = 0.03  # chosen: a leg beside the middle of the body


@dataclass(frozen=True, slots=True, kw_only=True)
class ImagedBones:
    """Bones in one image, m.

    ``meshes``: name of a bone to vertices (n, 3), m, and faces (m, 3). ``voxel``: root mean square of what
    rounding to voxels leaves open, in space, m. ``passed_over``: labels that are no bone of ours.
    """

    meshes: abc.Mapping[str, Arrays]
    unit: str = "mm"  # of the surfaces' files
    voxel: float = 0.0
    passed_over: tuple[str, ...] = ()
    thinned: abc.Mapping[str, int] = field(default_factory=dict)  # bones to the faces in their files

    def tell(self) -> tuple[str, ...]:
        """Which surfaces were thinned, and which labels were passed over."""
        thinned = tuple(
            f"{say_name(name)}: of {count:,} faces in the file about {files_mesh.FINE_FACES:,} were used"
            for name, count in self.thinned.items()
        )
        if not self.passed_over:
            return thinned
        some = ", ".join(self.passed_over[:_TOLD]) + (" …" if len(self.passed_over) > _TOLD else "")
        return (*thinned, f"segmentation: no bone of ours, or without its tibia: {some}")

    def widen(self, found: abc.Mapping[str, results.BoneLandmarks]) -> dict[str, results.BoneLandmarks]:
        """Landmarks with deviations that hold the voxel size."""
        return {
            name: replace(
                bone, deviations={k: float(np.hypot(size, self.voxel)) for k, size in bone.deviations.items()}
            )
            for name, bone in found.items()
        }


def read_bones(paths: abc.Mapping[str, Path], unit: str | None = None) -> ImagedBones:
    """Bones from a file each, or from a segmentation.

    ``paths``: bone to file, or ``segmentation`` to a label map or a folder of masks or surfaces. ``unit``: of
    surfaces, ``mm``, ``cm`` or ``m``; found by their size unless given. A label map has its own. Corners that
    files repeat in every face are one. Raises
    InputError: a file cannot be read; MeshRefused: a segmentation has no bone of ours, or does not tell its
    sides.
    """
    read = {name: _read(name, path) for name, path in paths.items() if name != SEGMENTATION}
    loose = {name: (mesh.vertices, mesh.faces) for name, mesh in read.items()}
    measured: dict[str, Arrays] = {}
    voxel = 0.0
    left_over: tuple[str, ...] = ()
    if SEGMENTATION in paths:
        path = paths[SEGMENTATION]
        if not path.exists() or not segmentation.is_segmentation(path):
            raise errors.FileUnreadable(
                "it is no segmentation",
                file=path,
                field=SEGMENTATION,
                remedy="Give a label map (.nii, .nii.gz), or a folder of masks or surfaces",
            )
        found = segmentation.read_segmentation(path)
        voxel = _MM * float(np.sqrt((found.voxel**2).sum() / 12.0))
        scale = _MM if voxel else 1.0
        labels = {name: (scale * mesh.vertices, mesh.faces) for name, mesh in found.surfaces.items()}
        told, left_over = assemble(labels, found.rightward)
        if voxel:
            measured = told
        else:
            loose = told | loose
    if unit is None and loose:
        unit = whole.find_unit({name: float(np.ptp(v, axis=0).max()) for name, (v, _) in loose.items()})
    unit = unit or "mm"
    scaled = {name: bones_mesh.merge_vertices(whole.UNITS[unit] * v, f) for name, (v, f) in loose.items()}
    return ImagedBones(
        meshes=measured | scaled,
        unit=unit,
        voxel=voxel,
        passed_over=left_over,
        thinned={name: mesh.thinned_from for name, mesh in read.items() if mesh.thinned_from},
    )


def _read(name: str, path: Path) -> files_mesh.Mesh:
    try:
        return files_mesh.read_mesh(path)
    except errors.InputError as error:
        raise type(error)(error.problem, file=error.file, field=name, remedy=error.remedy) from None


def list_files_of(path: Path) -> list[Path]:
    """The file itself, or those in a folder."""
    return sorted(file for file in path.iterdir() if file.is_file()) if path.is_dir() else [path]


def assemble(
    labels: abc.Mapping[str, Arrays], rightward: Array | None = None
) -> tuple[dict[str, Arrays], tuple[str, ...]]:
    """Bones under their names, both hip bones and each tibia with its fibula in one; and labels passed over.

    ``labels``: what a segmentation calls them to vertices (n, 3), m, and faces (m, 3). ``rightward`` (3,): to
    the subject's right, which parts a label that holds both sides. Raises MeshRefused: a label holds both
    sides, or none is named, and the image's axes are not known.
    """
    parts: dict[str, list[Arrays]] = {}
    left_over: list[str] = []
    for label, mesh in labels.items():
        kind, side = _understand(label)
        if kind is None:
            left_over.append(label)
        elif kind == "pelvis":
            parts.setdefault(kind, []).append(mesh)
        else:
            sided = [(side, mesh)] if side is not None else _part_sides(label, mesh, rightward, labels)
            for name, part in sided:
                parts.setdefault(f"{kind}_{name}", []).append(part)
    for side in "rl":
        fibula = parts.pop(f"fibula_{side}", [])
        if f"tibia_{side}" in parts:
            parts[f"tibia_{side}"] += fibula
        elif fibula:
            left_over.append(f"fibula_{side}")
    if not parts:
        raise results.MeshRefused(
            f"none of its labels is a bone of pelvis or leg ({', '.join(sorted(labels)[:8])})",
            field=SEGMENTATION,
            remedy="Name them hip_left, femur_right, tibia_r, fibula_r, talus_r …",
        )
    return {name: _join(meshes) for name, meshes in parts.items()}, tuple(left_over)


def _understand(label: str) -> tuple[str | None, str | None]:
    """Kind of bone and side of a label; None where the name does not say.

    Examples
    --------
    >>> _understand("Segment_Right Femur"), _understand("hip_left"), _understand("vertebrae_L5")
    (('femur', 'r'), ('pelvis', 'l'), (None, 'l'))
    """
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", label)
    words = [word for word in re.split(r"[^A-Za-z]+", spaced.lower()) if word]
    kinds = [kind for kind, names in _KINDS.items() if any(re.fullmatch(names, word) for word in words)]
    sides = [side for side, names in _SIDES.items() if any(re.fullmatch(names, word) for word in words)]
    return (kinds[0] if len(kinds) == 1 else None), (sides[0] if len(sides) == 1 else None)


def _part_sides(
    label: str,
    mesh: Arrays,
    rightward: Array | None,
    labels: abc.Mapping[str, Arrays],
) -> abc.Iterator[tuple[str, Arrays]]:
    """Pieces of a label by side: on which side of the middle of all bones they lie."""
    if rightward is None:
        raise results.MeshRefused(
            f"the label '{label}' does not say its side",
            field=SEGMENTATION,
            remedy=f"Name it {label}_r or {label}_l, or give the label map, whose axes tell",
        )
    vertices, faces = bones_mesh.merge_vertices(*mesh)
    piece = bones_mesh.label_pieces(len(vertices), faces)
    areas = np.bincount(piece, weights=bones_mesh.compute_vertex_areas(vertices, faces))
    large = np.flatnonzero(areas > STRAY_SHARE * areas.max())
    middles = {k: float((vertices[piece == k] @ rightward).mean()) for k in large}
    if max(middles.values()) - min(middles.values()) > _TWO_LEGS_M:
        centre = 0.5 * (max(middles.values()) + min(middles.values()))
    else:  # of one leg: beside what else is in the image
        ends = [other[0] @ rightward for other in labels.values()]
        centre = 0.5 * (max(float(x.max()) for x in ends) + min(float(x.min()) for x in ends))
        if abs(float(np.mean(list(middles.values()))) - centre) < _ASIDE_M:
            raise results.MeshRefused(
                f"the label '{label}' does not say its side, nor does its place",
                field=SEGMENTATION,
                remedy=f"Name it {label}_r or {label}_l",
            )
    for side, sign in (("r", 1.0), ("l", -1.0)):
        own = np.isin(piece, [k for k, at in middles.items() if sign * (at - centre) > 0])
        if own.any():
            kept = faces[own[faces].all(axis=1)]
            names, compact = np.unique(kept, return_inverse=True)
            yield side, (vertices[names], compact.reshape(-1, 3))


def _join(meshes: list[Arrays]) -> Arrays:
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in meshes[:-1])])
    faces = [faces + start for (_, faces), start in zip(meshes, starts, strict=True)]
    return np.vstack([vertices for vertices, _ in meshes]), np.vstack(faces)
