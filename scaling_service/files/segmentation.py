"""Segmentations of medical images: NIfTI label maps, and folders of one mask or surface for each label."""

from __future__ import annotations

import csv
import json
import os
import re
from collections import abc
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any
from xml.etree import ElementTree

import numpy as np
import scipy
from numpy.typing import NDArray

from scaling_service.core.arrays import Array
from scaling_service.core.errors import FileUnreadable, name_file
from scaling_service.files import mesh

MAX_VOXELS = 700_000_000  # chosen: a whole body of 512 x 512 x 2600; one byte each
MAP_SUFFIXES = (".nii", ".nii.gz")
TABLE_SUFFIXES = (".json", ".txt", ".ctbl")  # of tables of labels: ours, ITK-SNAP's, 3D Slicer's

TOTAL = MappingProxyType({25: "sacrum", 75: "femur_left", 76: "femur_right", 77: "hip_left", 78: "hip_right"})
"""Bones among the numbers of TotalSegmentator's task ``total`` (Wasserthal et al. 2023), second version."""

_BLUR = 0.7
"""Standard deviation, in voxels, of the blur under a label's surface: chosen, it takes off the stairs. Of a
surface of radius r it takes off about its square over r: 0.05 mm of a head, 0.14 mm of a malleolus at
voxels of 1.5 mm."""
_FEWEST_VOXELS = 200  # chosen: less is no bone, and a surface of it has no landmark
_NEXT_M = 2  # voxels around a label that its surface needs


@dataclass(frozen=True, slots=True, kw_only=True)
class Segmentation:
    """Surfaces of labels in one frame.

    ``surfaces``: name of the label, as the file has it, to its surface. ``rightward`` (3,): unit vector to
    the subject's right, where the format defines it. ``voxel`` (3,), in the surfaces' unit: sides of a voxel;
    zeros for surfaces.
    """

    surfaces: abc.Mapping[str, mesh.Mesh]
    rightward: Array | None = None
    voxel: Array


def is_segmentation(path: str | os.PathLike[str]) -> bool:
    """Whether a path is a folder or has the suffix of a label map."""
    return Path(path).is_dir() or Path(path).name.lower().endswith(MAP_SUFFIXES)


def list_tables(name: str) -> tuple[str, ...]:
    """The names that a table of labels beside this file may have; none where it is no label map.

    Examples
    --------
    >>> list_tables("bones.nii.gz")
    ('bones.json', 'bones.txt', 'bones.ctbl')
    """
    if not name.lower().endswith(MAP_SUFFIXES):
        return ()
    return tuple(f"{_strip(Path(name))}{suffix}" for suffix in TABLE_SUFFIXES)


@name_file
def read_segmentation(path: str | os.PathLike[str]) -> Segmentation:
    """Read the surfaces of all labels.

    ``path``: ``.nii`` or ``.nii.gz`` with whole numbers, mm; or a folder with one mask (NIfTI) or one surface
    (STL, PLY, OBJ, VTP) for each label, named by its file. Labels of a map have their names from the file's
    own table, from a table beside it with the same stem (``.json``, or ``.txt`` and ``.ctbl`` of ITK-SNAP and
    3D Slicer), else from TotalSegmentator's numbers. Surfaces are open where the image ends. Raises
    FileUnreadable: absent, damaged, too large, without labels, or nibabel is not installed.
    """
    place = Path(path)
    if place.is_dir():
        masks = sorted(file for file in place.iterdir() if file.name.lower().endswith(MAP_SUFFIXES))
        meshes = sorted(file for file in place.iterdir() if file.suffix.lower() in mesh.READERS)
        if meshes or not masks:
            if not meshes:
                raise FileUnreadable(
                    "no surface and no mask is in it",
                    remedy=f"Export one file a label: {', '.join((*mesh.READERS, *MAP_SUFFIXES))}",
                )
            return Segmentation(
                surfaces={file.stem: mesh.read_mesh(file) for file in meshes}, voxel=np.zeros(3)
            )
        surfaces: dict[str, mesh.Mesh] = {}
        voxel = np.zeros(3)
        for file in masks:
            volume, affine, _ = _read_volume(file)
            mask = (volume > 0).astype(np.uint8)
            surfaces |= dict(_list_surfaces(mask, affine, {1: _strip(file)}))
            voxel = np.maximum(voxel, _measure_voxel(affine))
        return Segmentation(surfaces=surfaces, rightward=np.array([1.0, 0.0, 0.0]), voxel=voxel)
    volume, affine, own = _read_volume(place)
    names = own or _read_table(place) or TOTAL
    surfaces = dict(_list_surfaces(volume, affine, names))
    if not surfaces:
        raise FileUnreadable(
            f"it has no label that is known ({', '.join(map(str, np.unique(volume)[1:9]))})",
            remedy=f'Say what its numbers are in {_strip(place)}.json beside it: {{"femur_r": 3, …}}',
        )
    return Segmentation(
        surfaces=surfaces,
        rightward=np.array([1.0, 0.0, 0.0]),  # NIfTI's axes are right, anterior, superior
        voxel=_measure_voxel(affine),
    )


def describe_label_map(path: str | os.PathLike[str]) -> str:
    """How many voxels a label map has, by its header alone; FileUnreadable as for reading it."""
    shape = _open(Path(path)).shape
    return f"a label map of {' x '.join(map(str, shape))} voxels"


