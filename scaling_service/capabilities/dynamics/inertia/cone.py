"""Inertial parameters that a body can have: a quadratic minimum under linear matrix inequalities.

Clarabel (Goulart & Chen 2024, arXiv:2405.12762) solves the cone programme. It is called directly: a modelling
language would be several times its size, and the problem has one form only.
"""

from __future__ import annotations

from dataclasses import dataclass

import clarabel
import numpy as np
from scipy import sparse

from scaling_service.model.body import BodyModel
from scaling_service.model.compile import list_parameter_values, repeat_default_pose
from scaling_service.model.inertia import compile_whole_tree, to_matrix
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.mechanism import N_PARAMETERS, TENSOR
from scaling_service.numerics.multibody.tree import pose_links

KEPT = 0.1
"""Share of the prior's mass, and of its second moment along any direction, that a segment keeps at least
(chosen: a third of a radius of gyration; a limit against degenerate bodies, far from all tables)."""

_SIDE = 4
_COLUMNS, _ROWS = np.tril_indices(_SIDE)  # of upper triangles column by column, the solver's order
_ROOTS = np.where(_ROWS == _COLUMNS, 1.0, np.sqrt(2.0))  # what the solver wants off-diagonals times
_SOLVED = frozenset({"Solved", "AlmostSolved"})


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """What one segment's parameters must obey."""

    row: int  # the segment
    # low, high (3,), m: box of the centre of mass, in the segment's frame; the prior's lies inside
    low: Array
    high: Array


def form_pseudo_inertia(parameters: Array) -> Array:
    """The matrix that is positive definite for every body and for nothing else.

    Of ``Inertias.parameters`` (..., 10), or of any change of them, for it is linear: (..., 4, 4), second
    moments of the mass about the origin, bordered by first moments and mass. Wensing P. M., Kim S.,
    Slotine J.-J. E. (2018) Linear matrix inequalities for physically consistent inertial parameter
    identification. IEEE Robot Autom Lett 3:60-67.
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


def minimise_within_cone(
    curvature: Array, slope: Array, mean: Array, directions: Array, bodies: tuple[Body, ...]
) -> Array | None:
    """Minimise ``y' diag(curvature) y / 2 - slope' y`` so that ``mean + directions @ y`` are bodies.

    ``curvature`` and ``slope`` (k,), ``directions`` (10 n, k), and ``mean`` (n, 10), itself possible, to y
    (k,); None where the solver found no minimum.
    """
    # In units of 1 / sqrt(curvature) all unknowns are alike; the solver may fail where gains differ by 1e4.
    unit = 1.0 / np.sqrt(curvature)
    moves = (directions * unit).reshape(len(mean), N_PARAMETERS, -1)
    boxes = [_bound_box(mean[b.row], moves[b.row], b) for b in bodies]
    cones = [_bound_cone(mean[b.row], moves[b.row]) for b in bodies]
    parts = [*boxes, *cones]
    free = slope * unit
    if all((a @ free + b >= 0.0).all() for a, b in boxes) and all(
        _is_positive(a @ free + b) for a, b in cones
    ):
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


def _bound_box(mean: Array, moves: Array, body: Body) -> tuple[Array, Array]:
    """Rows ``a y + b >= 0`` that keep the centre of mass in its box: linear in mass and first moment."""
    size = mean[0] * np.maximum(body.high - body.low, 1e-6)[:, None]
    lower = (moves[1:4] - body.low[:, None] * moves[0]) / size
    upper = (body.high[:, None] * moves[0] - moves[1:4]) / size
    at = np.concatenate([mean[1:4] - body.low * mean[0], body.high * mean[0] - mean[1:4]])
    return np.concatenate([lower, upper]), at / np.concatenate([size[:, 0], size[:, 0]])


def _bound_cone(mean: Array, moves: Array) -> tuple[Array, Array]:
    """Rows of ``pseudo-inertia - KEPT * prior's``, in axes that make the prior's nearly the unit matrix."""
    values, vectors = np.linalg.eigh(form_pseudo_inertia(mean))
    # A flat body (toes in OpenSim's models) has no thickness to lose: it counts as a thin one.
    to_unit = vectors / np.sqrt(np.maximum(values, 1e-9 * values[-1]))
    turned = to_unit.T @ form_pseudo_inertia(moves.T) @ to_unit
    return _take_triangle(turned).T, _take_triangle((1.0 - KEPT) * np.eye(_SIDE))


def _take_triangle(matrices: Array) -> Array:
    """Upper triangles as the solver takes them, (..., 10)."""
    return matrices[..., _ROWS, _COLUMNS] * _ROOTS


def _is_positive(triangle: Array) -> bool:
    """Whether the matrix of a triangle (10,) is positive semidefinite."""
    matrix = np.zeros((_SIDE, _SIDE))
    matrix[_ROWS, _COLUMNS] = matrix[_COLUMNS, _ROWS] = triangle / _ROOTS
    return bool(np.linalg.eigvalsh(matrix)[0] >= 0.0)


def list_bodies(model: BodyModel) -> tuple[Body, ...]:
    """The box of every segment with mass, in its own frame.

    It spans the joint centres (the segment's own and those of the segments that it carries, in the model's
    default posture) and the markers on it. Along each axis it reaches at least one standard deviation of the
    segment's own mass to both sides of the prior's centre, for so far the segment itself reaches.
    """
    tree, q = compile_whole_tree(model), np.ascontiguousarray(repeat_default_pose(model, 1).T)
    poses = pose_links(tree, q, list_parameter_values(model))
    origins, axes = poses.origins[..., 0], poses.axes[..., 0].transpose(0, 2, 1)
    bodies = []
    for k, segment in enumerate(model.segments):
        if segment.mass <= 0:
            continue
        carried = [i for i, s in enumerate(model.segments) if s.parent == segment.name]
        joints = (origins[[k, *carried]] - origins[k]) @ axes[k]
        markers = np.array([m.nominal for m in model.markers if m.segment == segment.name]).reshape(-1, 3)
        com, tensor = np.array(segment.com), to_matrix(segment.inertia)
        moments = 0.5 * np.trace(tensor) - np.diag(tensor)
        reach = np.sqrt(np.clip(moments, 0.0, None) / segment.mass)
        points = np.concatenate([joints, markers, [com - reach, com + reach]])
        bodies.append(Body(k, points.min(axis=0), points.max(axis=0)))
    return tuple(bodies)
