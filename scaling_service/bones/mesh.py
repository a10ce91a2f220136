"""Triangle meshes as arrays: merging, pieces, winding, areas and normals, smoothing, halved edges."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from scaling_service.core.arrays import Array
from scaling_service.numerics.multibody.tree import cross

Faces = NDArray[np.intp]

_GRID = 2**21 - 1  # three such coordinates fit one 64-bit number; a 0.5 m bone is resolved to 0.25 um

_MOST_STEPS = 120  # chosen: enough for 2 mm on a mesh of 0.4 mm edges
_UNSHRINK = -1.03  # Taubin 1995's second, swelling step as a share of the first
_ROUNDING = 1e-13  # chosen: terms of the steps' polynomial below this add less than a picometre to a bone

QUIET_M = 4e-4
"""Scatter of the vertices about the smoothed surface up to which a mesh is left as it is, m. Chosen above the
0.06-0.08 mm of bones from computed tomography, the 0.35 mm of a rough one from magnetic resonance, and what
smoothing takes off meshes of 3,000 faces (0.1-0.36 mm)."""

_MOST_TIMES = 2  # chosen: a mesh that is still coarser holds no landmark


def merge_vertices(vertices: Array, faces: Faces) -> tuple[Array, Faces]:
    """One vertex for each place (STL repeats them for every face), unused ones gone."""
    low = vertices.min(axis=0)
    size = float((vertices.max(axis=0) - low).max()) or 1.0
    cells = np.rint((vertices - low) * (_GRID / size)).astype(np.int64)
    key = (cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2]
    _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    triangles = inverse[faces]
    used = np.zeros(len(first), dtype=bool)
    used[triangles] = True
    return vertices[first[used]], (np.cumsum(used) - 1)[triangles]


def remove_useless_faces(faces: Faces) -> Faces:
    """No face with a repeated corner, and none twice."""
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    a, b, c = faces.T
    low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    n = int(faces.max()) + 1 if len(faces) else 1
    # Below 2 million vertices the three indices fit one number.
    key = (low * n + (a + b + c - low - high)) * n + high
    _, first = np.unique(key, return_index=True)
    kept: Faces = faces[np.sort(first)]
    return kept


def label_pieces(n_vertices: int, faces: Faces) -> NDArray[np.intp]:
    """Number of the connected piece of each vertex."""
    rows = np.concatenate([faces[:, 0], faces[:, 1]])
    columns = np.concatenate([faces[:, 1], faces[:, 2]])
    graph = coo_array((np.ones(len(rows), dtype=bool), (rows, columns)), shape=(n_vertices, n_vertices))
    _, label = connected_components(graph, directed=False)
    numbers: NDArray[np.intp] = label.astype(np.intp)
    return numbers


def measure_openness(faces: Faces) -> float:
    """Share of edges that have one face only."""
    starts, ends = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    keys = np.sort(np.minimum(starts, ends) * (int(faces.max()) + 1) + np.maximum(starts, ends))
    new = np.concatenate([[True], keys[1:] != keys[:-1], [True]])
    return float((new[1:] & new[:-1]).sum() / (new.sum() - 1))


def wind_alike(n_vertices: int, faces: Faces) -> tuple[Faces, int]:
    """Faces turned so that neighbours are wound the same way, and how many were turned.

    Each face becomes two nodes, as it is and turned; edges of the graph join what can stand together.
    Then the two halves of every piece are two connected components, and one of them is kept.
    """
    starts, ends = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    key = np.minimum(starts, ends) * n_vertices + np.maximum(starts, ends)
    order = np.argsort(key)
    sorted_key = key[order]
    same = sorted_key[1:] == sorted_key[:-1]
    # Edges with more than two faces say nothing about winding.
    crowded = np.zeros(len(key), dtype=bool)
    triple = same[1:] & same[:-1]
    crowded[1:-1] |= triple
    pair = same & ~crowded[1:] & ~crowded[:-1]
    one, two = order[:-1][pair], order[1:][pair]
    against = starts[one] == starts[two]
    if not against.any():
        return faces, 0
    n = len(faces)
    f, g = one // 3, two // 3
    rows = np.concatenate([f, f + n])
    columns = np.concatenate([np.where(against, g + n, g), np.where(against, g, g + n)])
    graph = coo_array((np.ones(len(rows), dtype=bool), (rows, columns)), shape=(2 * n, 2 * n))
    _, label = connected_components(graph, directed=False)
    turned = label[:n] > label[n:]  # equal where a piece cannot be oriented (a Moebius strip)
    piece = np.minimum(label[:n], label[n:])
    # The majority of each piece stays as it is.
    share = np.bincount(piece, turned, label.max() + 1) / np.maximum(
        np.bincount(piece, minlength=label.max() + 1), 1
    )
    turned ^= share[piece] > 0.5
    return np.where(turned[:, None], faces[:, ::-1], faces), int(turned.sum())


def compute_vertex_areas(points: Array, faces: Faces) -> Array:
    """A third of the area of the faces around each vertex, shape (n,)."""
    x, y, z = _compute_doubled_areas(points, faces)
    areas = np.sqrt(x * x + y * y + z * z) / 2.0
    return np.bincount(faces.ravel(), np.repeat(areas / 3.0, 3), len(points)).astype(float)


def compute_vertex_normals(points: Array, faces: Faces) -> Array:
    """Unit normals, the sum of the vector areas around each vertex, shape (n, 3)."""
    corner, vectors = faces.ravel(), _compute_doubled_areas(points, faces)
    total = np.column_stack([np.bincount(corner, np.repeat(part, 3), len(points)) for part in vectors])
    normals: Array = total / np.maximum(np.linalg.norm(total, axis=1), 1e-300)[:, None]
    return normals


class Smoother:
    """Averages over neighbouring vertices without shrinking (Taubin 1995, SIGGRAPH: 351-358).

    ``points``: (n, 3). ``faces``: (m, 3).
    """

    def __init__(self, points: Array, faces: Faces) -> None:
        n, corners = len(points), faces.astype(np.int32)  # halves what every step reads
        rows, columns = corners[:, [0, 1, 1, 2, 2, 0]].ravel(), corners[:, [1, 0, 2, 1, 0, 2]].ravel()
        weights = csr_array((np.ones(len(rows)), (rows, columns)), shape=(n, n))
        weights.data[:] = 1.0
        total = np.maximum(np.asarray(weights.sum(axis=1)).ravel(), 1.0)
        weights.data /= np.repeat(total, np.diff(weights.indptr))
        self._mean, self._points, self._faces = weights, points, faces

    def smooth(self, sigma: float, *, edges_of: Array | None = None) -> Array:
        """The points with waves shorter than about ``sigma`` (their unit) taken off.

        ``edges_of`` (n, 3): the same vertices with less noise, whose edges tell the length of a step: noise
        makes edges longer, so that too few steps would be taken.
        """
        # One half step spreads a point by a quarter of the squared edge along each direction.
        edge = measure_median_edge(self._points if edges_of is None else edges_of, self._faces)
        steps = min(round(4.0 * (sigma / edge) ** 2), _MOST_STEPS)
        first, *others = _expand_steps(steps)
        moved, before, wave = first * self._points, self._points, self._points
        for k, share in enumerate(others):
            mean = self._mean @ wave
            before, wave = wave, 2.0 * mean - before if k else mean
            moved += share * wave
        return moved


@lru_cache(maxsize=_MOST_STEPS + 1)
def _expand_steps(steps: int) -> tuple[float, ...]:
    """Steps of half the way to the mean and back as one polynomial of the mean, in Chebyshev's form.

    The mean's eigenvalues lie between -1 and 1. A fifth of as many means gives the same to rounding.
    """
    mean = chebyshev.chebpts1(2 * steps + 1)
    there, back = 1.0 + 0.5 * (mean - 1.0), 1.0 + 0.5 * _UNSHRINK * (mean - 1.0)
    shares = 2.0 / len(mean) * (there * back) ** steps @ chebyshev.chebvander(mean, 2 * steps)
    shares[0] /= 2.0
    return tuple(shares[: np.flatnonzero(np.abs(shares) > _ROUNDING)[-1] + 1].tolist())


def remove_noise(points: Array, faces: Faces, sigma: float) -> tuple[Array, Array, float]:
    """Vertices with their noise taken off, smoothed ones, each (n, 3), m, and the noise, m: 0 where none was.

    The noise is the standard deviation of the vertices along the normals of the smoothed surface. Up to
    :data:`QUIET_M` the points are returned as they are.

    ``sigma`` m: length of the waves to take off.
    """
    smoother = Smoother(points, faces)
    smooth = smoother.smooth(sigma)
    off = np.einsum("ij,ij->i", points - smooth, compute_vertex_normals(smooth, faces))
    noise = 1.4826 * float(np.median(np.abs(off)))  # standard deviation of a normal scatter
    if noise <= QUIET_M:
        return points, smooth, 0.0
    points = smoother.smooth(sigma, edges_of=smooth)
    return points, Smoother(points, faces).smooth(sigma), noise


def measure_median_edge(points: Array, faces: Faces) -> float:
    """Half of the edges are longer; in the points' unit."""
    corners = _take_corners(points, faces)
    x, y, z = np.moveaxis(corners - np.roll(corners, -1, axis=0), 1, 0)
    return float(np.median(np.sqrt(x * x + y * y + z * z))) or 1.0


