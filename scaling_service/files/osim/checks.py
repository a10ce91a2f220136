"""What is asked of a body model before OpenSim writes it, and of the file after (worker side)."""

from __future__ import annotations

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.core.errors import ModelRefused
from scaling_service.model import body
from scaling_service.model import compile as compiling
from scaling_service.numerics.multibody.tree import pose_markers

SAME = 1e-6
"""m; the most that a written model may differ (chosen: a thousandth of a marker's measuring error)."""

_CHECKED_POSES = 8
_CHECKED_REACH = 1.0  # rad or m, to either side where a coordinate has no range (chosen)
_GOLDEN = 0.6180339887498949  # fractional part of the golden ratio: spreads poses evenly
FORBIDDEN = "\\/*+ \t\n"
"""Characters that OpenSim refuses in names (Component::extendFinalizeFromProperties)."""


def check_writable(model: body.BodyModel) -> None:
    """Refuse names that OpenSim does not accept, and markers that move on their segments."""
    joints = [s.joint_name for s in model.segments]
    for name in (*model.segment_names, *joints, *model.coordinate_names, *model.marker_names):
        if not name or set(name) & set(FORBIDDEN):
            raise ModelRefused(
                f"OpenSim does not accept the name '{name}'",
                field=name,
                remedy="Rename it without spaces, slashes, '*' and '+'",
            )
    for marker in model.markers:
        if not all(law.is_constant for law in marker.laws):
            raise ModelRefused(
                f"marker '{marker.name}' moves on its segment, which OpenSim cannot represent",
                field=marker.name,
                remedy="Write it without its soft tissue law; the JSON model keeps the law",
            )


def check_same(model: body.BodyModel, written: body.BodyModel) -> None:
    """Compare every segment, and every marker, at poses spread over the coordinates' ranges."""
    absent = set(model.segment_names) ^ set(written.segment_names)
    if absent:
        raise ModelRefused(
            f"segment '{min(absent)}' is in one of the models only",
            field=min(absent),
            remedy="Write the model without a source",
        )
    # The default pose and a few more, shape (n, n_coordinates): a fixed, evenly spread choice.
    coordinates = model.coordinates
    default = np.array([c.default for c in coordinates])
    lower = np.array([c.lower if np.isfinite(c.lower) else c.default - _CHECKED_REACH for c in coordinates])
    upper = np.array([c.upper if np.isfinite(c.upper) else c.default + _CHECKED_REACH for c in coordinates])
    steps = np.arange(1, _CHECKED_POSES + 1)[:, None] * np.arange(1, len(coordinates) + 1)
    poses = np.vstack([default, lower + (steps * _GOLDEN % 1.0) * (upper - lower)])
    order = [model.coordinate_names.index(name) for name in written.coordinate_names]
    difference = np.abs(
        _probe_segments(model, model, poses) - _probe_segments(written, model, poses[:, order])
    )
    worst = difference.max(axis=(0, 2)).reshape(len(model.segments), -1).max(axis=1)
    for segment, distance in zip(model.segments, worst, strict=True):
        if not distance <= SAME:
            raise ModelRefused(
                f"OpenSim's '{segment.joint_name}' leaves segment '{segment.name}' up to"
                f" {1000 * distance:.3g} mm away from the model's",
                field=segment.joint_name,
                remedy="OpenSim cannot hold this joint exactly; use the JSON model",
            )
    _check_constraints(model, written, poses)
    for marker in model.markers:
        shift = np.subtract(marker.nominal, written.marker(marker.name).nominal)
        if written.marker(marker.name).segment != marker.segment or np.abs(shift).max() > SAME:
            raise ModelRefused(f"marker '{marker.name}' was not written as given", field=marker.name)


def _check_constraints(model: body.BodyModel, written: body.BodyModel, poses: Array) -> None:
    """Compare what the equations of both models miss at the poses."""
    ours, theirs = compiling.compile_constraints(model), compiling.compile_constraints(written)
    if ours is None and theirs is None:
        return
    order = [model.coordinate_names.index(name) for name in written.coordinate_names]
    if ours is not None and theirs is not None and ours.count == theirs.count:
        none = np.zeros(0)
        difference = np.abs(ours.evaluate(poses, none) - theirs.evaluate(poses[:, order], none))
        if difference.max() <= SAME:
            return
    raise ModelRefused(
        "OpenSim's constraints are not the model's",
        field=(model.constraints or written.constraints)[0].name,
        remedy="OpenSim cannot hold them exactly; use the JSON model",
    )


def _probe_segments(model: body.BodyModel, order: body.BodyModel, poses: Array) -> Array:
    """Four points of each segment (in the order of another model's) in ground, (poses, points, 3)."""
    points = [(0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.1)]
    probes = tuple(
        body.Marker.at(f"{name}/{k}", name, point)
        for name in order.segment_names
        for k, point in enumerate(points)
    )
    return pose_markers(compiling.compile_model(model.with_markers(probes)), poses, np.zeros(0))
