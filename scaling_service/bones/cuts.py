"""Ends at which the image or a saw cut a bone off, open or closed by a plane."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from scaling_service.bones.shapes import spread_directions
from scaling_service.bones.surface import Surface
from scaling_service.core.arrays import Array

_OPEN, _FLAT = 0.35, 0.4
"""Shares of a section just below an end: bone that faces outwards covers an anatomical end wholly and an open
cut by its rim's rounding only; of a closed cut more than so much lies in one plane. Chosen between them."""
_CAP_M, _BLOCK_M, _BAND_M = 1e-3, 0.015, (0.003, 0.008)  # chosen: depths of a plane, an end and a section

_DIRECTIONS = 150  # chosen: on half of all, 11 degrees apart; a plane is sought within 26
_AWAY = 0.9  # chosen: cosine to a direction within which a plane is sought
_WIDE_M = 0.02  # chosen: a rim as wide is a cut shaft's, as in ``edges``


def is_cut(bone: Surface, outward: Array) -> bool:
    """Whether a bone's end in a direction is a cut, open or closed by a plane, and no end of a bone's own."""
    below = bone.smooth @ outward
    below = below.max() - below
    band = bone.smooth[(below > _BAND_M[0]) & (below < _BAND_M[1])]
    section = _measure_section(band, outward)
    if section <= 0.0:
        return False
    facing = (below < _BLOCK_M) & (bone.normals @ outward > 0.7)
    if float(bone.areas[facing].sum()) < _OPEN * section:
        return True
    normal = bone.areas[facing] @ bone.normals[facing]
    normal = normal / np.linalg.norm(normal)
    level = bone.smooth[facing] @ normal
    plane = (level.max() - level < _CAP_M) & (bone.normals[facing] @ normal > 0.95)
    return float(bone.areas[facing][plane].sum()) > _FLAT * section


def find_cut_plane(bone: Surface) -> Array | None:
    """Outward normal of the plane in which a bone ends, (3,), or None where it ends nowhere."""
    rim = bone.rims.points[bone.rims.widths > _WIDE_M]
    if len(rim) >= 3:
        middle = rim.mean(axis=0)
        normal = np.linalg.svd(rim - middle, full_matrices=False)[2][2]
        return np.asarray(normal * np.sign(normal @ (middle - bone.middle())))
    half = spread_directions(_DIRECTIONS)
    _, normal = max((_measure_plane(bone, way) for way in (*half, *-half)), key=lambda found: found[0])
    return normal if is_cut(bone, normal) else None


def _measure_plane(bone: Surface, outward: Array) -> tuple[float, Array]:
    """Area in the outermost plane about a direction, m2, and the plane's normal."""
    facing = bone.normals @ outward > _AWAY
    if not facing.any():
        return 0.0, outward
    normal = bone.areas[facing] @ bone.normals[facing]
    normal = normal / np.linalg.norm(normal)
    level = bone.smooth @ normal
    plane = (level.max() - level < _CAP_M) & (bone.normals @ normal > 0.95)
    return float(bone.areas[plane].sum()), normal


def _measure_section(points: Array, normal: Array) -> float:
    """Area of the hull of points seen along a direction, m2."""
    axes = np.linalg.svd(normal[None])[2][1:]
    try:
        return float(ConvexHull(points @ axes.T).volume)
    except (QhullError, ValueError):
        return 0.0
