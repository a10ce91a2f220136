"""Derivatives of the net wrench with respect to q, qdot and qddot, analytic, for all frames at once.

Momentum ``h = I V`` of a link that is varied by the twist xi changes by ``xi x* h + I xi'`` (ground axes, at
the ground origin), and the wrench is its rate less that of gravity. Links are summed up the tree first, so
the cost is one 6 by 6 product per entry.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.mechanism import Mechanism
from scaling_service.numerics.multibody.motion import LinkMotion, Screws, force_cross, motion_cross
from scaling_service.numerics.multibody.tree import cross
from scaling_service.numerics.wrench.ground_wrench import GRAVITY, link_wrenches


@dataclass(frozen=True, slots=True, eq=False)
class WrenchRates:
    """The net wrench and how it changes."""

    # (6, n): force (N) and moment about the ground origin (N m) that all external loads together must provide
    wrench: Array
    by: Array  # (n, 6, 3, m): derivatives with respect to q, qdot and qddot of the m free coordinates


def wrench_rates(mechanism: Mechanism, screws: Screws, m: int, gravity: Array = GRAVITY) -> WrenchRates:
    """Derivatives of the net wrench.

    ``screws``: of its free coordinates.
    ``m``: the number of free coordinates.
    ``gravity``: (3,), m/s2.
    """
    state, n = screws.state, screws.rates.shape[-1]
    inertia = spatial_inertias(mechanism, state)
    momentum = np.einsum("kabn,kbn->kan", inertia, state.twists)
    forces = link_wrenches(mechanism, state, gravity)
    turning = _inertia_rates(inertia, state.twists)
    below = mechanism.carriers[screws.entries]
    composite, composite_rate, h, f = (
        (below @ part.reshape(len(part), -1)).reshape(len(below), *part.shape[1:])
        for part in (inertia, turning, momentum, forces)
    )
    screw, first, second = screws.rates
    fall = np.zeros((6, 1))
    fall[:3, 0] = gravity
    by_q = (
        _times(composite, second)
        + _times(composite_rate, first)
        + force_cross(first, h)
        + force_cross(screw, f)
        + _times(composite, motion_cross(screw, fall))
    )
    by_qdot = 2.0 * _times(composite, first) + _times(composite_rate, screw) + force_cross(screw, h)
    by_entry = np.stack([by_q, by_qdot, _times(composite, screw)], axis=1)
    by = np.zeros((m, 3, 6, n))
    np.add.at(by, screws.columns, by_entry)
    return WrenchRates(forces.sum(axis=0), np.ascontiguousarray(by.transpose(3, 2, 1, 0)))


def spatial_inertias(mechanism: Mechanism, state: LinkMotion) -> Array:
    """Inertia of every link at the ground origin, ground axes, (n_links, 6, 6, n): momentum from twist."""
    inertias, axes = mechanism.inertias, state.poses.axes
    at = np.einsum("kjan,kj->kan", axes, inertias.com) + state.poses.origins
    own = np.einsum("kian,kij,kjbn->kabn", axes, inertias.tensor, axes, optimize=True)
    mass = inertias.mass[:, None, None, None]
    arm = _skew(at)
    result = np.zeros((len(axes), 6, 6, axes.shape[-1]))
    for i in range(3):
        result[:, i, i] = inertias.mass[:, None]
    result[:, :3, 3:] = -mass * arm
    result[:, 3:, :3] = mass * arm
    result[:, 3:, 3:] = own - mass * np.einsum("kabn,kbcn->kacn", arm, arm)
    return result


def _skew(vector: Array) -> Array:
    """Cross-product matrices of vectors (k, 3, n), (k, 3, 3, n)."""
    return np.stack([cross(vector, np.eye(3)[:, [i]]) for i in range(3)], axis=2)


def _inertia_rates(inertia: Array, twists: Array) -> Array:
    """``V x* I - I V x`` of every link, (k, 6, 6, n)."""
    columns = np.moveaxis(inertia, 2, 1)  # (k, column, row, n); the matrix is symmetric
    half = np.moveaxis(force_cross(twists[:, None], columns), 1, 2)
    rates: Array = half + np.swapaxes(half, 1, 2)  # -(I V x) is the transpose of (V x* I)
    return rates


def _times(matrix: Array, vector: Array) -> Array:
    product: Array = np.einsum("kabn,kbn->kan", matrix, vector)
    return product
