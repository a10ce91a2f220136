"""Coarse copies of surfaces, small enough to travel within a page."""

from __future__ import annotations

import numpy as np

from scaling_service.models.images import Array, Bone

MOST_FACES = 4000
"""Chosen: a bone keeps its shape at the size of a screen, and takes 0.1 MB of the page."""

_FINEST = 160
"""Cells along the longest side to begin with; finer ones would not be seen. Chosen."""

_MARGIN = 0.97
"""Chosen: the number of triangles follows the square of the cells only nearly."""


def coarsened(bone: Bone, most_faces: int = MOST_FACES) -> Bone:
    """A surface of fewer triangles, by merging the corners that fall into one cell of a grid.

    Vertex clustering (Rossignac & Borrel 1993, "Multi-resolution 3D approximations for rendering complex
    scenes"); each cell's corner is the mean of those merged. For pictures, not for measuring.

    Parameters
    ----------
    bone : Bone
    most_faces : int
        The grid is widened until no more are left.

    Examples
    --------
    >>> import numpy as np
    >>> flat = Bone(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
    >>> coarsened(flat).faces.shape
    (1, 3)
    """
    size = float(np.ptp(bone.vertices, axis=0).max())
    cells = float(_FINEST)
    found = bone
    while len(found.faces) > most_faces:
        found = _clustered(bone, size / cells)
        cells *= _MARGIN * min(1.0, float(np.sqrt(most_faces / max(len(found.faces), 1))))
    return found


def _clustered(bone: Bone, cell: float) -> Bone:
    low = bone.vertices.min(axis=0)
    keys = np.floor((bone.vertices - low) / cell).astype(np.int64)
    flat = (keys[:, 0] << 40) | (keys[:, 1] << 20) | keys[:, 2]
    _, owner, counts = np.unique(flat, return_inverse=True, return_counts=True)
    corners: Array = np.stack([np.bincount(owner, bone.vertices[:, k]) for k in range(3)], axis=1)
    corners /= counts[:, None]
    faces = owner[bone.faces]
    whole = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    faces = faces[whole]
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    kept = faces[np.sort(first)]
    used, renumbered = np.unique(kept, return_inverse=True)
    return Bone(corners[used], renumbered.reshape(kept.shape))
