"""Where a body's segments and markers are: one pose written out plainly, and all frames of a recording.

The single pose (the neutral one, a drawing, a segment's length) is built from the laws themselves, beside the
kernels that do the same for thousands of frames at once.
"""

from __future__ import annotations

from collections import abc

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from scaling_service.core.arrays import Array
from scaling_service.model import compile as compiling
from scaling_service.model.body import GROUND, BodyModel, Joint, Marker, Vector
from scaling_service.numerics.multibody.rigid import rotate_about
from scaling_service.numerics.multibody.tree import pose_markers

Frame = tuple[Array, Array]
"""Rotation (3, 3) that maps the frame to ground, and its origin in ground (3,), m."""

_CORNERS: tuple[Vector, ...] = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_BLOCK = 4096
"""Frames at a time. Chosen: some tens of megabytes for a whole body."""


def list_model_values(model: BodyModel, values: abc.Mapping[str, float] | None = None) -> dict[str, float]:
    """Coordinates at their default and parameters at their value, unless ``values`` says otherwise.

    ``values``: coordinate or parameter name to its value, rad or m. KeyError: a name that the model does not
    have.
    """
    known = {c.name: c.default for c in model.coordinates} | {p.name: p.value for p in model.parameters}
    for name, value in (values or {}).items():
        if name not in known:
            raise KeyError(name)
        known[name] = float(value)
    return known


def straighten(model: BodyModel) -> dict[str, float]:
    """Parameters at their value, coordinates that turn anything at zero, the others at their default."""
    turning = [c for _, joint in model.joints() if joint.kind == "rotation" for c in joint.law.coordinates]
    return list_model_values(model, dict.fromkeys(turning, 0.0))


def pose_neutral_frames(model: BodyModel, values: abc.Mapping[str, float] | None = None) -> dict[str, Frame]:
    """The frame of every segment in one pose.

    ``values``: coordinates (or parameters) that differ from the default, rad or m. Returns segment to
    ``(R_ground_segment, origin_ground)``, shapes (3, 3) and (3,), m; ground included.

    Examples
    --------
    >>> from scaling_service.model.body import BodyModel, Coordinate, Joint, Law, Segment
    >>> lift = Joint("translation", (0.0, 1.0, 0.0), Law.of("height"))
    >>> cage = Segment(name="cage", parent="ground", joint_name="shaft", joints=(lift,))
    >>> model = BodyModel(name="lift", segments=(cage,), coordinates=(Coordinate(name="height"),))
    >>> pose_neutral_frames(model, {"height": 2.0})["cage"][1].tolist()
    [0.0, 2.0, 0.0]
    """
    known = list_model_values(model, values)
    frames: dict[str, Frame] = {GROUND: (np.eye(3), np.zeros(3))}
    for segment in model.segments:
        frames[segment.name] = follow(segment.joints, known, frames[segment.parent])
    return frames


def follow(joints: abc.Sequence[Joint], values: abc.Mapping[str, float], start: Frame | None = None) -> Frame:
    """The frame that a chain of joints leads to from ``start`` (by default from its own parent's frame)."""
    rotation, origin = start if start is not None else (np.eye(3), np.zeros(3))
    for joint in joints:
        value = compiling.evaluate_law(joint.law, values)
        if value == 0.0:  # as most are in a neutral pose
            continue
        if joint.kind == "translation":
            origin = origin + rotation @ (value * np.asarray(joint.axis))
        else:
            rotation = rotation @ rotate_about(joint.axis, value)
    return rotation, origin


def pose_neutral_markers(model: BodyModel, values: abc.Mapping[str, float] | None = None) -> dict[str, Array]:
    """Position of every marker in ground in one pose, each (3,), m; see :func:`pose_neutral_frames`."""
    known, frames = list_model_values(model, values), pose_neutral_frames(model, values)
    positions = {}
    for marker in model.markers:
        rotation, origin = frames[marker.segment]
        positions[marker.name] = origin + rotation @ evaluate_marker(marker, known)
    return positions


def evaluate_marker(marker: Marker, values: abc.Mapping[str, float]) -> Array:
    """A marker's position in its segment's frame, (3,), m."""
    return np.array([compiling.evaluate_law(law, values) for law in marker.laws])


