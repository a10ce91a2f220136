"""Where one model puts the joint centres, seen from another model that follows the same recording."""

from __future__ import annotations

import numpy as np

from scaling_service.model.anatomy.lengths import joint_centres
from scaling_service.model.body import BodyModel, Marker, Vector
from scaling_service.model.compile import compile_model, parameter_values
from scaling_service.model.results import Array
from scaling_service.numerics.multibody.tree import marker_positions

_CORNERS: tuple[Vector, ...] = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
"""The origin of a frame and the ends of its axes, m."""


def placed_centres(model: BodyModel, q: Array, reference: BodyModel, reference_q: Array) -> dict[str, Vector]:
    """A model's joint centres in the segments of a reference that moves alongside.

    Two models' own segment frames may lie differently in the body, so their local coordinates do not
    compare. In space they do, and the reference's proximal segment is the frame to look from.

    Parameters
    ----------
    q, reference_q : ndarray, shape (n_frames, n_coordinates), rad or m
        Of the same frames, each in its model's order.

    Returns
    -------
    dict
        ``hip_r``, ``knee_r`` … that both have to the mean over frames, m; frames that do not determine it are
        left out. The reference seen from itself gives its own local coordinates.
    """
    theirs = joint_centres(reference)
    points = {name: at for name, at in joint_centres(model).items() if name in theirs}
    placed = _in_ground(model, q, points)
    frames = {segment for name, (segment, _) in theirs.items() if name in points}
    corners = _in_ground(
        reference,
        reference_q,
        {f"{segment} {k}": (segment, at) for segment in frames for k, at in enumerate(_CORNERS)},
    )
    found = {}
    for name, point in placed.items():
        origin, *ends = (corners[f"{theirs[name][0]} {k}"] for k in range(4))
        axes = np.stack(ends, axis=1) - origin[:, None]
        local = np.einsum("nij,nj->ni", axes, point - origin)
        known = local[np.isfinite(local).all(axis=1)]
        if len(known):
            x, y, z = (float(v) for v in known.mean(axis=0))
            found[name] = (x, y, z)
    return found


def _in_ground(model: BodyModel, q: Array, points: dict[str, tuple[str, Vector]]) -> dict[str, Array]:
    """Points of segments over all frames, each (n_frames, 3), m."""
    carrier = model.with_markers(tuple(Marker.at(name, *place) for name, place in points.items()))
    placed = marker_positions(compile_model(carrier), q, parameter_values(carrier))
    return {name: placed[:, k] for k, name in enumerate(points)}