def _take_corners(points: Array, faces: Faces) -> Array:
    """The corners of the faces, (3, 3, m): first, second, third, each by its components."""
    return np.take(np.ascontiguousarray(points.T), faces.T, axis=1).transpose(1, 0, 2)


def _compute_doubled_areas(points: Array, faces: Faces) -> Array:
    """Vector areas of the faces, doubled, (3, m)."""
    a, b, c = _take_corners(points, faces)
    return cross(b - a, c - a)


def refine_mesh(points: Array, faces: Faces, edge: float) -> tuple[Array, Faces]:
    """The mesh with edges halved until the median edge is no longer than asked.

    A midpoint is lifted off its chord by an eighth of the chord times the turn of the normals, which is
    exact on a circle to third order (as in curved PN triangles; Vlachos et al. 2001).

    ``points``: (n, 3). ``faces``: (m, 3). ``edge``: in the points' unit.
    """
    for _ in range(_MOST_TIMES):
        if measure_median_edge(points, faces) <= edge:
            break
        points, faces = _halve_edges(points, faces)
    return points, faces


def _halve_edges(points: Array, faces: Faces) -> tuple[Array, Faces]:
    normals = compute_vertex_normals(points, faces)
    starts, ends = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    low, high = np.minimum(starts, ends), np.maximum(starts, ends)
    _, first, inverse = np.unique(low * len(points) + high, return_index=True, return_inverse=True)
    a, b = low[first], high[first]
    chord, turn = points[b] - points[a], normals[b] - normals[a]
    lift = np.einsum("ij,ij->i", chord, turn) / 8.0
    # Across a sharp rim the normals turn without the surface being round.
    length = np.linalg.norm(chord, axis=1)
    lift = np.clip(lift, -0.15 * length, 0.15 * length)
    upwards = normals[a] + normals[b]
    upwards = upwards / np.maximum(np.linalg.norm(upwards, axis=1), 1e-300)[:, None]
    middle = 0.5 * (points[a] + points[b]) + lift[:, None] * upwards
    m = (len(points) + inverse.reshape(-1, 3)).astype(np.intp)  # on the sides 01, 12, 20
    corners = [
        np.column_stack([faces[:, 0], m[:, 0], m[:, 2]]),
        np.column_stack([m[:, 0], faces[:, 1], m[:, 1]]),
        np.column_stack([m[:, 2], m[:, 1], faces[:, 2]]),
        m,
    ]
    return np.vstack([points, middle]), np.vstack(corners)
