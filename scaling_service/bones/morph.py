"""A smooth map of space that takes one bone's surface onto another's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy
from numpy.typing import NDArray

from scaling_service.bones.results import MeshRefused
from scaling_service.core.arrays import Array
from scaling_service.model.trial import Bone

if TYPE_CHECKING:
    import pyvista as pv


_PLACES = 300  # chosen: of each surface, some 15 mm apart on a femur
_STAGES = ((1e6, 20), (1.0, 10), (0.1, 10), (0.01, 10))
"""Smoothing and number of rounds. Chosen: as good as affine first, then ever nearer to the surface."""
_MOST_FACES = 5000  # chosen: of the model's bone, five times those of OpenSim's own
_HELD = 30.0  # chosen: a point that stays counts as so many places of the surface
_FEWEST = 30  # chosen: counterparts without which two surfaces are no bones of one kind
_FACING = 0.5  # chosen: cosine between normals below which two places are not the same side of a bone
_STEP_M = 1e-4  # chosen: far below the distance of the places that carry the map
_OUTLIER = 3.0  # chosen: times the median distance beyond which a place has no counterpart


def measure_distances(bone: Bone, points: Array) -> Array:
    """Distance of points, (n, 3), from a bone's surface, (n,), m."""
    _, nearest = _find_nearest(_make_surface(bone), points)
    distances: Array = np.linalg.norm(points - nearest, axis=1)
    return distances


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceMap:
    """Points of a model's bone to the same places on a person's."""

    spline: scipy.interpolate.RBFInterpolator
    left_m: float  # root mean square distance that is left between the surfaces where they have counterparts

    def __call__(self, points: Array) -> Array:
        """Where points, (n, 3) m, of the model's segment lie in the person's."""
        moved: Array = self.spline(points)
        return moved

    def sizes(self, points: Array) -> Array:
        """How many times longer the map makes what lies at points, (n, 3) m; not above 0 where it folds."""
        ends = [self(points + step) - self(points - step) for step in _STEP_M * np.eye(3)]
        sizes: Array = np.cbrt(np.linalg.det(np.stack(ends, axis=2) / (2.0 * _STEP_M)))
        return sizes


def map_surface(model: Bone, person: Bone, ours_at: Array, theirs_at: Array) -> SurfaceMap:
    """The thin-plate spline that takes a model's bone, laid onto a person's, to the person's surface.

    The spline of least bending energy in space (its kernel is distance: Bookstein 1989, smoothed as in Wahba
    1990) through counterparts, found anew in each round: the nearest place of the other surface that faces
    the same way, from both surfaces, so that no part of either is left out.

    ``model``, ``person``: both in one frame, m. ``ours_at``, ``theirs_at``: (n, 3), m: joint
        centres of the model's bone, and where the person's are.
    Raises MeshRefused: the surfaces are not of one kind of bone.
    """
    ours, theirs = _make_surface(model), _make_surface(person)
    if ours.n_cells > _MOST_FACES:
        ours = _orient_surface(ours.decimate(1.0 - _MOST_FACES / ours.n_cells))
    own, wanted = (_spread(np.asarray(surface.points), _PLACES) for surface in (ours, theirs))
    moved = ours
    for smoothing, rounds in _STAGES:
        for _ in range(rounds):
            _, nearest, kept, gap = _find_counterparts(moved, own, theirs)
            cells, back, met, _ = _find_counterparts(theirs, wanted, moved)
            if min(kept.sum(), met.sum()) < _FEWEST:
                raise MeshRefused(
                    "hardly a place of it has its like on the model's bone",
                    remedy="Check that both are the same bone",
                )
            start = np.concatenate(
                [ours.points[own[kept]], _carry(moved, ours, cells[met], back[met]), ours_at]
            )
            end = np.concatenate([nearest[kept], theirs.points[wanted[met]], theirs_at])
            soft = np.full(len(end), smoothing)
            soft[len(end) - len(ours_at) :] /= _HELD
            spline = scipy.interpolate.RBFInterpolator(start, end, kernel="linear", degree=1, smoothing=soft)
            moved = _face_outwards(spline(ours.points), ours.regular_faces)
    return SurfaceMap(spline, float(np.sqrt(np.mean(gap[kept] ** 2))))


def _find_counterparts(
    start: pv.PolyData, chosen: NDArray[np.intp], end: pv.PolyData
) -> tuple[NDArray[np.intp], Array, NDArray[np.bool_], Array]:
    """Nearest cells of another surface, the places there, whether they are counterparts, and how far."""
    points = np.asarray(start.points)[chosen]
    cells, nearest = _find_nearest(end, points)
    gap = np.linalg.norm(points - nearest, axis=1)
    alike = np.einsum("ij,ij->i", start.point_data["Normals"][chosen], end.cell_data["Normals"][cells])
    return cells, nearest, (alike > _FACING) & (gap <= _OUTLIER * np.median(gap)), gap


def _find_nearest(surface: pv.PolyData, points: Array) -> tuple[NDArray[np.intp], Array]:
    """Cell and place on a surface nearest to each point."""
    cells, nearest = surface.find_closest_cell(points, return_closest_point=True)  # type: ignore[misc]
    return np.asarray(cells, dtype=np.intp), np.asarray(nearest)


def _carry(start: pv.PolyData, end: pv.PolyData, cells: NDArray[np.intp], points: Array) -> Array:
    """Points on cells of a surface, carried to the same cells of another."""
    corners = start.regular_faces[cells]
    a, b, c = (start.points[corners[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    area = np.maximum(
        np.einsum("ij,ij->i", normal, normal), np.finfo(float).tiny
    )  # a needle is its last corner
    u = np.einsum("ij,ij->i", np.cross(b - points, c - points), normal) / area
    v = np.einsum("ij,ij->i", np.cross(c - points, a - points), normal) / area
    shares = np.stack([u, v, 1.0 - u - v], axis=1)
    carried: Array = np.einsum("ik,ikj->ij", shares, end.points[corners])
    return carried


def _make_surface(bone: Bone) -> pv.PolyData:
    import trimesh  # only here: it takes a third of a second, and only maps of surfaces need it

    mesh = trimesh.Trimesh(bone.vertices, bone.faces, process=False)
    mesh.merge_vertices()
    mesh.update_faces(mesh.nondegenerate_faces())
    mesh.remove_unreferenced_vertices()
    return _face_outwards(mesh.vertices, mesh.faces)


def _face_outwards(points: Array, faces: NDArray[Any]) -> pv.PolyData:
    """A surface with outward normals at its places and cells."""
    import pyvista  # only here: it takes half a second, and only maps of surfaces need it

    return _orient_surface(pyvista.PolyData.from_regular_faces(points, np.asarray(faces, dtype=int)))


def _orient_surface(mesh: pv.PolyData) -> pv.PolyData:
    facing: pv.PolyData = mesh.compute_normals(auto_orient_normals=True, split_vertices=False)
    return facing


def _spread(points: Array, count: int) -> NDArray[np.intp]:
    """Rows of points that lie furthest apart from one another, as many as asked for or there are."""
    chosen, away = [0], np.linalg.norm(points - points[0], axis=1)
    while len(chosen) < min(count, len(points)):
        chosen.append(int(away.argmax()))
        away = np.minimum(away, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return np.array(chosen)
