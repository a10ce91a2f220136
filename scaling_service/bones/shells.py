"""The connectivity of a triangle mesh: merging, pieces, winding. Index arrays in and out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

Array = NDArray[np.float64]
Faces = NDArray[np.intp]

_GRID = 2**21 - 1  # three such coordinates fit one 64-bit number; a 0.5 m bone is resolved to 0.25 um


def merged(vertices: Array, faces: Faces) -> tuple[Array, Faces]:
    """One vertex for each place (STL repeats them for every face), unused ones gone."""
    low = vertices.min(axis=0)
    size = float((vertices.max(axis=0) - low).max()) or 1.0
    cells = np.rint((vertices - low) * (_GRID / size)).astype(np.int64)
    key = (cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2]
    _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    triangles = inverse[faces]
    used, compact = np.unique(triangles, return_inverse=True)
    return vertices[first[used]], compact.reshape(-1, 3).astype(np.intp)


def without_useless_faces(faces: Faces) -> Faces:
    """No face with a repeated corner, and none twice."""
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    ordered = np.sort(faces, axis=1)
    n = int(faces.max()) + 1 if len(faces) else 1
    # Below 2 million vertices the three indices fit one number.
    key = (ordered[:, 0] * n + ordered[:, 1]) * n + ordered[:, 2]
    _, first = np.unique(key, return_index=True)
    kept: Faces = faces[np.sort(first)]
    return kept


def shells(n_vertices: int, faces: Faces) -> NDArray[np.intp]:
    """Number of the connected piece of each vertex."""
    rows = np.concatenate([faces[:, 0], faces[:, 1]])
    columns = np.concatenate([faces[:, 1], faces[:, 2]])
    graph = coo_array((np.ones(len(rows), dtype=bool), (rows, columns)), shape=(n_vertices, n_vertices))
    _, label = connected_components(graph, directed=False)
    numbers: NDArray[np.intp] = label.astype(np.intp)
    return numbers


def boundary_share(faces: Faces) -> float:
    """Share of edges that have one face only."""
    _, counts = np.unique(_edge_keys(faces), return_counts=True)
    return float((counts == 1).mean())


def wound_alike(n_vertices: int, faces: Faces) -> tuple[Faces, int]:
    """Faces turned so that neighbours are wound the same way, and how many were turned.

    Each face becomes two nodes, as it is and turned; edges of the graph join what can stand together.
    Then the two halves of every piece are two connected components, and one of them is kept.
    """
    starts, ends = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    key = np.minimum(starts, ends) * n_vertices + np.maximum(starts, ends)
    order = np.argsort(key, kind="stable")
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


def _edge_keys(faces: Faces) -> NDArray[np.intp]:
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    keys: NDArray[np.intp] = edges[:, 0] * (int(faces.max()) + 1) + edges[:, 1]
    return keys
