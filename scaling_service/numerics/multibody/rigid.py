"""Rotations, and the rigid motion that best carries one set of points onto another."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scaling_service.core.arrays import Array

MIN_POINTS = 3
"""A plane of points is the least that fixes an orientation (Soderkvist & Wedin 1993, sec. 2)."""

COLLINEAR = 1e-6
"""Second over first singular value of the cross-dispersion below which the points count as one line.

Chosen: dispersions are squares of lengths, so this is a cloud a thousand times longer than wide, where
1 mm of noise on a 1 m cloud turns freely about the line.
"""

_TINY_ANGLE = 1e-4  # rad, chosen: below it the next series term is under 1e-17 of the value


def fit_rigid(local: ArrayLike, measured: ArrayLike, weights: ArrayLike | None = None) -> tuple[Array, Array]:
    """Rigid motion with ``measured ~ R @ local + t`` in the weighted least-squares sense.

    ``local`` (..., m, 3) or (m, 3), m: the points in the body's own frame. NaN means that the point is not
        known.
    ``measured`` (..., m, 3), m: where they were seen. NaN means that the point was not seen.
    ``weights`` (..., m) or (m,): not negative; a point of weight zero is not used. Ones by default.
    Returns ``R`` (..., 3, 3): always a proper rotation, also where noise or a planar cloud would favour a
        reflection.
    ``t`` (..., 3), m: both are NaN where fewer than three points are usable or they lie on one line.
    Raises ValueError: if the shapes do not fit each other, or a weight is negative.

    Soderkvist I., Wedin P.-A. (1993) Determining the movements of the skeleton using well-configured markers.
    J Biomech 26:1473-1477, with weights carried through the means and the dispersion.

    Examples
    --------
    >>> import numpy as np
    >>> local = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    >>> R, t = fit_rigid(local, local + [0.0, 2, 0])
    >>> bool(np.allclose(R, np.eye(3))), t.round(12).tolist()
    (True, [0.0, 2.0, 0.0])
    """
    x, y = np.broadcast_arrays(np.asarray(local, float), np.asarray(measured, float))
    if x.ndim < 2 or x.shape[-1] != 3:
        raise ValueError(f"points must have shape (..., m, 3), not {x.shape}")
    w = np.broadcast_to(1.0 if weights is None else np.asarray(weights, float), x.shape[:-1])
    if np.any(w < 0):
        raise ValueError("weights must not be negative")
    usable = np.isfinite(x).all(-1) & np.isfinite(y).all(-1) & (w > 0)
    enough = usable.sum(-1) >= MIN_POINTS

    w = np.where(usable, w, 0.0)
    w = w / np.where(enough, w.sum(-1), 1.0)[..., None]
    x_mean, x = _centre_points(x, w, usable)
    y_mean, y = _centre_points(y, w, usable)
    dispersion = np.einsum("...m,...mi,...mj->...ij", w, y, x)
    rotation, spread = _project_on_rotations(dispersion)
    determined = enough & (spread[..., 1] > COLLINEAR * spread[..., 0])
    rotation = np.where(determined[..., None, None], rotation, np.nan)
    return rotation, y_mean - np.einsum("...ij,...j->...i", rotation, x_mean)


def _centre_points(points: Array, weights: Array, usable: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Weighted mean and deviations from it; points that are not usable become zeros."""
    filled = np.where(usable[..., None], points, 0.0)
    mean = np.einsum("...m,...mi->...i", weights, filled)
    return mean, np.where(usable[..., None], filled - mean[..., None, :], 0.0)


def _project_on_rotations(matrices: Array) -> tuple[Array, Array]:
    """The proper rotation that maximises ``trace(R^T M)``, and the singular values of M."""
    u, s, vt = np.linalg.svd(matrices)
    signs = np.ones(s.shape)
    signs[..., 2] = np.sign(np.linalg.det(u) * np.linalg.det(vt))
    return (u * signs[..., None, :]) @ vt, s


