"""Inertial parameters of segments along the directions that effects take."""

from __future__ import annotations

import numpy as np

from scaling_service.model.body import Segment
from scaling_service.model.inertia import tensor_of
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.mechanism import TENSOR


def of_segment(segment: Segment) -> Array:
    """The ten parameters about the segment's origin."""
    com = np.array(segment.com)
    tensor = tensor_of(segment.inertia) + segment.mass * spread(com, com)
    return np.concatenate([[segment.mass], segment.mass * com, [tensor[i, j] for i, j in TENSOR]])


def spread(a: Array, b: Array) -> Array:
    """The mixed part of a unit mass' tensor at a + b, halved: ``a.b 1 - (a b' + b a') / 2``."""
    return np.asarray(a @ b * np.eye(3) - 0.5 * (np.outer(a, b) + np.outer(b, a)))


def of_centre(segment: Segment, axis: int) -> Array:
    """The change of the ten parameters per metre of the centre of mass."""
    com, unit = np.array(segment.com), np.eye(3)[axis]
    tensor = 2.0 * segment.mass * spread(com, unit)
    return np.concatenate([[0.0], segment.mass * unit, [tensor[i, j] for i, j in TENSOR]])
