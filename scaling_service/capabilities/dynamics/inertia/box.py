"""Where a segment's centre of mass may be: in the box of what the model shows of the segment."""

from __future__ import annotations

import numpy as np

from scaling_service.capabilities.dynamics.inertia.cone import Body
from scaling_service.model.body import BodyModel, Segment
from scaling_service.model.compile import default_coordinates, parameter_values
from scaling_service.model.inertia import tensor_of, whole_tree
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.tree import forward


def bodies_of(model: BodyModel) -> tuple[Body, ...]:
    """The box of every segment with mass, in its own frame.

    It spans the joint centres (the segment's own and those of the segments that it carries, in the model's
    default posture) and the markers on it. Along each axis it reaches at least one standard deviation of the
    segment's own mass to both sides of the prior's centre, for so far the segment itself reaches.
    """
    origins, axes = _posture(model)
    return tuple(
        Body(k, *_box(model, k, segment, origins, axes))
        for k, segment in enumerate(model.segments)
        if segment.mass > 0
    )


def _posture(model: BodyModel) -> tuple[Array, Array]:
    """Origins (n, 3) and axes (n, 3, 3; columns are a segment's axes in ground) of all segments."""
    q = default_coordinates(model, 1).T
    poses = forward(whole_tree(model), np.ascontiguousarray(q), parameter_values(model))
    return poses.origins[..., 0], poses.axes[..., 0].transpose(0, 2, 1)


def _box(model: BodyModel, k: int, segment: Segment, origins: Array, axes: Array) -> tuple[Array, Array]:
    carried = [i for i, s in enumerate(model.segments) if s.parent == segment.name]
    joints = (origins[[k, *carried]] - origins[k]) @ axes[k]
    markers = np.array([m.nominal for m in model.markers if m.segment == segment.name]).reshape(-1, 3)
    com = np.array(segment.com)
    tensor = tensor_of(segment.inertia)
    moments = 0.5 * np.trace(tensor) - np.diag(tensor)
    reach = np.sqrt(np.clip(moments, 0.0, None) / segment.mass)
    points = np.concatenate([joints, markers, [com - reach, com + reach]])
    return points.min(axis=0), points.max(axis=0)
