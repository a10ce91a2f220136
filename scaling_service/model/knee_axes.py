"""The direction of a knee axis as turns about x, then y, of the thigh."""

from __future__ import annotations

import numpy as np

from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.rigid import rotation_about

Tilt = tuple[float, float]


def axis_of(tilt: Tilt) -> Array:
    """The axis, (3,), that the turns make of z: ``Ry(y) Rx(x) z`` (Puchaud 2019, section 2.2.4)."""
    axis: Array = tilt_rotation(tilt)[:, 2]
    return axis


def tilt_rotation(tilt: Tilt) -> Array:
    """``Ry(y) Rx(x)``, (3, 3)."""
    x, y = tilt
    rotation: Array = rotation_about((0.0, 1.0, 0.0), y) @ rotation_about((1.0, 0.0, 0.0), x)
    return rotation


def tilt_of(axis: Array) -> Tilt:
    """The turns about x and y that make z point along an axis, (3,), of which z is positive.

    Examples
    --------
    >>> x, y = tilt_of(axis_of((0.1, -0.2)))
    >>> round(x, 12), round(y, 12)
    (0.1, -0.2)
    """
    unit = axis / np.linalg.norm(axis)
    return float(-np.arcsin(unit[1])), float(np.arctan2(unit[0], unit[2]))


def after(first: Tilt, second: Tilt) -> Tilt:
    """The tilt of an axis that was turned once and is turned again in its own turned frame."""
    return tilt_of(tilt_rotation(first) @ axis_of(second))
