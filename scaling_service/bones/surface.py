"""A bone's surface made ready: one vertex per place, outward normals, no debris, its own axes.

Everything after this happens in the bone's own principal frame, so that the image's orientation and
origin cannot matter.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from scaling_service.bones import edges, mesh
from scaling_service.bones.mesh import Faces
from scaling_service.bones.results import MeshRefused
from scaling_service.core.arrays import Array

STRAY_SHARE = 0.05
"""Shells below this share of the largest one's area are debris of the segmentation (field experience)."""

SMOOTHING_M = 5.0e-3
"""Length of the waves that are taken off before points are selected: chosen, above voxels of MRI (1-2 mm),
so that stairs and noise do not turn normals, and far below the radius of a condyle (20 mm)."""

COARSE_M = 3e-3  # median edge above which edges are halved: chosen, so that patches of 8 mm hold vertices

OPEN_SHARE = 1e-3
"""Boundary edges above this share of all are called open; chosen, a pinhole is not worth a warning."""

_FEWEST_FACES = 500  # chosen: a femoral head of a 500-face femur has about 20 vertices


@dataclass(frozen=True, slots=True, kw_only=True)
class Surface:
    """A cleaned bone in its own principal frame, m.

    ``points`` (n, 3), m: vertices, without their noise where there was much; the longest principal axis is
    x, the shortest z. ``noise`` m: standard deviation of what was taken off the vertices along their
    normals; 0 on a quiet mesh.
    """

    points: Array
    smooth: Array  # (n, 3), m; the same vertices smoothed over 5 mm, for selecting; fits use ``points``
    normals: Array  # (n, 3); outward unit normals of the smoothed surface
    areas: Array  # (n,), m2; what each vertex stands for
    shell: NDArray[np.intp]  # (n,); number of the connected piece, the largest first
    faces: Faces  # (m, 3)
    origin: Array  # (3,), m
    R_image_own: Array  # (3, 3); rotates this frame into the image's
    noise: float = 0.0
    edge: float = 0.0  # m; median length of the edges that were given
    rims: edges.Rims = field(default_factory=edges.Rims)  # of the whole surface, also of its parts
    notes: tuple[str, ...] = ()  # what was repaired

    def to_image(self, points: Array) -> Array:
        """Points (..., 3) of this frame in the image."""
        moved: Array = points @ self.R_image_own.T + self.origin
        return moved

    def turn_to_image(self, directions: Array) -> Array:
        """Directions (..., 3) of this frame in the image."""
        moved: Array = directions @ self.R_image_own.T
        return moved

    def middle(self, chosen: NDArray[np.bool_] | slice = slice(None)) -> Array:
        """Centroid of the chosen vertices of the smoothed surface, (3,), m."""
        areas = self.areas[chosen]
        return np.asarray(areas @ self.smooth[chosen] / areas.sum())

    def widest_direction(
        self, chosen: NDArray[np.bool_] | slice = slice(None), across: Array | None = None
    ) -> Array:
        """Along which the chosen vertices of the smoothed surface spread most, (3,); square to ``across``."""
        local = self.smooth[chosen] - self.middle(chosen)
        if across is not None:
            local = local - (local @ across)[:, None] * across
        return find_principal_axes(local, self.areas[chosen])[:, 2]

    def turn(self, axis: Array) -> Surface:
        """The same in a frame whose x axis is a unit vector (3,) of this one."""
        others = np.linalg.svd(axis[None])[2][1:]
        R = np.column_stack([axis, others[0], np.cross(axis, others[0])])
        return replace(
            self,
            points=self.points @ R,
            smooth=self.smooth @ R,
            normals=self.normals @ R,
            R_image_own=self.R_image_own @ R,
            rims=replace(self.rims, points=self.rims.points @ R),
        )

    def part(self, kept: NDArray[np.bool_] | NDArray[np.intp]) -> Surface:
        """Only some vertices; faces go."""
        return replace(
            self,
            points=self.points[kept],
            smooth=self.smooth[kept],
            normals=self.normals[kept],
            areas=self.areas[kept],
            shell=self.shell[kept],
            faces=np.zeros((0, 3), dtype=np.intp),
        )


def find_principal_axes(local: Array, areas: Array) -> Array:
    """Principal directions of points about their centroid (n, 3) in columns, the least spread first."""
    axes: Array = np.linalg.eigh(local.T @ ((areas / areas.sum())[:, None] * local))[1]
    return axes


