"""Leg angles that put a foot where it is planned: the closed form of a ball, a hinge and a two-axis ankle.

Used to plan movements only; what is recorded comes from the engine at the angles found.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from tests.blind.body import Array, Body


class OutOfReachError(ValueError):
    """The foot is farther away than the leg is long."""


def leg_angles(
    body: Body, side: str, pelvis: Array, R_pelvis: Array, ankle: Array, R_foot: Array
) -> dict[str, Array]:
    """Hip, knee and ankle angles of one leg.

    Parameters
    ----------
    body : Body
        Knee and ankle lie on the y axes of thigh and shank.
    side : 'r' or 'l'
    pelvis, ankle : ndarray, shape (n, 3), m
        Pelvis origin and ankle centre in ground.
    R_pelvis, R_foot : ndarray, shape (n, 3, 3)
        From pelvis and foot to ground.

    Raises
    ------
    OutOfReachError
    """
    s = 1.0 if side == "r" else -1.0
    thigh, shank = (-body.of_joint(f"{joint}_{side}").centre[1] for joint in ("knee", "ankle"))
    hip = pelvis + R_pelvis @ np.array(body.of_joint(f"hip_{side}").centre)
    seen = np.einsum("nji,nj->ni", R_foot, hip - ankle)  # hip in the foot's frame
    distance = np.linalg.norm(seen, axis=1)
    if (distance >= thigh + shank).any():
        raise OutOfReachError(f"leg {side}: {distance.max():.3f} m of {thigh + shank:.3f} m")
    cosine = (distance**2 - thigh**2 - shank**2) / (2 * thigh * shank)
    knee = np.arccos(np.clip(cosine, -1, 1))
    # In the shank's frame the hip lies in its xy plane; Rz(ankle) Rx(inversion) takes the foot's view there.
    inversion = np.arctan2(-seen[:, 2], seen[:, 1])
    in_plane = np.stack([seen[:, 0], np.hypot(seen[:, 1], seen[:, 2])], axis=1)
    in_shank = np.stack([-thigh * np.sin(knee), shank + thigh * np.cos(knee)], axis=1)
    ankle_angle = _heading(in_shank) - _heading(in_plane)
    R_shank = R_foot @ _matrix("x", -inversion) @ _matrix("z", -ankle_angle)
    R_thigh = R_shank @ _matrix("z", knee)
    hip_angles = Rotation.from_matrix(np.swapaxes(R_pelvis, 1, 2) @ R_thigh).as_euler("ZXY")
    return {
        f"hip_flexion_{side}": hip_angles[:, 0],
        f"hip_adduction_{side}": s * hip_angles[:, 1],
        f"hip_rotation_{side}": s * hip_angles[:, 2],
        f"knee_angle_{side}": knee,
        f"ankle_angle_{side}": ankle_angle,
        f"ankle_inversion_{side}": s * inversion,
    }


def _heading(xy: Array) -> Array:
    heading: Array = np.arctan2(xy[:, 1], xy[:, 0])
    return heading


def _matrix(axis: str, angle: Array) -> Array:
    matrix: Array = Rotation.from_euler(axis, angle[:, None]).as_matrix()
    return matrix
