"""Where a body's segments are in every frame, as positions and quaternions."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from scaling_service.kernels.tree import marker_positions
from scaling_service.models.body import BodyModel, Marker, Vector
from scaling_service.models.compile import compile_model, parameter_values
from scaling_service.models.trial import Array

_CORNERS: tuple[Vector, ...] = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_BLOCK = 4096
"""Frames at a time. Chosen: some tens of megabytes for a whole body."""


def segment_poses(model: BodyModel, q: Array) -> Array:
    """Origins and rotations of all segments.

    Parameters
    ----------
    model : BodyModel
    q : ndarray, shape (n_frames, n_coordinates), rad or m
        NaN where unknown.

    Returns
    -------
    ndarray, shape (n_frames, n_segments, 7)
        Origin in ground, m, then the quaternion x, y, z, w that turns the segment's frame to ground; NaN
        where the segment hangs on something unknown.
    """
    points = tuple(
        Marker.at(f"{segment.name} {k}", segment.name, corner)
        for segment in model.segments
        for k, corner in enumerate(_CORNERS)
    )
    placed = _in_blocks(_placing(model.with_markers(points)), q)
    corners = placed.reshape(len(q), len(model.segments), 4, 3)
    origins = corners[:, :, 0]
    R_ground_segment = np.swapaxes(corners[:, :, 1:] - origins[:, :, None], 2, 3)
    quaternions = np.full((*origins.shape[:2], 4), np.nan)
    known = np.asarray(np.isfinite(corners).all(axis=(2, 3)))
    if known.any():
        quaternions[known] = Rotation.from_matrix(R_ground_segment[known]).as_quat()
    return np.concatenate([np.where(known[:, :, None], origins, np.nan), quaternions], axis=2)


def placed_markers(model: BodyModel, names: tuple[str, ...], q: Array) -> Array:
    """Model markers in ground, (n_frames, n_names, 3), m; NaN for names that the model does not have."""
    have = [name for name in names if name in model.marker_names]
    result = np.full((len(q), len(names), 3), np.nan)
    if have:
        carrier = model.with_markers(tuple(model.marker(name) for name in have))
        result[:, [names.index(name) for name in have]] = _in_blocks(_placing(carrier), q)
    return result


def glides(model: BodyModel, names: tuple[str, ...]) -> bool:
    """Whether any of these markers moves on its segment."""
    chosen = [marker for marker in model.markers if marker.name in names]
    return any(term.coordinate is not None for m in chosen for law in m.laws for term in law.terms)


def _placing(model: BodyModel) -> Callable[[Array], Array]:
    tree, p = compile_model(model), parameter_values(model)
    return lambda q: marker_positions(tree, q, p)


def _in_blocks(place: Callable[[Array], Array], q: Array) -> Array:
    return np.concatenate([place(q[k : k + _BLOCK]) for k in range(0, len(q), _BLOCK)])