def pose_segments(model: BodyModel, q: Array) -> Array:
    """Origins and rotations of all segments.

    ``q`` ((n_frames, n_coordinates), rad or m): NaN where unknown. Returns (n_frames, n_segments, 7): origin
    in ground, m, then the quaternion x, y, z, w that turns the segment's frame to ground; NaN where the
    segment hangs on something unknown.
    """
    points = tuple(
        Marker.at(f"{segment.name} {k}", segment.name, corner)
        for segment in model.segments
        for k, corner in enumerate(_CORNERS)
    )
    placed = _place_known(model, points, q)
    corners = placed.reshape(len(q), len(model.segments), 4, 3)
    origins = corners[:, :, 0]
    R_ground_segment = np.swapaxes(corners[:, :, 1:] - origins[:, :, None], 2, 3)
    flat = Rotation.from_matrix(R_ground_segment.reshape(-1, 3, 3)).as_quat()
    poses = np.concatenate([origins, flat.reshape(*origins.shape[:2], 4)], axis=2)
    enters = _list_coordinates(model)
    for k, segment in enumerate(model.segments):
        poses[_find_unknown(model, q, enters[segment.name]), k] = np.nan
    return poses


def place_markers(model: BodyModel, names: tuple[str, ...], q: Array) -> Array:
    """Model markers in ground, (n_frames, n_names, 3), m; NaN for names that the model does not have."""
    have = [name for name in names if name in model.marker_names]
    result = np.full((len(q), len(names), 3), np.nan)
    points = tuple(model.marker(name) for name in have)
    result[:, [names.index(name) for name in have]] = place_points(model, points, q)
    return result


def place_points(model: BodyModel, points: tuple[Marker, ...], q: Array) -> Array:
    """Points of a model's segments in ground, (n_frames, n_points, 3), m; NaN where they are not known."""
    placed = _place_known(model, points, q)
    enters = _list_coordinates(model)
    for k, point in enumerate(points):
        own = {c for law in point.laws for c in law.coordinates}
        placed[_find_unknown(model, q, own | enters[point.segment]), k] = np.nan
    return placed


def sweep_coordinates(model: BodyModel, steps: int) -> dict[str, Array]:
    """Each free rotation over its range, half a turn to each side at most, the others at their default.

    Returns coordinate to its poses, (steps, n_coordinates), rad or m.
    """
    default = np.array([c.default for c in model.coordinates])
    found: dict[str, Array] = {}
    for k, own in enumerate(model.coordinates):
        if own.kind == "rotation" and not own.locked:
            found[own.name] = np.tile(default, (steps, 1))
            found[own.name][:, k] = np.linspace(max(own.lower, -np.pi), min(own.upper, np.pi), steps)
    return found


def is_gliding(model: BodyModel, names: tuple[str, ...]) -> bool:
    """Whether any of these markers moves on its segment."""
    chosen = [marker for marker in model.markers if marker.name in names]
    return any(law.coordinates for marker in chosen for law in marker.laws)


def _list_coordinates(model: BodyModel) -> dict[str, set[str]]:
    """Segment to the coordinates that its pose depends on, its own and those of what it hangs on."""
    found: dict[str, set[str]] = {}
    for segment in model.segments:
        own = {c for joint in segment.joints for c in joint.law.coordinates}
        found[segment.name] = own | found.get(segment.parent, set())
    return found


def _find_unknown(model: BodyModel, q: Array, names: set[str]) -> NDArray[np.bool_]:
    """Frames in which one of some coordinates is not known, (n_frames,)."""
    columns = [k for k, name in enumerate(model.coordinate_names) if name in names]
    return np.asarray(np.isnan(q[:, columns]).any(axis=1))


def _place_known(model: BodyModel, points: tuple[Marker, ...], q: Array) -> Array:
    """Points as if all were known: any value stands in for an unknown angle."""
    placed = np.empty((len(q), len(points), 3))
    if points:
        tree, p = compiling.compile_points(model, points), compiling.list_parameter_values(model)
        for rows in (slice(k, k + _BLOCK) for k in range(0, len(q), _BLOCK)):
            placed[rows] = pose_markers(tree, np.nan_to_num(q[rows], nan=0.0), p)
    return placed
