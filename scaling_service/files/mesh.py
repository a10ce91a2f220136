"""Surfaces of bones: STL, PLY and OBJ through trimesh, VTP through pyvista."""

from __future__ import annotations

import os
import re
import struct
from collections import abc
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.arrays import Array
from scaling_service.core.errors import FileUnreadable, name_file

MAX_BYTES = 400 * 2**20
"""Largest file read: chosen, 8 million binary STL triangles, a hundred times a fine bone."""

MAX_FACES = 8_000_000  # most triangles read: chosen, as many as the largest binary STL has
FINE_FACES = 500_000  # chosen: ten times a fine bone; a surface with more is thinned to about as many
_FACES_A_CELL = 3.1  # faces over area by cells squared, of a femur thinned; bends add some

_STL_HEAD = 84  # bytes before the first face: text and the number of faces
_STL_FACE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])

_REMEDY = "Export the surface again as binary STL"

_COUNTS = re.compile(rb"""NumberOf(?:Points|Verts|Lines|Strips|Polys)\s*=\s*["']\s*(\d+)""")
"""What an element of a VTP file claims to hold (VTK file formats, "XML file formats")."""

# What trimesh's readers raise on damaged files; they have no error of their own.
_DAMAGED = (
    ValueError,
    TypeError,
    KeyError,
    IndexError,
    AttributeError,
    UnboundLocalError,
    AssertionError,
    EOFError,
    struct.error,
    OverflowError,
    MemoryError,
)


@dataclass(frozen=True, slots=True)
class Mesh:
    """A surface as it is in the file, or thinned from more faces than landmarks need."""

    vertices: Array  # (n, 3); in the file's own unit and axes; STL repeats them for every face
    faces: NDArray[np.intp]  # (m, 3)
    thinned_from: int = 0  # faces in the file, where these are fewer


@name_file
def read_mesh(path: str | os.PathLike[str]) -> Mesh:
    """Read a surface of triangles by the suffix of its name.

    ``path``: STL, PLY, OBJ or VTP; polygons are cut into triangles. Raises FileUnreadable: absent, empty,
    too large, damaged, without faces, or of another format.
    """
    file = Path(path)
    reader = READERS.get(file.suffix.lower())
    if reader is None:
        said = f"'{file.suffix}' is not a format of surfaces" if file.suffix else "the name has no suffix"
        raise FileUnreadable(said, remedy=f"Supported are {', '.join(READERS)}")
    if not file.is_file():
        raise FileUnreadable("there is no such file", remedy="Check the path")
    try:
        size = file.stat().st_size
    except OSError as error:
        raise FileUnreadable(f"it cannot be read: {error.strerror}", remedy=_REMEDY) from None
    if size == 0:
        raise FileUnreadable("the file is empty", remedy=_REMEDY)
    if size > MAX_BYTES:
        raise FileUnreadable(
            f"it has {size / 2**20:.0f} MB, more than {MAX_BYTES / 2**20:.0f}",
            remedy="Reduce the surface; 60,000 faces are enough for a bone",
        )
    vertices, faces = reader(file)
    if len(faces) == 0 or len(vertices) == 0:
        raise FileUnreadable("there are no faces in it", remedy=_REMEDY)
    if len(faces) > MAX_FACES:
        raise FileUnreadable(
            f"it has {len(faces)} faces, more than {MAX_FACES}",
            remedy="Reduce the surface; 60,000 faces are enough for a bone",
        )
    if not np.isfinite(vertices).all():
        raise FileUnreadable("some vertices are not finite numbers", remedy=_REMEDY)
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise FileUnreadable("some faces name vertices that do not exist", remedy=_REMEDY)
    if len(faces) > FINE_FACES:
        return Mesh(*_thin(vertices, faces), thinned_from=len(faces))
    return Mesh(vertices.astype(float, copy=False), faces.astype(np.intp, copy=False))