def prepare(vertices: Array, faces: NDArray[np.integer]) -> Surface:
    """Clean a mesh and put it into its own frame.

    ``vertices``: (n, 3), m. ``faces``: (m, 3). Raises MeshRefused: empty, not finite, or faces that name
    vertices that do not exist.
    """
    vertices, triangles = _check(vertices, faces)
    notes: list[str] = []
    points, triangles = mesh.merge_vertices(vertices, triangles)
    triangles = mesh.remove_useless_faces(triangles)
    if len(triangles) < _FEWEST_FACES:
        raise MeshRefused(
            f"it has {len(triangles)} faces, too few for a bone",
            remedy=f"Give a surface of at least {_FEWEST_FACES} faces",
        )
    points, triangles, label = _drop_strays(points, triangles, notes)
    open_share = mesh.measure_openness(triangles)
    if open_share > OPEN_SHARE:
        notes.append(f"the surface is open ({100 * open_share:.1f} % of its edges have one face)")
    triangles = _turn_outwards(points, triangles, label, notes)
    edge = mesh.measure_median_edge(points, triangles)
    cleaned, smooth, noise = mesh.remove_noise(points, triangles, SMOOTHING_M)
    if noise > 0.0:
        notes.append(f"the vertices scatter by {1e3 * noise:.1f} mm about a smooth surface and were smoothed")
    points, triangles = mesh.refine_mesh(cleaned, triangles, COARSE_M)
    if points is not cleaned:
        smooth = mesh.Smoother(points, triangles).smooth(SMOOTHING_M)
    label = _number_shells(points, triangles)
    # Centroid of the surface and its principal axes in columns, right-handed, longest first. Signs follow
    # the third moments, which no rotation of the image changes.
    areas = mesh.compute_vertex_areas(points, triangles)
    w = areas / areas.sum()
    origin = w @ points
    local = points - origin
    axes = find_principal_axes(local, areas)[:, ::-1].copy()
    skewness = w @ (local @ axes) ** 3
    axes[:, :2] *= np.where(skewness[:2] < 0, -1.0, 1.0)
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    points, smooth = (points - origin) @ axes, (smooth - origin) @ axes
    return Surface(
        points=points,
        smooth=smooth,
        normals=mesh.compute_vertex_normals(smooth, triangles),
        areas=mesh.compute_vertex_areas(smooth, triangles),
        shell=label,
        faces=triangles,
        origin=origin,
        R_image_own=axes,
        noise=noise,
        edge=edge,
        rims=edges.find_rims(points, triangles) if open_share else edges.Rims(),
        notes=tuple(notes),
    )


def _check(vertices: Array, faces: NDArray[np.integer]) -> tuple[Array, Faces]:
    vertices, triangles = np.asarray(vertices, dtype=float), np.asarray(faces)
    if vertices.size == 0 or triangles.size == 0:
        raise MeshRefused("the mesh is empty", remedy="Export the bone's surface again")
    if vertices.ndim != 2 or vertices.shape[1] != 3 or triangles.ndim != 2 or triangles.shape[1] != 3:
        raise MeshRefused(
            f"vertices of shape {vertices.shape} and faces of shape {triangles.shape} are no triangles",
            remedy="Export a surface of triangles",
        )
    if not np.issubdtype(triangles.dtype, np.integer):
        raise MeshRefused("faces are not whole numbers", remedy="Export the bone's surface again")
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise MeshRefused("faces name vertices that do not exist", remedy="Export the bone's surface again")
    if not np.isfinite(vertices).all():
        raise MeshRefused("some vertices are not finite", remedy="Export the bone's surface again")
    return vertices, triangles.astype(np.intp)


def _drop_strays(points: Array, triangles: Faces, notes: list[str]) -> tuple[Array, Faces, NDArray[np.intp]]:
    label = _number_shells(points, triangles)
    areas = np.bincount(label, weights=mesh.compute_vertex_areas(points, triangles))
    large = areas >= STRAY_SHARE * areas[0]
    strays = int((~large & (areas > 0)).sum())
    if strays:
        share = float(areas[~large].sum() / areas.sum())
        notes.append(f"{strays} stray shells ({100 * share:.2g} % of the area) were dropped")
    kept = large[label]
    number = np.cumsum(kept) - 1
    triangles = number[triangles[kept[triangles[:, 0]]]]
    return points[kept], triangles, label[kept]


def _number_shells(points: Array, triangles: Faces) -> NDArray[np.intp]:
    """Number of the connected piece of each vertex, the largest area first."""
    label = mesh.label_pieces(len(points), triangles)
    areas = np.bincount(label, weights=mesh.compute_vertex_areas(points, triangles))
    rank = np.empty(len(areas), dtype=np.intp)
    rank[np.argsort(-areas, kind="stable")] = np.arange(len(areas))
    numbers: NDArray[np.intp] = rank[label]
    return numbers


def _turn_outwards(points: Array, triangles: Faces, label: NDArray[np.intp], notes: list[str]) -> Faces:
    """Every shell wound alike, then turned so that it encloses a positive volume."""
    triangles, turned = mesh.wind_alike(len(points), triangles)
    corners = points[triangles]
    owner = label[triangles[:, 0]]
    n_shells = int(label.max()) + 1
    middle = np.column_stack([np.bincount(label, points[:, k], n_shells) for k in range(3)]).astype(float)
    middle = middle / np.bincount(label, minlength=n_shells)[:, None]
    corners = corners - middle[owner][:, None]
    volumes = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    inside_out = np.bincount(owner, volumes, n_shells) < 0
    if turned:
        notes.append(f"{turned} faces were wound against their neighbours and were turned")
    if inside_out.any():
        notes.append("the normals pointed inwards and were turned")
    flip = inside_out[owner]
    return np.where(flip[:, None], triangles[:, ::-1], triangles)
