"""Least-squares shapes through points: sphere and cylinder. Weighted, in any unit of length."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from scaling_service.core.arrays import Array

_MAX_STEPS = 50  # chosen: Gauss-Newton needs 5 to 10 on real bones
_OPEN = float(np.finfo(float).eps)  # share of the largest eigenvalue that is rounding, times the unknowns
_RELATIVE_STEP = 1e-8  # chosen: a step below this share of the radius changes nothing that can be printed


@dataclass(frozen=True, slots=True)
class SphereFit:
    """A sphere: ``centre`` (3,), ``radius`` and ``rms`` (weighted, of the distances to the sphere).

    ``converged`` is False where the iteration ran out of steps or the points leave the sphere open,
    as points on a plane do; the numbers are then the last ones and mean little.
    """

    centre: Array
    radius: float
    rms: float
    converged: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class CylinderFit:
    """An endless cylinder: a ``point`` on its axis, the unit ``direction``, ``radius`` and ``rms``.

    The point is the one nearest to the points' weighted centroid; the sign of the direction follows
    the start. ``converged`` as in :class:`SphereFit`.
    """

    point: Array
    direction: Array
    radius: float
    rms: float
    converged: bool


def fit_sphere(points: Array, weights: Array | None = None, *, start: Array | None = None) -> SphereFit:
    """Sphere of least squared distances between points and surface (geometric, not algebraic).

    An algebraic fit, which is biased to small radii where little of the sphere is covered, only starts
    the iteration (Ahn, Rauh & Warnecke 2001, Pattern Recognition 34: 2283-2303).

    ``points``: (n, 3).
    ``weights`` (n,): not negative, such as the area that each point stands for.
    ``start`` (3,): a first centre in place of the algebraic one.
    Raises ValueError: fewer than 4 points with a weight.

    Examples
    --------
    >>> fit = fit_sphere(np.array([[3.0, 0, 0], [-1, 0, 0], [1, 2, 0], [1, 0, 2]]))
    >>> bool(np.allclose(fit.centre, [1, 0, 0])), round(fit.radius, 9)
    (True, 2.0)
    """
    points, w = _check(points, weights, least=4)
    centre = _guess_centre(points, w) if start is None else np.asarray(start, dtype=float)
    x = np.append(centre, w @ np.linalg.norm(points - centre, axis=1))
    rows = np.ascontiguousarray(points.T)

    def linearise(x: Array) -> tuple[Array, Array]:
        jacobian = np.full((4, rows.shape[1]), -1.0)
        distance = _point_away(rows, x[:3], jacobian[:3])
        return distance - x[3], jacobian

    x, rms, converged = _minimise(linearise, lambda x, step: x + step, x, w, size=lambda x: abs(x[3]))
    return SphereFit(centre=x[:3], radius=float(x[3]), rms=rms, converged=bool(converged and x[3] > 0))


def fit_sphere_pair(
    first: Array,
    second: Array,
    first_counts: Array,
    second_counts: Array,
    *,
    starts: tuple[SphereFit, SphereFit],
    alike: float,
    noise: float,
) -> tuple[SphereFit, SphereFit]:
    """Two spheres whose radii are expected to be alike, by how much the points leave it open.

    A little of a sphere hardly determines its radius, and a wrong radius displaces its centre. The
    residuals of both spheres are weighed against the difference of the radii as independent
    observations with known standard deviations (a least-squares estimate with a prior).

    ``first``, ``second``: (n, 3), (m, 3).
    ``first_counts``, ``second_counts`` (n,), (m,): how many independent observations each point stands for.
    ``alike``: standard deviation of the difference of the radii, in the points' unit.
    ``noise``: standard deviation of one independent observation.
    Raises ValueError: fewer than 4 points with a weight in either.
    """
    p, w = _check(first, first_counts, least=4)
    q, v = _check(second, second_counts, least=4)
    counts = np.concatenate([w * first_counts.sum(), v * second_counts.sum()]) / noise**2
    weights = np.append(counts, 1.0 / alike**2)
    n, parts = len(p), [np.ascontiguousarray(points.T) for points in (p, q)]

    def linearise(x: Array) -> tuple[Array, Array]:
        jacobian = np.zeros((8, len(weights)))
        residual = np.empty(len(weights))
        for some, points, k in ((slice(0, n), parts[0], 0), (slice(n, -1), parts[1], 4)):
            distance = _point_away(points, x[k : k + 3], jacobian[k : k + 3, some])
            residual[some] = distance - x[k + 3]
            jacobian[k + 3, some] = -1.0
        residual[-1] = x[3] - x[7]
        jacobian[3, -1], jacobian[7, -1] = 1.0, -1.0
        return residual, jacobian

    x = np.concatenate([np.append(fit.centre, fit.radius) for fit in starts])
    x, _, converged = _minimise(
        linearise, lambda x, step: x + step, x, weights, size=lambda x: min(abs(x[3]), abs(x[7]))
    )
    gaps = linearise(x)[0]
    rms = float(np.sqrt(w @ gaps[:n] ** 2)), float(np.sqrt(v @ gaps[n:-1] ** 2))
    good = bool(converged and min(x[3], x[7]) > 0)
    return (SphereFit(x[:3], float(x[3]), rms[0], good), SphereFit(x[4:7], float(x[7]), rms[1], good))


def fit_cylinder(points: Array, direction: Array, point: Array, weights: Array | None = None) -> CylinderFit:
    """Cylinder of least squared distances between points and surface (geometric).

    ``points``: (n, 3).
    ``direction``, ``point`` (3,): a first axis; the basin is wide (tens of degrees) where half of the
        cylinder is covered.
    ``weights``: (n,).
    Raises ValueError: fewer than 5 points with a weight.

    Ahn, Rauh & Warnecke 2001; the direction moves in its tangent plane, so it has no singular pose.
    """
    points, w = _check(points, weights, least=5)
    centroid = w @ points
    a = _normalise(np.asarray(direction, dtype=float))
    radial = points - point - ((points - point) @ a)[:, None] * a
    x = np.concatenate([point, a, [w @ np.linalg.norm(radial, axis=1)]]).astype(float)

    def linearise(x: Array) -> tuple[Array, Array]:
        a = x[3:6]
        first, second = span_plane(a)
        offset = points - x[:3]
        along = offset @ a
        radial = offset - along[:, None] * a
        distance = np.maximum(np.linalg.norm(radial, axis=1), 1e-300)
        u1, u2 = radial @ first / distance, radial @ second / distance
        return distance - x[6], np.stack([-u1, -u2, -along * u1, -along * u2, -np.ones(len(points))])

    def move(x: Array, step: Array) -> Array:
        first, second = span_plane(x[3:6])
        point = x[:3] + step[0] * first + step[1] * second
        a = _normalise(x[3:6] + step[2] * first + step[3] * second)
        # Turning about a far point would couple direction and position: the point stays near the data.
        return np.concatenate([point + a * ((centroid - point) @ a), a, [x[6] + step[4]]])

    x, rms, converged = _minimise(linearise, move, move(x, np.zeros(5)), w, size=lambda x: abs(x[6]))
    return CylinderFit(
        point=x[:3], direction=x[3:6], radius=float(x[6]), rms=rms, converged=bool(converged and x[6] > 0)
    )


def span_plane(direction: Array) -> tuple[Array, Array]:
    """Two unit vectors that make a right-handed orthogonal frame with a unit vector (3,)."""
    helper = np.zeros(3)
    helper[int(np.argmin(np.abs(direction)))] = 1.0
    first = _normalise(np.cross(direction, helper))
    return first, np.cross(direction, first)


def _minimise(
    linearised: Callable[[Array], tuple[Array, Array]],
    moved: Callable[[Array, Array], Array],
    x: Array,
    w: Array,
    size: Callable[[Array], float],
) -> tuple[Array, float, bool]:
    """Damped Gauss-Newton (Levenberg-Marquardt); returns the best point, its rms, and whether it settled.

    ``linearised``: residuals (n,) and their Jacobian, a row for each unknown, (k, n).
    """
    residual, jacobian = linearised(x)
    cost, damping = float(w @ residual**2), 0.0
    for _ in range(_MAX_STEPS):
        normal = (w * jacobian) @ jacobian.T
        np.fill_diagonal(normal, (1.0 + damping) * normal.diagonal())
        # The shortest of the steps that solve it, where the points leave something open
        sizes, ways = np.linalg.eigh(normal)
        sizes[np.abs(sizes) <= _OPEN * len(sizes) * np.abs(sizes).max()] = np.inf
        step = -ways @ (ways.T @ (jacobian @ (w * residual)) / sizes)
        candidate = moved(x, step)
        new_residual, new_jacobian = linearised(candidate)
        new_cost = float(w @ new_residual**2)
        small = float(np.abs(candidate - x).max()) <= _RELATIVE_STEP * size(x)
        if new_cost <= cost:
            gain = cost - new_cost
            x, residual, jacobian, cost = candidate, new_residual, new_jacobian, new_cost
            damping *= 0.1
            if small or gain <= 1e-15 * cost:
                return x, float(np.sqrt(cost)), True
        elif small or damping > 1e8:
            return x, float(np.sqrt(cost)), True
        else:
            damping = max(10.0 * damping, 1e-6)
    return x, float(np.sqrt(cost)), False


def _point_away(points: Array, centre: Array, out: Array) -> Array:
    """Distances (n,) of points (3, n) from a centre (3,); unit vectors from them to it go to ``out``."""
    np.subtract(centre[:, None], points, out=out)
    distance: Array = np.sqrt(np.einsum("in,in->n", out, out))
    np.maximum(distance, 1e-300, out=distance)
    out /= distance
    return distance


def _guess_centre(points: Array, w: Array) -> Array:
    """Centre from 2 p.c + (r2 - |c|2) = |p|2, about the centroid so that far points lose no digits."""
    origin = w @ points
    local = points - origin
    root = np.sqrt(w)
    system = np.column_stack([2.0 * local, np.ones(len(local))]) * root[:, None]
    solution = np.linalg.lstsq(system, (local**2).sum(axis=1) * root, rcond=None)[0]
    centre: Array = origin + solution[:3]
    return centre


def _check(points: Array, weights: Array | None, least: int) -> tuple[Array, Array]:
    points = np.asarray(points, dtype=float)
    w = np.ones(len(points)) if weights is None else np.asarray(weights, dtype=float)
    if len(w) != len(points) or np.any(w < 0) or int((w > 0).sum()) < least:
        raise ValueError(f"at least {least} points with a weight are needed, and no negative weight")
    kept = w > 0
    return points[kept], w[kept] / w.sum()


def _normalise(v: Array) -> Array:
    unit: Array = v / np.linalg.norm(v)
    return unit


def spread_directions(n: int) -> Array:
    """Evenly spread directions, without their opposites (a Fibonacci spiral)."""
    k = np.arange(n) + 0.5
    z = k / n
    turn = np.pi * (1.0 + np.sqrt(5.0)) * k
    across_z = np.sqrt(1.0 - z**2)
    return np.column_stack([across_z * np.cos(turn), across_z * np.sin(turn), z])
