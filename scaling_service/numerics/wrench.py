"""Newton-Euler for all frames at once: the wrench that moves a body, joint forces, and its derivatives.

External loads are wrenches in ground axes about the ground origin, frames last.

Derivatives with respect to q, qdot and qddot are analytic. Momentum ``h = I V`` of a link that is varied by
the twist xi changes by ``xi x* h + I xi'`` (ground axes, at the ground origin), and the wrench is its rate
less that of gravity. Links are summed up the tree first, so the cost is one 6 by 6 product per entry.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.arrays import Array
from scaling_service.numerics.multibody import motion as motions
from scaling_service.numerics.multibody.tree import cross

GRAVITY = np.array([0.0, -9.80665, 0.0])
"""Standard gravity (3rd CGPM 1901; also OpenSim's default), Y up, m/s2."""

BLOCK = 256
"""Frames computed together (chosen: the fastest measured on one thread, 128 and 512 being close)."""

REGRESSOR_BLOCK = 64
"""Frames computed together (chosen: 35 rows by 160 columns by 64 frames are 3 MB)."""


@dataclass(frozen=True, slots=True, eq=False)
class Loads:
    """Wrenches from outside on some links."""

    links: NDArray[np.intp]  # (n_loads,): a link may have several
    # (n_loads, 6, n): force (N) and moment about the ground origin (N m) on the body, in ground axes
    wrenches: Array


@dataclass(frozen=True, slots=True, eq=False)
class Dynamics:
    """What inverse dynamics of a motion gives."""

    # (n_coordinates, n), N m or N: generalised forces that the joints must provide beside the external loads
    forces: Array
    # (6, n): force (N) and moment about the root link's origin (N m), ground axes, that the motion needs and
    # no external load provides
    residual: Array
    root: Array  # (3, n), m: where the root link's origin is


def split_blocks(n: int, size: int = BLOCK) -> Iterator[slice]:
    """Slices that cover n frames."""
    return (slice(start, min(start + size, n)) for start in range(0, n, size))


def move_moment(wrench: Array, point: Array) -> Array:
    """A wrench about the ground origin, (..., 6, n), with its moment about a point (3, n) instead."""
    result = wrench.copy()
    result[..., 3:, :] -= cross(point, wrench[..., :3, :])
    return result


def link_wrenches(mechanism: motions.Mechanism, state: motions.LinkMotion, gravity: Array = GRAVITY) -> Array:
    """The wrench beside gravity that moves each link as it moves.

    Force and moment about the ground origin, ground axes, (n_links, 6, n).

    Newton: ``F = m (a - g)``; Euler about the centre of mass: ``I alpha + omega x I omega``, evaluated
    in the link's axes, where I is constant.
    """
    inertias = mechanism.inertias
    axes = state.poses.axes
    at = np.einsum("kjan,kj->kan", axes, inertias.com) + state.poses.origins
    wrench = np.empty(state.twists.shape)
    force = wrench[:, :3]
    force[:] = motions.point_acceleration(state.twists, state.accelerations, at) - gravity[:, None]
    force *= inertias.mass[:, None, None]
    omega = np.einsum("kjan,kan->kjn", axes, state.twists[:, 3:])
    alpha = np.einsum("kjan,kan->kjn", axes, state.accelerations[:, 3:])
    euler = inertias.tensor @ alpha + cross(omega, inertias.tensor @ omega)
    wrench[:, 3:] = np.einsum("kjan,kjn->kan", axes, euler) + cross(at, force)
    return wrench


def compute_root_wrench(
    mechanism: motions.Mechanism, motion: motions.Motion, p: Array
) -> tuple[Array, Array]:
    """The net wrench that moves the whole body, without the forces in the joints.

    ``p``: (n_parameters,).
    Returns ``wrench`` (6, n): force (N) and moment about the *ground origin* (N m). Subtract the loads and
        use :func:`move_moment` for the residual.
    ``root`` (3, n), m: the origin of the first link.
    """
    wrench, root = np.empty((6, motion.n)), np.empty((3, motion.n))
    for rows in split_blocks(motion.n):
        state = motions.move_links(mechanism, motion.block(rows), p)
        link_wrenches(mechanism, state).sum(axis=0, out=wrench[:, rows])
        root[:, rows] = state.poses.origins[0]
    return wrench, root


def compute_inverse_dynamics(
    mechanism: motions.Mechanism,
    motion: motions.Motion,
    p: Array,
    loads: Loads | None = None,
    *,
    gravity: Array = GRAVITY,
) -> Dynamics:
    """Generalised forces and the residual wrench of a motion.

    ``p``: (n_parameters,).
    ``loads``: None: nothing touches the body.
    ``gravity``: (3,), m/s2.
    """
    forces = np.empty((mechanism.tree.n_coordinates, motion.n))
    residual, root = np.empty((6, motion.n)), np.empty((3, motion.n))
    for rows in split_blocks(motion.n):
        state = motions.move_links(mechanism, motion.block(rows), p)
        wrenches = link_wrenches(mechanism, state, gravity)
        if loads is not None:
            np.subtract.at(wrenches, loads.links, loads.wrenches[..., rows])
        root[:, rows] = state.poses.origins[0]
        residual[:, rows] = move_moment(wrenches.sum(axis=0), root[:, rows])
        forces[:, rows] = compute_joint_forces(mechanism, state, wrenches)
    return Dynamics(forces, residual, root)


def compute_joint_forces(mechanism: motions.Mechanism, state: motions.LinkMotion, wrenches: Array) -> Array:
    """Generalised forces (n_coordinates, n) that balance wrenches (n_links, 6, n) about the ground origin."""
    n = wrenches.shape[-1]
    through = (mechanism.carriers @ wrenches.reshape(len(wrenches), -1)).reshape(-1, 6, n)
    power = np.einsum("ean,ean->en", state.screws, through) * state.slopes
    acts = np.equal(np.arange(mechanism.tree.n_coordinates)[:, None], mechanism.coordinates)
    return np.asarray(acts.astype(float) @ power)


def compute_regressor_blocks(
    mechanism: motions.Mechanism,
    motion: motions.Motion,
    p: Array,
    *,
    gravity: Array = GRAVITY,
    size: int = REGRESSOR_BLOCK,
) -> Iterator[tuple[slice, Array]]:
    """Regressors of the ground wrench: some frames, and (n, 6, 10 n_links) of these, frames first.

    Force and moment about the root link's origin, ground axes: what all external loads together must provide.

    ``mechanism``: its inertias are not used.
    ``p``: (n_parameters,).
    ``gravity``: (3,), m/s2.
    ``size``: frames at a time: bounds the memory.
    In the order of the frames. Its product with all inertial parameters (joined) is the wrench.
    """
    for rows in split_blocks(motion.n, size):
        state = motions.move_links(mechanism, motion.block(rows), p)
        # Wrench of each link about the ground origin per parameter, (n_links, 10, 6, n)
        axes, origins = state.poses.axes, state.poses.origins
        omega, alpha = state.twists[:, 3:], state.accelerations[:, 3:]
        proper = motions.point_acceleration(state.twists, state.accelerations, origins) - gravity[:, None]
        result = np.zeros((len(axes), motions.N_PARAMETERS, 6, axes.shape[-1]))
        result[:, 0, :3] = proper
        for j in range(3):  # a unit first moment along axis j
            arm = axes[:, j]
            result[:, 1 + j, :3] = cross(alpha, arm) + cross(omega, cross(omega, arm))
            result[:, 1 + j, 3:] = cross(arm, proper)
        result[:, :4, 3:] += cross(origins[:, None], result[:, :4, :3])
        result[:, 4:, 3:] = _compute_tensor_columns(axes, omega, alpha)
        links = result.reshape(-1, 6, rows.stop - rows.start)
        links[:, 3:] -= cross(state.poses.origins[0], links[:, :3])
        yield rows, np.ascontiguousarray(np.moveaxis(links, -1, 0).transpose(0, 2, 1))


def _compute_tensor_columns(axes: Array, omega: Array, alpha: Array) -> Array:
    """Moment per number of the tensor, (n_links, 6, 3, n)."""
    w = np.einsum("kjan,kan->kjn", axes, omega)
    a = np.einsum("kjan,kan->kjn", axes, alpha)
    local = np.zeros((len(axes), len(motions.TENSOR), 3, axes.shape[-1]))
    for column, (i, j) in enumerate(motions.TENSOR):
        turned = np.zeros_like(w)
        local[:, column, i] += a[:, j]
        turned[:, i] += w[:, j]
        if i != j:
            local[:, column, j] += a[:, i]
            turned[:, j] += w[:, i]
        local[:, column] += cross(w, turned)
    return np.asarray(np.einsum("kjan,kcjn->kcan", axes, local))


def differentiate_wrench(mechanism: motions.Mechanism, screws: motions.Screws, m: int) -> tuple[Array, Array]:
    """The net wrench and how it changes.

    ``screws``: of its ``m`` free coordinates.
    Returns (6, n), force (N) and moment about the ground origin (N m) that all external loads together must
        provide; (n, 6, 3, m), its derivatives with respect to q, qdot and qddot.
    """
    state, n = screws.state, screws.rates.shape[-1]
    # Inertia of every link at the ground origin, ground axes, (n_links, 6, 6, n): momentum from twist.
    inertias, axes = mechanism.inertias, state.poses.axes
    at = np.einsum("kjan,kj->kan", axes, inertias.com) + state.poses.origins
    own = np.einsum("kian,kij,kjbn->kabn", axes, inertias.tensor, axes, optimize=True)
    mass = inertias.mass[:, None, None, None]
    # Cross-product matrices of vectors (k, 3, n), (k, 3, 3, n).
    arm = np.stack([cross(at, np.eye(3)[:, [i]]) for i in range(3)], axis=2)
    result = np.zeros((len(axes), 6, 6, axes.shape[-1]))
    for i in range(3):
        result[:, i, i] = inertias.mass[:, None]
    result[:, :3, 3:] = -mass * arm
    result[:, 3:, :3] = mass * arm
    result[:, 3:, 3:] = own - mass * np.einsum("kabn,kbcn->kacn", arm, arm)
    inertia = result
    momentum = np.einsum("kabn,kbn->kan", inertia, state.twists)
    forces = link_wrenches(mechanism, state)
    # `V x* I - I V x` of every link, (k, 6, 6, n).
    columns = np.moveaxis(inertia, 2, 1)  # (k, column, row, n); the matrix is symmetric
    half = np.moveaxis(motions.cross_wrench(state.twists[:, None], columns), 1, 2)
    turning = half + np.swapaxes(half, 1, 2)  # -(I V x) is the transpose of (V x* I)
    below = mechanism.carriers[screws.entries]
    composite, composite_rate, h, f = (
        (below @ part.reshape(len(part), -1)).reshape(len(below), *part.shape[1:])
        for part in (inertia, turning, momentum, forces)
    )
    screw, first, second = screws.rates
    g = np.zeros((6, 1))
    g[:3, 0] = GRAVITY
    by_q = (
        _multiply(composite, second)
        + _multiply(composite_rate, first)
        + motions.cross_wrench(first, h)
        + motions.cross_wrench(screw, f)
        + _multiply(composite, motions.cross_twist(screw, g))
    )
    by_qdot = (
        2.0 * _multiply(composite, first) + _multiply(composite_rate, screw) + motions.cross_wrench(screw, h)
    )
    by_entry = np.stack([by_q, by_qdot, _multiply(composite, screw)], axis=1)
    by = np.zeros((m, 3, 6, n))
    np.add.at(by, screws.columns, by_entry)
    return forces.sum(axis=0), np.ascontiguousarray(by.transpose(3, 2, 1, 0))


def _multiply(matrix: Array, vector: Array) -> Array:
    return np.asarray(np.einsum("kabn,kbn->kan", matrix, vector))
