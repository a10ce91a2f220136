"""The point of a surface that lies furthest in a direction, steadier than a single vertex."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scaling_service.kernels.fits import across
from scaling_service.landmarking.surface import Surface

Array = NDArray[np.float64]

_PATCH_M = 8e-3  # chosen: a patch of about 200 mm2 holds vertices even on a mesh of 3,000 faces
_FEWEST = 10


def tip(surface: Surface, direction: Array, within: NDArray[np.bool_]) -> Array:
    """Where the chosen part reaches furthest, shape (3,), m.

    The summit of a quadratic surface through the patch around the furthest smoothed vertex; a single
    vertex moves with every decimation and follows noise. Where the patch has no summit (an edge), the
    mean of its highest part is taken.

    Parameters
    ----------
    direction : ndarray, shape (3,)
        Unit vector.
    within : ndarray of bool, shape (n,)
    """
    chosen = np.flatnonzero(within)
    first, second = across(direction)
    for_height = surface.smooth[chosen] @ direction
    summit = surface.smooth[chosen[int(np.argmax(for_height))]]
    for _ in range(3):
        offset = surface.points[chosen] - summit
        distance = np.linalg.norm(offset, axis=1)
        near = (distance < 2 * _PATCH_M) & (surface.normals[chosen] @ direction > 0.3)
        if int(near.sum()) < _FEWEST:
            return np.asarray(summit)
        u, v, h = offset[near] @ first, offset[near] @ second, offset[near] @ direction
        w = surface.areas[chosen][near] * np.exp(-0.5 * (distance[near] / (0.5 * _PATCH_M)) ** 2)
        moved = _summit(u, v, h, w)
        if moved is None:
            top = w * np.exp((h - h.max()) / 1e-3)
            return np.asarray(summit + (top @ offset[near]) / top.sum())
        summit = summit + moved[0] * first + moved[1] * second + moved[2] * direction
    return np.asarray(summit)


def _summit(u: Array, v: Array, h: Array, w: Array) -> tuple[float, float, float] | None:
    """Top of the quadratic through h(u, v), or None where it has none within the patch."""
    terms = np.column_stack([np.ones_like(u), u, v, u * u, u * v, v * v])
    root = np.sqrt(w)
    a = np.linalg.lstsq(terms * root[:, None], h * root, rcond=None)[0]
    hessian = np.array([[2 * a[3], a[4]], [a[4], 2 * a[5]]])
    if np.linalg.eigvalsh(hessian).max() > -1.0:  # 1/m: flatter than a sphere of 1 m
        return None
    x, y = np.linalg.solve(hessian, -a[1:3])
    if np.hypot(x, y) > _PATCH_M:
        return None
    return float(x), float(y), float(a[0] + 0.5 * (a[1] * x + a[2] * y))
