"""Where a body's segments are in every frame, as positions and quaternions."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from scaling_service.model.body import BodyModel, Marker, Vector
from scaling_service.model.compile import compile_model, parameter_values
from scaling_service.model.trial import Array
from scaling_service.numerics.multibody.tree import marker_positions

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
    flat = Rotation.from_matrix(R_ground_segment.reshape(-1, 3, 3)).as_quat()
    poses = np.concatenate([origins, flat.reshape(*origins.shape[:2], 4)], axis=2)
    enters = _coordinates_of(model)
    for k, segment in enumerate(model.segments):
        poses[_unknown(model, q, enters[segment.name]), k] = np.nan
    return poses


def placed_markers(model: BodyModel, names: tuple[str, ...], q: Array) -> Array:
    """Model markers in ground, (n_frames, n_names, 3), m; NaN for names that the model does not have."""
    have = [name for name in names if name in model.marker_names]
    result = np.full((len(q), len(names), 3), np.nan)
    if have:
        carrier = model.with_markers(tuple(model.marker(name) for name in have))
        result[:, [names.index(name) for name in have]] = _in_blocks(_placing(carrier), q)
        enters = _coordinates_of(model)
        for marker in carrier.markers:
            own = {t.coordinate for law in marker.laws for t in law.terms if t.coordinate is not None}
            lost = _unknown(model, q, own | enters[marker.segment])
            result[lost, names.index(marker.name)] = np.nan
    return result


def glides(model: BodyModel, names: tuple[str, ...]) -> bool:
    """Whether any of these markers moves on its segment."""
    chosen = [marker for marker in model.markers if marker.name in names]
    return any(term.coordinate is not None for m in chosen for law in m.laws for term in law.terms)


def _coordinates_of(model: BodyModel) -> dict[str, set[str]]:
    """Segment to the coordinates that its pose depends on, its own and those of what it hangs on."""
    found: dict[str, set[str]] = {}
    for segment in model.segments:
        own = {t.coordinate for joint in segment.joints for t in joint.law.terms if t.coordinate is not None}
        found[segment.name] = own | found.get(segment.parent, set())
    return found


def _unknown(model: BodyModel, q: Array, names: set[str]) -> NDArray[np.bool_]:
    """Frames in which one of some coordinates is not known, (n_frames,)."""
    columns = [k for k, name in enumerate(model.coordinate_names) if name in names]
    return np.asarray(np.isnan(q[:, columns]).any(axis=1))


def _placing(model: BodyModel) -> Callable[[Array], Array]:
    tree, p = compile_model(model), parameter_values(model)
    # One unknown angle would make all of a frame unknown: any value stands in, and is taken out again.
    return lambda q: marker_positions(tree, np.nan_to_num(q, nan=0.0), p)


def _in_blocks(place: Callable[[Array], Array], q: Array) -> Array:
    return np.concatenate([place(q[k : k + _BLOCK]) for k in range(0, len(q), _BLOCK)])
