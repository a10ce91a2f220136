"""Coarse copies of surfaces, small enough to travel within a page."""

from __future__ import annotations

import numpy as np
import trimesh

from scaling_service.model.trial import Bone

MOST_FACES = 4000
"""Chosen: a bone keeps its shape at the size of a screen, and takes 0.1 MB of the page."""


def coarsened(bone: Bone, most_faces: int = MOST_FACES) -> Bone:
    """A surface of fewer triangles, by collapsing edges where it hardly changes (VTK's quadric decimation).

    Thin plates such as the wing of a pelvis keep both of their sides. For pictures, not for measuring.

    Parameters
    ----------
    bone : Bone
    most_faces : int
        About the number left; a surface that has no more stays as it is.

    Examples
    --------
    >>> import numpy as np
    >>> flat = Bone(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
    >>> coarsened(flat).faces.shape
    (1, 3)
    """
    count = len(bone.faces)
    if count <= most_faces:
        return bone
    import pyvista  # only here: it takes half a second and 80 MB, which who shows no bones should not pay

    # STL files repeat each corner in every triangle; only shared edges can be collapsed.
    merged = trimesh.Trimesh(bone.vertices, bone.faces)
    merged.update_faces(merged.nondegenerate_faces())
    surface = pyvista.PolyData.from_regular_faces(merged.vertices, np.asarray(merged.faces, dtype=int))
    reduced = surface.decimate(1.0 - most_faces / count)
    return Bone(np.asarray(reduced.points, dtype=np.float64), np.asarray(reduced.regular_faces))
