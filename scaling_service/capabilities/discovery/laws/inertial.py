"""How a segment's ten inertial parameters change: with its mass, and with its centre of mass."""

from __future__ import annotations

import numpy as np

from scaling_service.capabilities.discovery.laws.loads import Inertial
from scaling_service.core.arrays import Array
from scaling_service.model.body import Segment
from scaling_service.model.inertia import to_matrix
from scaling_service.numerics.multibody.motion import TENSOR


def scale_segment(segment: Segment) -> Inertial:
    """A segment that is heavier, of the same shape: per kilogram."""
    com = np.array(segment.com)
    tensor = to_matrix(segment.inertia) + segment.mass * _spread(com, com)
    every = np.concatenate([[segment.mass], segment.mass * com, [tensor[i, j] for i, j in TENSOR]])
    return Inertial(segment.name, tuple((every / segment.mass).tolist()))


def differentiate_centre(segment: Segment, axis: int) -> tuple[float, ...]:
    """Change of the ten inertial parameters about the segment's origin per metre of its centre of mass."""
    com, unit = np.array(segment.com), np.eye(3)[axis]
    tensor = 2.0 * segment.mass * _spread(com, unit)
    return tuple(np.concatenate([[0.0], segment.mass * unit, [tensor[i, j] for i, j in TENSOR]]).tolist())


def _spread(a: Array, b: Array) -> Array:
    """The mixed part of a unit mass' tensor at a + b, halved: ``a.b 1 - (a b' + b a') / 2``."""
    return np.asarray(a @ b * np.eye(3) - 0.5 * (np.outer(a, b) + np.outer(b, a)))
