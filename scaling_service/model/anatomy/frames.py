"""Anatomical frames from landmarks, and joint angles between them, for all frames of a trial at once.

x points forward, y up and z to the subject's right on both sides of the body (Wu et al. 2002,
J Biomech 35:543). A frame is NaN where one of its landmarks is missing or three of them lie on a line.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Side = Literal["r", "l"]
SIDES: tuple[Side, ...] = ("r", "l")

_MIN_LENGTH = 1e-6  # m; chosen: landmarks closer than a thousandth of a millimetre give no direction


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """One anatomical frame over time."""

    rotation: Array  # (n_frames, 3, 3): maps the anatomical frame to ground; columns are its x, y, z axes
    origin: Array  # (n_frames, 3), m

    def to_ground(self, points: ArrayLike) -> Array:
        """Points of this frame, (n_frames, 3) or (3,), in ground, (n_frames, 3), m."""
        local = np.broadcast_to(np.asarray(points, dtype=float), self.origin.shape)
        return np.asarray(self.origin + np.einsum("nij,nj->ni", self.rotation, local))

    def to_local(self, points: ArrayLike) -> Array:
        """Points of ground, (n_frames, 3) or (3,), in this frame, (n_frames, 3), m."""
        from_origin = np.asarray(points, dtype=float) - self.origin
        return np.asarray(np.einsum("nji,nj->ni", self.rotation, from_origin))


def pelvis_frame(rasis: ArrayLike, lasis: ArrayLike, rpsis: ArrayLike, lpsis: ArrayLike) -> Frames:
    """The pelvis frame with its origin half-way between the ASIS.

    z runs from the left to the right ASIS, y is normal to the plane of both ASIS and the midpoint of the
    PSIS, upward (Wu 2002, with another origin: hip regressions start from here).

    ``rasis``, ``lasis``, ``rpsis``, ``lpsis``: (n_frames, 3), m.
    """
    right, left = _points(rasis), _points(lasis)
    back = (_points(rpsis) + _points(lpsis)) / 2.0
    z = _unit(right - left)
    y = _unit(np.cross(right - back, left - back))
    return _frames(np.cross(y, z), y, z, (right + left) / 2.0)


def femur_frame(hip: ArrayLike, lateral: ArrayLike, medial: ArrayLike, side: Side) -> Frames:
    """The thigh's frame, origin at the hip centre (Wu 2002).

    y points from the midpoint of the epicondyles to the hip centre, z lies in the plane of the three.

    ``hip``, ``lateral``, ``medial`` ((n_frames, 3), m): hip centre and the epicondyles.
    """
    centre = _points(hip)
    y = _unit(centre - (_points(lateral) + _points(medial)) / 2.0)
    return _long_axis_frame(y, _rightward(lateral, medial, side), centre)


def tibia_frame(
    knee: ArrayLike, ankle: ArrayLike, lateral: ArrayLike, medial: ArrayLike, side: Side
) -> Frames:
    """The shank's frame about its mechanical axis, origin at the knee centre.

    y points from ankle to knee centre, x is normal to the plane of the knee centre and the malleoli,
    forward (Dumas 2007, J Biomech 40:543). With tibial torsion it is turned outward against the thigh's.

    ``knee``, ``ankle``, ``lateral``, ``medial`` ((n_frames, 3), m): knee and ankle centres and the malleoli.
    """
    centre = _points(knee)
    return _long_axis_frame(_unit(centre - _points(ankle)), _rightward(lateral, medial, side), centre)


def cardan(proximal: Frames, distal: Frames) -> Array:
    """Turns about z, x and y, in this order, that lead from the proximal to the distal frame.

    The joint coordinate system of Grood and Suntay (1983) in its Cardan form (Wu 2002).

    Returns (n_frames, 3), rad: of ``R = Rz(a) Rx(b) Ry(c)``: a, b, c with b within a right angle.
    """
    r = np.einsum("nji,njk->nik", proximal.rotation, distal.rotation)
    first = np.arctan2(-r[:, 0, 1], r[:, 1, 1])
    second = np.arcsin(np.clip(r[:, 2, 1], -1.0, 1.0))
    third = np.arctan2(-r[:, 2, 0], r[:, 2, 2])
    return np.column_stack([first, second, third])


def hip_angles(pelvis: Frames, femur: Frames, side: Side) -> Array:
    """Flexion, adduction and internal rotation of a hip, (n_frames, 3), rad."""
    return np.asarray(cardan(pelvis, femur) * _clinical(1.0, side))


def knee_angles(femur: Frames, tibia: Frames, side: Side) -> Array:
    """Flexion, adduction and internal rotation of a knee, (n_frames, 3), rad."""
    return np.asarray(cardan(femur, tibia) * _clinical(-1.0, side))


def pelvis_angles(pelvis: Frames) -> Array:
    """Rotation (to the left +), list (right side down +) and tilt (backward +), (n_frames, 3), rad.

    Of ``R = Ry Rx Rz``, the order of the built-in models' root (Baker 2001, Gait Posture 13:1).
    """
    r = pelvis.rotation
    rotation = np.arctan2(r[:, 0, 2], r[:, 2, 2])
    obliquity = np.arcsin(np.clip(-r[:, 1, 2], -1.0, 1.0))
    tilt = np.arctan2(r[:, 1, 0], r[:, 1, 1])
    return np.column_stack([rotation, obliquity, tilt])


def _clinical(flexion: float, side: Side) -> Array:
    outward = 1.0 if side == "r" else -1.0
    return np.array([flexion, outward, outward])


def _points(points: ArrayLike) -> Array:
    array: Array = np.atleast_2d(np.asarray(points, dtype=float))
    return array


def _rightward(lateral: ArrayLike, medial: ArrayLike, side: Side) -> Array:
    outward = _points(lateral) - _points(medial)
    return outward if side == "r" else -outward


def _long_axis_frame(y: Array, rightward: Array, origin: Array) -> Frames:
    x = _unit(np.cross(y, rightward))
    return _frames(x, y, np.cross(x, y), origin)


def _frames(x: Array, y: Array, z: Array, origin: Array) -> Frames:
    """Assemble the axes; where any of them is unknown, so is the origin."""
    rotation = np.stack(np.broadcast_arrays(x, y, z), axis=2)
    usable = np.isfinite(rotation).all(axis=(1, 2)) & np.isfinite(origin).all(axis=1)
    return Frames(
        np.where(usable[:, None, None], rotation, np.nan), np.where(usable[:, None], origin, np.nan)
    )


def _unit(vectors: Array) -> Array:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.where(length > _MIN_LENGTH, length, np.nan))
