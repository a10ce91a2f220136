"""Velocities and accelerations of all links along a motion, in ground axes at the ground origin.

A *twist* is (linear, angular): the velocity of the body's point that passes the ground origin, and the
angular velocity. A *wrench* is (force, moment about the ground origin). Frames come last.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scaling_service.numerics.multibody.laws import NONE, Array, shape_derivatives
from scaling_service.numerics.multibody.mechanism import Mechanism
from scaling_service.numerics.multibody.tree import Poses, cross, forward


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Coordinates along a motion with their exact rates, frames last."""

    # q, qdot, qddot: (n_coordinates, n), rad or m, per s, per s2: frames of several samples may stand one
    # after the other
    q: Array
    qdot: Array
    qddot: Array
    signals: Array | None = None  # (3, n_signals, n): known signals, their first and their second rates

    def __post_init__(self) -> None:
        if not self.q.shape == self.qdot.shape == self.qddot.shape:
            raise ValueError(f"q {self.q.shape}, qdot {self.qdot.shape} and qddot {self.qddot.shape} differ")

    @classmethod
    def of_frames(cls, q: Array, qdot: Array, qddot: Array) -> Motion:
        """From arrays with frames first, shape (..., n_coordinates); leading axes are joined."""
        flat = [np.ascontiguousarray(x.reshape(-1, x.shape[-1]).T, dtype=float) for x in (q, qdot, qddot)]
        return cls(*flat)

    @property
    def n(self) -> int:
        """The number of frames."""
        return int(self.q.shape[1])

    def block(self, rows: slice) -> Motion:
        """Only these frames."""
        signals = None if self.signals is None else self.signals[..., rows]
        return Motion(self.q[:, rows], self.qdot[:, rows], self.qddot[:, rows], signals)


@dataclass(frozen=True, slots=True, eq=False)
class LinkMotion:
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


def move_links(mechanism: Mechanism, motion: Motion, p: Array) -> LinkMotion:
    """Twists of all links and their rates.

    ``p`` (n_parameters,): shared parameters of the tree's laws.
    """
    tree, n = mechanism.tree, motion.n
    poses = forward(tree, motion.q, p, None if motion.signals is None else motion.signals[0])
    screws = _screws(mechanism, poses)
    first, second = _entry_rates(mechanism, motion, poses.values.slopes, p)
    speeds = screws * first[:, None]
    changes = screws * second[:, None]
    _add_turning_of_screws(mechanism, speeds, changes)
    spread = mechanism.carriers.T
    return LinkMotion(
        poses,
        screws,
        (spread @ speeds.reshape(len(speeds), -1)).reshape(-1, 6, n),
        (spread @ changes.reshape(len(changes), -1)).reshape(-1, 6, n),
        _slopes(mechanism, poses, n),
    )


def _entry_rates(
    mechanism: Mechanism, motion: Motion, slopes: list[Array | None], p: Array
) -> tuple[Array, Array]:
    """First and second rates in time of the entries' scalar parts, each (n_entries, n).

    For a shape s of a coordinate q: ``d/dt s = s' qdot`` and ``d2/dt2 s = s'' qdot^2 + s' qddot``.
    """
    tree = mechanism.tree
    curves = shape_derivatives(tree.shape_groups, len(tree.factors), motion.q, 2)
    first, second = [], []
    for factor, slope, curve in zip(tree.factors, slopes, curves, strict=True):
        if factor.signal != NONE:
            if motion.signals is None:
                raise ValueError("the tree uses signals and their rates were not given")
            rate, pace = motion.signals[1:, factor.signal]
        else:
            rate, pace = motion.qdot[factor.coordinate], motion.qddot[factor.coordinate]
        if slope is not None and curve is not None:
            rate, pace = slope * rate, curve * rate**2 + slope * pace
        first.append(rate)
        second.append(pace)
    terms = [entry.term for entry in mechanism.entries]
    scale = np.array([1.0 if t.parameter == NONE else p[t.parameter] for t in terms])[:, None]
    return scale * np.array([first[t.factor] for t in terms]), scale * np.array(
        [second[t.factor] for t in terms]
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
