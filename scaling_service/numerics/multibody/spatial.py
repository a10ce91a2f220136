"""Velocities and accelerations of all links along a motion, in ground axes at the ground origin.

A *twist* is (linear, angular): the velocity of the body's point that passes the ground origin, and the
angular velocity. A *wrench* is (force, moment about the ground origin). Frames come last.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scaling_service.numerics.multibody.law_rates import FactorRates, Motion, curvatures
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.mechanism import Mechanism
from scaling_service.numerics.multibody.tree import Poses, cross, forward


@dataclass(frozen=True, slots=True, eq=False)
class Moving:
    """A mechanism along a motion."""

    poses: Poses
    screws: Array  # (n_entries, 6, n): the twist of every entry for a unit rate of its scalar part
    twists: Array  # (n_links, 6, n), m/s and rad/s
    # (n_links, 6, n), m/s2 and rad/s2: rates of the twists. The linear part is no point's acceleration by
    # itself; see :func:`point_acceleration`.
    accelerations: Array
    # (n_entries, n): derivatives of the entries' scalar parts with respect to their coordinates; zero for a
    # signal
    slopes: Array


def moving(mechanism: Mechanism, motion: Motion, p: Array) -> Moving:
    """Twists of all links and their rates.

    ``p`` (n_parameters,): shared parameters of the tree's laws.
    """
    tree, n = mechanism.tree, motion.n
    poses = forward(tree, motion.q, p, None if motion.signals is None else motion.signals[0])
    screws = _screws(mechanism, poses)
    curves = curvatures(tree.shape_groups, len(tree.factors), motion.q)
    rates = FactorRates.of(tree.factors, motion, poses.values.slopes, curves)
    first, second = rates.of_terms([e.term for e in mechanism.entries], p)
    speeds = screws * first[:, None]
    changes = screws * second[:, None]
    _add_turning_of_screws(mechanism, speeds, changes)
    spread = mechanism.carriers.T
    return Moving(
        poses,
        screws,
        (spread @ speeds.reshape(len(speeds), -1)).reshape(-1, 6, n),
        (spread @ changes.reshape(len(changes), -1)).reshape(-1, 6, n),
        _slopes(mechanism, poses, n),
    )


def _screws(mechanism: Mechanism, poses: Poses) -> Array:
    """Twists of all entries for unit rates, (n_entries, 6, n)."""
    entries, turns = mechanism.entries, mechanism.n_turns
    directions = poses.directions(entries)
    screws = np.zeros((len(entries), 6, directions.shape[-1]))
    screws[:turns, 3:] = directions[:turns]
    origins = poses.frames[[e.node for e in entries[:turns]], 3]
    screws[:turns, :3] = cross(origins, directions[:turns])
    screws[turns:, :3] = directions[turns:]
    return screws


def _add_turning_of_screws(mechanism: Mechanism, speeds: Array, changes: Array) -> None:
    """Add to ``changes`` how the frames that the entries start from carry their screws along."""
    turns, n = mechanism.n_turns, speeds.shape[-1]
    carried = (mechanism.before @ speeds.reshape(len(speeds), -1)).reshape(-1, 6, n)
    changes[:, :3] += cross(carried[:, 3:], speeds[:, :3])
    changes[:turns, :3] += cross(carried[:turns, :3], speeds[:turns, 3:])
    changes[:turns, 3:] += cross(carried[:turns, 3:], speeds[:turns, 3:])


def _slopes(mechanism: Mechanism, poses: Poses, n: int) -> Array:
    slopes = np.zeros((len(mechanism.entries), n))
    for row, (entry, coordinate) in enumerate(
        zip(mechanism.entries, mechanism.coordinates.tolist(), strict=True)
    ):
        if coordinate >= 0:
            slopes[row] = poses.values.by_coordinate(entry.term)
    return slopes


def point_velocity(twist: Array, at: Array) -> Array:
    """Velocity of body points that lie at some places of the ground, (..., 3, n), m/s."""
    velocity: Array = twist[..., :3, :] + cross(twist[..., 3:, :], at)
    return velocity


def point_acceleration(twist: Array, acceleration: Array, at: Array) -> Array:
    """Acceleration of body points that lie at some places of the ground, (..., 3, n), m/s2."""
    turning = cross(twist[..., 3:, :], point_velocity(twist, at))
    result: Array = acceleration[..., :3, :] + cross(acceleration[..., 3:, :], at) + turning
    return result
