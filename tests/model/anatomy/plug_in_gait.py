"""How Plug-in Gait follows a foot in movement: by toe marker and ankle centre, with standing's sole."""

from __future__ import annotations

import numpy as np

from scaling_service.model.anatomy.frames import Array, Frames, Points, Side, build_tibia_frame, level_heel


def foot_offset(standing: Points, side: Side, *, flat: bool = True) -> Array:
    """The foot's line in the frame of shank and toe marker, (3,), from ``KJC AJC LM HEE TOE`` standing."""
    heel = level_heel(standing, side) if flat else standing[f"{side.upper()}HEE"]
    line = np.atleast_2d(standing[f"{side.upper()}TOE"]) - heel
    local = np.einsum("nji,nj->ni", _toe_frame(standing, side).rotation, line)
    known = local[np.isfinite(local).all(axis=1)]
    mean = (known / np.linalg.norm(known, axis=1, keepdims=True)).sum(axis=0)
    return np.asarray(mean / np.linalg.norm(mean))


def heel_from_offset(moving: Points, side: Side, offset: Array) -> Array:
    """A point on the foot's line behind the toe marker, (n_frames, 3), m, from ``KJC AJC LM TOE``."""
    return np.asarray(
        np.atleast_2d(moving[f"{side.upper()}TOE"]) - _toe_frame(moving, side).rotation @ offset
    )


def _toe_frame(points: Points, side: Side) -> Frames:
    """Its x runs from ankle centre to toe marker, z as near to the shank's as can be."""
    knee, ankle, lateral, toe = (
        np.atleast_2d(points[f"{side.upper()}{name}"]) for name in ("KJC", "AJC", "LM", "TOE")
    )
    x = (toe - ankle) / np.linalg.norm(toe - ankle, axis=1, keepdims=True)
    y = np.cross(build_tibia_frame(knee, ankle, lateral, ankle, side).rotation[:, :, 2], x)
    y = y / np.linalg.norm(y, axis=1, keepdims=True)
    return Frames(np.stack([x, y, np.cross(x, y)], axis=2), toe)