def find_nearest_rotation(matrices: ArrayLike) -> Array:
    """The proper rotation closest to each matrix in the Frobenius norm.

    ``matrices``: (..., 3, 3), finite.
    Returns (..., 3, 3) (Kabsch W. 1978, Acta Cryst A34:827-828).
    """
    return _project_on_rotations(np.asarray(matrices, float))[0]


def build_skew(vectors: ArrayLike) -> Array:
    """The matrix ``S`` with ``S @ b == cross(a, b)``.

    ``vectors``: (..., 3).
    Returns (..., 3, 3).
    """
    a = np.asarray(vectors, float)
    matrix = np.zeros((*a.shape, 3))
    for row, column, k, sign in ((0, 1, 2, -1), (0, 2, 1, 1), (1, 2, 0, -1)):
        matrix[..., row, column] = sign * a[..., k]
        matrix[..., column, row] = -sign * a[..., k]
    return matrix


def convert_vector_to_rotation(vectors: ArrayLike) -> Array:
    """Rotation about each vector's direction by its length (Rodrigues' formula).

    ``vectors``: (..., 3), rad.
    Returns (..., 3, 3).

    Examples
    --------
    >>> import numpy as np
    >>> (convert_vector_to_rotation([0, 0, np.pi / 2]) @ [1, 0, 0]).round(12).tolist()
    [0.0, 1.0, 0.0]
    """
    v = np.asarray(vectors, float)
    angle = np.linalg.norm(v, axis=-1)[..., None, None]
    small = angle < _TINY_ANGLE
    safe = np.where(small, 1.0, angle)
    # Half the angle keeps the second factor exact where 1 - cos would cancel.
    sine = np.where(small, 1.0 - angle**2 / 6.0, np.sin(safe) / safe)
    versine = np.where(small, 0.5 - angle**2 / 24.0, 2.0 * (np.sin(0.5 * safe) / safe) ** 2)
    s = build_skew(v)
    return np.eye(3) + sine * s + versine * (s @ s)


def rotate_about(axis: ArrayLike, angle: ArrayLike) -> Array:
    """Rotation about a fixed unit axis.

    ``axis``: (..., 3), unit length.
    ``angle``: (...), rad.
    Returns (..., 3, 3).
    """
    return convert_vector_to_rotation(np.asarray(angle, float)[..., None] * np.asarray(axis, float))


def convert_rotation_to_vector(rotations: ArrayLike) -> Array:
    """Axis times angle of each rotation, with the angle between 0 and pi.

    ``rotations``: (..., 3, 3), proper.
    Returns (..., 3), rad: NaN where the rotation holds NaN.

    Through the unit quaternion by its largest component (Shepperd 1978, J Guid Control 1:223-224), which
    stays accurate at angles near 0 and near pi.
    """
    r = np.asarray(rotations, float)
    trace = np.trace(r, axis1=-2, axis2=-1)
    diagonal = np.diagonal(r, axis1=-2, axis2=-1)
    # Rows of the outer product 4 q q^T, q = (w, x, y, z).
    outer = np.empty((*r.shape[:-2], 4, 4))
    outer[..., 0, 0] = 1.0 + trace
    outer[..., 1:, 1:] = r + np.swapaxes(r, -1, -2)
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        outer[..., 1 + k, 1 + k] = 1.0 + 2.0 * diagonal[..., k] - trace
        outer[..., 0, 1 + k] = outer[..., 1 + k, 0] = r[..., j, i] - r[..., i, j]
    largest = np.argmax(np.diagonal(outer, axis1=-2, axis2=-1), axis=-1)
    q = np.take_along_axis(outer, largest[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    q = np.where(q[..., :1] < 0, -q, q)
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    half = np.arctan2(sine, q[..., :1])
    factor = np.where(sine > 0, 2.0 * half / np.where(sine > 0, sine, 1.0), 2.0)
    return np.asarray(factor * q[..., 1:])