@name_file
def _open(file: Path) -> Any:
    """An image of nibabel, of which nothing but the header was read."""
    try:
        import nibabel
    except ImportError:
        raise FileUnreadable(
            "NIfTI files need the package nibabel",
            remedy="Install it with `pip install 'scaling-service[images]'`",
        ) from None
    try:
        image: Any = nibabel.load(file)
        if len(image.shape) != 3 or int(np.prod(image.shape)) > MAX_VOXELS:
            raise FileUnreadable(
                f"it has the shape {image.shape}; a label map has three axes and at most {MAX_VOXELS} voxels",
                remedy="Export the labels as one map, cropped to the bones",
            )
    except (OSError, ValueError, EOFError, nibabel.filebasedimages.ImageFileError) as error:
        raise _refuse(error) from None
    return image


def _refuse(error: Exception) -> FileUnreadable:
    return FileUnreadable(f"it cannot be read as NIfTI ({error})", remedy="Export the label map again")


@name_file
def _read_volume(file: Path) -> tuple[NDArray[Any], Array, dict[int, str]]:
    """Labels (i, j, k), what takes indices to mm, (4, 4), and the names that stand in the file."""
    image = _open(file)
    try:
        raw = np.asanyarray(image.dataobj)
        affine: Array = np.asarray(image.affine, dtype=np.float64)
        names = dict(_read_own_names(image.header.extensions))
    except (OSError, ValueError, EOFError) as error:
        raise _refuse(error) from None
    if raw.dtype.kind == "f":
        if not np.isfinite(raw).all() or (raw != np.rint(raw)).any():
            raise FileUnreadable(
                "its values are no whole numbers, so that it is an image and no label map",
                remedy="Give the segmentation, not the image that was segmented",
            )
        raw = raw.astype(np.int32)
    if abs(float(np.linalg.det(affine[:3, :3]))) < 1e-9:
        raise FileUnreadable("its voxels have no size", remedy="Export the label map again")
    return raw, affine, names


def _read_own_names(extensions: Any) -> abc.Iterator[tuple[int, str]]:
    """Of the XML label table that TotalSegmentator and Workbench write into the header."""
    for extension in extensions:
        content = extension.get_content()
        text = content.decode("utf-8", "ignore") if isinstance(content, bytes) else str(content)
        found = re.search(r"<LabelTable.*?</LabelTable>", text, re.DOTALL)
        if found is None or "<!" in found.group(0):
            continue
        try:
            table = ElementTree.fromstring(found.group(0))
        except ElementTree.ParseError:
            continue
        for label in table.iter("Label"):
            if (label.get("Key") or "").isdigit() and label.text:
                yield int(label.attrib["Key"]), label.text.strip()


def _read_table(file: Path) -> dict[int, str]:
    """Names from a table beside the map; none where there is none."""
    stem = file.parent / _strip(file)
    for table in (stem.with_name(name) for name in list_tables(file.name)):
        if not table.is_file():
            continue
        try:
            text = table.read_text(encoding="utf-8")
            if table.suffix == ".json":
                # A number and a name, either way round
                return dict(
                    (int(key), str(value)) if key.isdigit() else (int(str(value)), key)
                    for key, value in json.loads(text).items()
                )
            # ITK-SNAP (number, colour …, "name") and 3D Slicer (number, name, colour)
            lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
            found = {}
            for row in csv.reader(lines, delimiter=" ", skipinitialspace=True):
                names = [cell for cell in row[1:] if re.search("[A-Za-z]", cell)]
                if row and row[0].isdigit() and names:
                    found[int(row[0])] = names[0]
            return found
        except (ValueError, AttributeError, TypeError, UnicodeDecodeError) as error:
            raise FileUnreadable(
                f"it is no table of labels ({error})",
                file=table,
                remedy='Write {"femur_r": 3, "tibia_r": 4}, or export the table of ITK-SNAP or 3D Slicer',
            ) from None
    return {}


def _list_surfaces(
    volume: NDArray[Any], affine: Array, names: abc.Mapping[int, str]
) -> abc.Iterator[tuple[str, mesh.Mesh]]:
    """Name and surface of each label that is named and has enough voxels."""
    import pyvista  # only here: it takes half a second

    boxes = scipy.ndimage.find_objects(volume if volume.dtype.kind in "iu" else volume.astype(np.int32))
    for number, name in sorted(names.items()):
        box = boxes[number - 1] if 0 < number <= len(boxes) else None
        if box is None:
            continue
        spans = [
            (max(0, span.start - _NEXT_M), min(size, span.stop + _NEXT_M))
            for span, size in zip(box, volume.shape, strict=True)
        ]
        inside = volume[tuple(slice(*span) for span in spans)] == number
        if int(inside.sum()) >= _FEWEST_VOXELS:
            # Where the label ends, half-way between voxels; open where the image does
            field = scipy.ndimage.gaussian_filter(inside.astype(np.float32), _BLUR, mode="nearest")
            grid = pyvista.ImageData(dimensions=inside.shape)
            grid.point_data["inside"] = field.ravel(order="F")
            surface = grid.contour([0.5], scalars="inside", method="flying_edges").triangulate()
            corner = np.array([low for low, _ in spans])
            places = (np.asarray(surface.points, dtype=float) + corner) @ affine[:3, :3].T + affine[:3, 3]
            faces = np.asarray(surface.regular_faces, dtype=np.intp)
            mirrored = np.linalg.det(affine[:3, :3]) < 0
            yield name, mesh.Mesh(places, faces[:, ::-1] if mirrored else faces)


def _measure_voxel(affine: Array) -> Array:
    return np.asarray(np.linalg.norm(affine[:3, :3], axis=0))


def _strip(file: Path) -> str:
    """A file's name without the suffixes of label maps."""
    return re.sub(r"\.nii(\.gz)?$", "", file.name, flags=re.IGNORECASE)