def _thin(vertices: Array, faces: NDArray[np.integer]) -> tuple[Array, NDArray[np.intp]]:
    """A surface with one vertex, their mean, for all that lie in one cell of a grid."""
    # Imported here: VTK takes a second and 100 MB, and few bones are so fine.
    import pyvista
    from vtkmodules.vtkFiltersCore import vtkBinnedDecimation

    surface = pyvista.PolyData.from_regular_faces(vertices, faces.astype(int, copy=False))
    cell = np.sqrt(_FACES_A_CELL * surface.area / FINE_FACES)
    divisions = np.ceil(np.ptp(vertices, axis=0) / cell).clip(1).astype(int)
    bins = vtkBinnedDecimation()
    bins.SetInputData(surface)
    bins.AutoAdjustNumberOfDivisionsOff()
    bins.SetNumberOfDivisions(*divisions.tolist())
    bins.SetPointGenerationModeToBinAverages()
    bins.Update()
    thinned = pyvista.wrap(bins.GetOutput())
    faces = np.asarray(thinned.regular_faces, dtype=np.intp)
    # Sides of a fold that fell into the same cells cancel, so that a closed surface stays closed.
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    return np.asarray(thinned.points, dtype=float), faces[np.sort(first[count % 2 == 1])]


def _with_stl(file: Path) -> tuple[Array, NDArray[np.integer]]:
    """Binary STL as it lies on the disk, with little beside it in memory; text through trimesh."""
    with file.open("rb") as stream:
        head = stream.read(_STL_HEAD)
    count = int.from_bytes(head[-4:], "little")
    if len(head) < _STL_HEAD or file.stat().st_size != _STL_HEAD + count * _STL_FACE.itemsize or count == 0:
        return _with_trimesh(file)
    corners = np.memmap(file, _STL_FACE, mode="r", offset=_STL_HEAD)["corners"]
    return np.array(corners).reshape(-1, 3), np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


def _with_trimesh(file: Path) -> tuple[Array, NDArray[np.intp]]:
    import trimesh  # only here: it takes a third of a second, and a binary STL needs none of it

    # A stream, not a path: an OBJ must not make other files be opened.
    try:
        with file.open("rb") as stream:
            loaded = trimesh.load_mesh(
                stream, file_type=file.suffix.lower()[1:], process=False, skip_materials=True
            )
    except OSError as error:
        raise FileUnreadable(f"it cannot be read: {error.strerror}", remedy=_REMEDY) from None
    except (*_DAMAGED, trimesh.exchange.stl.HeaderError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise FileUnreadable(
            f"it is damaged or no {file.suffix.upper()[1:]} file ({reason[:120]})", remedy=_REMEDY
        ) from None
    return np.asarray(loaded.vertices, dtype=float), np.asarray(loaded.faces, dtype=np.intp)


def _with_pyvista(file: Path) -> tuple[Array, NDArray[np.intp]]:
    # Refuse what a VTP file claims to hold: VTK ends the program when it gets no memory for it.
    for count in _COUNTS.findall(file.read_bytes()):
        if int(count[:20]) > 3 * MAX_FACES:  # each face with corners of its own
            raise FileUnreadable(
                f"it claims to hold {int(count[:20])} points or cells, more than {3 * MAX_FACES}",
                remedy="Reduce the surface; 60,000 faces are enough for a bone",
            )
    # Imported here: VTK takes a second and 100 MB, and few bones come as VTP.
    import pyvista
    from vtkmodules.vtkCommonCore import vtkObject

    shown = vtkObject.GetGlobalWarningDisplay()
    vtkObject.SetGlobalWarningDisplay(0)  # its parser writes to the terminal; the outcome is judged below
    try:
        surface = pyvista.read(file)
    except (ValueError, TypeError, OSError, RuntimeError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise FileUnreadable(f"it is damaged or no VTP file ({reason[:120]})", remedy=_REMEDY) from None
    finally:
        vtkObject.SetGlobalWarningDisplay(shown)
    if not isinstance(surface, pyvista.PolyData) or surface.n_points == 0 or surface.n_cells == 0:
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.intp)
    triangles = surface.triangulate()
    faces = np.asarray(triangles.faces).reshape(-1, 4)[:, 1:].astype(np.intp)
    return np.asarray(triangles.points, dtype=float), faces


READERS: abc.Mapping[str, abc.Callable[[Path], tuple[Array, NDArray[np.integer]]]] = MappingProxyType(
    {".stl": _with_stl, ".ply": _with_trimesh, ".obj": _with_trimesh, ".vtp": _with_pyvista}
)
"""Suffix (lower case) to reader. A new format is a function and a row."""
