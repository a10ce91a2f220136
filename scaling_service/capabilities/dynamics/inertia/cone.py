"""Inertial parameters that a body can have: a quadratic minimum under linear matrix inequalities.

Clarabel (Goulart & Chen 2024, arXiv:2405.12762) solves the cone programme. It is called directly: a modelling
language would be several times its size, and the problem has one form only.
"""

from __future__ import annotations

from dataclasses import dataclass

import clarabel
import numpy as np
from scipy import sparse

from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.mechanism import N_PARAMETERS, TENSOR

KEPT = 0.1
"""Share of the prior's mass, and of its second moment along any direction, that a segment keeps at least
(chosen: a third of a radius of gyration; a limit against degenerate bodies, far from all tables)."""

_SIDE = 4
_SOLVED = frozenset({"Solved", "AlmostSolved"})


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """What one segment's parameters must obey.

    Parameters
    ----------
    row : int
        The segment.
    low, high : ndarray, shape (3,), m
        Box of the centre of mass, in the segment's frame; the prior's lies inside.
    """

    row: int
    low: Array
    high: Array


def pseudo_inertia(parameters: Array) -> Array:
    """The matrix that is positive definite for every body and for nothing else.

    Parameters
    ----------
    parameters : ndarray, shape (..., 10)
        See ``Inertias.parameters``. Any change of them will do: the
        matrix is linear in them.

    Returns
    -------
    ndarray, shape (..., 4, 4)
        Second moments of the mass about the origin, bordered by first moments and mass.

    Notes
    -----
    Wensing P. M., Kim S., Slotine J.-J. E. (2018) Linear matrix inequalities for physically consistent
    inertial parameter identification. IEEE Robot Autom Lett 3:60-67.
    """
    tensor = np.empty((*parameters.shape[:-1], 3, 3))
    for column, (i, j) in enumerate(TENSOR, start=4):
        tensor[..., i, j] = tensor[..., j, i] = parameters[..., column]
    matrix = np.empty((*parameters.shape[:-1], _SIDE, _SIDE))
    half = 0.5 * np.trace(tensor, axis1=-2, axis2=-1)
    matrix[..., :3, :3] = half[..., None, None] * np.eye(3) - tensor
    matrix[..., :3, 3] = matrix[..., 3, :3] = parameters[..., 1:4]
    matrix[..., 3, 3] = parameters[..., 0]
    return matrix


def possible_minimum(
    curvature: Array, slope: Array, mean: Array, directions: Array, bodies: tuple[Body, ...]
) -> Array | None:
    """Minimise ``y' diag(curvature) y / 2 - slope' y`` so that ``mean + directions @ y`` are bodies.

    Parameters
    ----------
    curvature, slope : ndarray, shape (k,)
    mean : ndarray, shape (n, 10)
        Itself possible.
    directions : ndarray, shape (10 n, k)
    bodies : tuple of Body

    Returns
    -------
    ndarray, shape (k,), or None
        None where the solver found no minimum.
    """
    # In units of 1 / sqrt(curvature) all unknowns are alike; the solver may fail where gains differ by 1e4.
    unit = 1.0 / np.sqrt(curvature)
    moves = (directions * unit).reshape(len(mean), N_PARAMETERS, -1)
    boxes = [_box(mean[b.row], moves[b.row], b) for b in bodies]
    cones = [_positive(mean[b.row], moves[b.row]) for b in bodies]
    parts = [*boxes, *cones]
    free = slope * unit
    if all(_obeys(a @ free + b) for a, b in boxes) and all(_positive_at(a @ free + b) for a, b in cones):
        return np.asarray(slope / curvature)  # no constraint binds; the solver fails on some of these
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    solution = clarabel.DefaultSolver(
        sparse.identity(len(slope), format="csc"),
        -slope * unit,
        sparse.csc_matrix(-np.concatenate([a for a, _ in parts])),
        np.concatenate([b for _, b in parts]),
        [
            *(clarabel.NonnegativeConeT(len(b)) for _, b in boxes),
            *(clarabel.PSDTriangleConeT(_SIDE) for _ in cones),
        ],
        settings,
    ).solve()
    return np.array(solution.x) * unit if str(solution.status) in _SOLVED else None


def _obeys(rows: Array) -> bool:
    """Whether all rows are met."""
    return bool((rows >= 0.0).all())


def _positive_at(triangle: Array) -> bool:
    """Whether the matrix of a triangle (10,) is positive semidefinite."""
    matrix = np.zeros((_SIDE, _SIDE))
    rows, columns = zip(*((i, j) for j in range(_SIDE) for i in range(j + 1)), strict=True)
    factors = np.where(np.array(rows) == np.array(columns), 1.0, np.sqrt(0.5))
    matrix[rows, columns] = matrix[columns, rows] = triangle * factors
    return bool(np.linalg.eigvalsh(matrix)[0] >= 0.0)


def _box(mean: Array, moves: Array, body: Body) -> tuple[Array, Array]:
    """Rows ``a y + b >= 0`` that keep the centre of mass in its box: linear in mass and first moment."""
    size = mean[0] * np.maximum(body.high - body.low, 1e-6)[:, None]
    lower = (moves[1:4] - body.low[:, None] * moves[0]) / size
    upper = (body.high[:, None] * moves[0] - moves[1:4]) / size
    at = np.concatenate([mean[1:4] - body.low * mean[0], body.high * mean[0] - mean[1:4]])
    return np.concatenate([lower, upper]), at / np.concatenate([size[:, 0], size[:, 0]])


def _positive(mean: Array, moves: Array) -> tuple[Array, Array]:
    """Rows of ``pseudo-inertia - KEPT * prior's``, in axes that make the prior's nearly the unit matrix."""
    values, vectors = np.linalg.eigh(pseudo_inertia(mean))
    # A flat body (toes in OpenSim's models) has no thickness to lose: it counts as a thin one.
    to_unit = vectors / np.sqrt(np.maximum(values, 1e-9 * values[-1]))
    turned = to_unit.T @ pseudo_inertia(moves.T) @ to_unit
    return _triangle(turned).T, _triangle((1.0 - KEPT) * np.eye(_SIDE))


def _triangle(matrices: Array) -> Array:
    """Upper triangles column by column, off-diagonals times root two, (..., 10): the solver's order."""
    rows, columns = zip(*((i, j) for j in range(_SIDE) for i in range(j + 1)), strict=True)
    factors = np.where(np.array(rows) == np.array(columns), 1.0, np.sqrt(2.0))
    triangle: Array = matrices[..., rows, columns] * factors
    return triangle
