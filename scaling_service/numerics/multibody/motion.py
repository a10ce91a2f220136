"""A tree with mass, and velocities and accelerations of all its links, in ground axes at the ground origin.

A *twist* is (linear, angular): the velocity of the body's point that passes the ground origin, and the
angular velocity. A *wrench* is (force, moment about the ground origin). Frames come last.

Twists and wrenches are written in ground axes at the ground origin. They then need no transformation
from body to body: the twist of a link is the sum of the twists of all entries above it, and the force
through an entry is the sum of the forces on all links below it. Both sums are one matrix product for
all frames (Featherstone 2008, Rigid Body Dynamics Algorithms, sec. 2.14 and 5.3).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.arrays import Array
from scaling_service.numerics.multibody import laws, plan
from scaling_service.numerics.multibody.tree import Poses, Tree, cross, pose_links

TENSOR = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""Places of the six numbers of a symmetric tensor: xx, yy, zz, xy, xz, yz."""

N_PARAMETERS = 10
"""Inertial parameters of a link: mass, first moments x, y, z, tensor about the link's origin (six)."""


@dataclass(frozen=True, slots=True, eq=False)
class Inertias:
    """What every link weighs and how it resists turning."""

    mass: Array  # (n_links,), kg
    com: Array  # (n_links, 3), m: centre of mass in the link's frame
    tensor: Array  # (n_links, 3, 3), kg m2: about the centre of mass, in the link's axes

    def parameters(self) -> Array:
        """The numbers that forces are linear in, shape (n_links, 10).

        Mass (kg), mass times centre of mass (kg m), tensor about the link's *origin* xx, yy, zz, xy, xz,
        yz (kg m2).
        """
        about_origin = self.tensor + self.mass[:, None, None] * _point_tensor(self.com)
        six = np.stack([about_origin[:, i, j] for i, j in TENSOR], axis=1)
        return np.concatenate([self.mass[:, None], self.mass[:, None] * self.com, six], axis=1)

    @classmethod
    def of_parameters(cls, parameters: Array) -> Inertias:
        """The inverse of :meth:`parameters`; a link without mass keeps its centre at the origin.

        ``parameters``: (n_links, 10).
        """
        mass = parameters[:, 0]
        com = np.divide(
            parameters[:, 1:4], mass[:, None], out=np.zeros((len(mass), 3)), where=mass[:, None] != 0
        )
        tensor = np.empty((len(mass), 3, 3))
        for k, (i, j) in enumerate(TENSOR):
            tensor[:, i, j] = tensor[:, j, i] = parameters[:, 4 + k]
        return cls(mass, com, tensor - mass[:, None, None] * _point_tensor(com))


def _point_tensor(at: Array) -> Array:
    """Tensor of unit masses at some places (n, 3) about the origin, (n, 3, 3)."""
    squares = (at**2).sum(axis=1)
    return np.asarray(squares[:, None, None] * np.eye(3) - at[:, :, None] * at[:, None, :])


@dataclass(frozen=True, eq=False)
class Mechanism:
    """A compiled tree and what its links weigh."""

    tree: Tree  # With every link that has mass
    inertias: Inertias  # One row per link of the tree

    def __post_init__(self) -> None:
        if len(self.inertias.mass) != len(self.tree.links):
            raise ValueError(f"{len(self.inertias.mass)} inertias do not fit {len(self.tree.links)} links")

    @property
    def n_links(self) -> int:
        """The number of links."""
        return len(self.tree.links)

    @cached_property
    def entries(self) -> tuple[plan.Entry, ...]:
        """The terms that move with time, once for each of their coordinates, turns first, then shifts."""
        return tuple(sorted(self.tree.plan.moving, key=lambda e: not e.is_turn))

    @cached_property
    def carriers(self) -> Array:
        """1 where an entry moves a link, shape (n_entries, n_links)."""
        rows = [self._at_or_below(e.node)[self.tree.plan.link_node] for e in self.entries]
        return np.array(rows, dtype=float).reshape(len(self.entries), self.n_links)

    @cached_property
    def before(self) -> Array:
        """1 where entry j moves the frame that entry i starts from, shape (n_entries, n_entries).

        A node shifts first and turns then.
        """
        nodes = np.array([e.node for e in self.entries], dtype=np.intp)
        turns = np.array([e.is_turn for e in self.entries], dtype=bool)
        result = np.zeros((len(nodes), len(nodes)))
        for j, entry in enumerate(self.entries):
            reached = self._at_or_below(entry.node)
            reached[entry.node] = False
            result[:, j] = reached[nodes] | ((nodes == entry.node) & turns & (not entry.is_turn))
        return result

    @cached_property
    def coordinates(self) -> NDArray[np.intp]:
        """The coordinate that each entry follows, shape (n_entries,)."""
        return np.array([e.coordinate for e in self.entries], dtype=np.intp)

    def _at_or_below(self, node: int) -> NDArray[np.bool_]:
        """Which nodes are this one or hang on it, shape (n_nodes,)."""
        parent = self.tree.plan.parent
        found = np.zeros(len(parent), dtype=bool)
        found[node] = True
        for k in range(node + 1, len(parent)):  # nodes are sorted by depth: parents first
            found[k] = found[parent[k]]
        return found


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Coordinates along a motion with their exact rates, frames last."""

    # q, qdot, qddot: (n_coordinates, n), rad or m, per s, per s2: frames of several samples may stand one
    # after the other
    q: Array
    qdot: Array
    qddot: Array

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
        return Motion(self.q[:, rows], self.qdot[:, rows], self.qddot[:, rows])


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LinkMotion:
    """A mechanism along a motion."""

    poses: Poses
    screws: Array  # (n_entries, 6, n): the twist of every entry for a unit rate of its scalar part
    twists: Array  # (n_links, 6, n), m/s and rad/s
    # (n_links, 6, n), m/s2 and rad/s2: rates of the twists. The linear part is no point's acceleration by
    # itself; see :func:`point_acceleration`.
    accelerations: Array
    slopes: Array  # (n_entries, n): derivatives of the entries' scalar parts with their coordinates


def move_links(mechanism: Mechanism, motion: Motion, p: Array) -> LinkMotion:
    """Twists of all links and their rates.

    ``p`` (n_parameters,): shared parameters of the tree's laws.
    """
    n, coordinates = motion.n, mechanism.coordinates
    poses = pose_links(mechanism.tree, motion.q, p)
    # Twists of all entries for unit rates, (n_entries, 6, n).
    entries, turns = mechanism.entries, sum(e.is_turn for e in mechanism.entries)
    directions = poses.directions(entries)
    screws = np.zeros((len(entries), 6, directions.shape[-1]))
    screws[:turns, 3:] = directions[:turns]
    origins = poses.frames[[e.node for e in entries[:turns]], 3]
    screws[:turns, :3] = cross(origins, directions[:turns])
    screws[turns:, :3] = directions[turns:]
    slopes = np.empty((len(mechanism.entries), n))
    for row, entry in enumerate(mechanism.entries):
        slopes[row] = poses.values.by_coordinate(entry.term, entry.number)
    qdot, qddot = motion.qdot[coordinates], motion.qddot[coordinates]
    (bend,) = _follow_laws(mechanism, motion, p, 1)
    speeds = screws * (slopes * qdot)[:, None]
    changes = screws * (bend * qdot + slopes * qddot)[:, None]
    changes += cross_twist(_carry(mechanism, speeds), speeds)
    spread = mechanism.carriers.T
    return LinkMotion(
        poses=poses,
        screws=screws,
        twists=(spread @ speeds.reshape(len(speeds), -1)).reshape(-1, 6, n),
        accelerations=(spread @ changes.reshape(len(changes), -1)).reshape(-1, 6, n),
        slopes=slopes,
    )


def _follow_laws(mechanism: Mechanism, motion: Motion, p: Array, count: int) -> Array:
    """First, and second, rates of every entry's slope along a motion, (count, n_entries, n)."""
    tree, result = mechanism.tree, np.zeros((count, len(mechanism.entries), motion.n))
    qddot = motion.qddot if count > 1 else None
    found = laws.follow_slopes(tree.factors, tree.shape_groups, motion.q, motion.qdot, qddot)
    for row, entry in enumerate(mechanism.entries):
        rates = found[entry.term.factor]
        if rates is not None:
            scale = p[entry.term.parameter] if entry.term.parameter != laws.NONE else 1.0
            result[:, row] = scale * np.array(rates[entry.number])
    return result


def point_velocity(twist: Array, at: Array) -> Array:
    """Velocity of body points that lie at some places of the ground, (..., 3, n), m/s."""
    return np.asarray(twist[..., :3, :] + cross(twist[..., 3:, :], at))


def point_acceleration(twist: Array, acceleration: Array, at: Array) -> Array:
    """Acceleration of body points that lie at some places of the ground, (..., 3, n), m/s2."""
    turning = cross(twist[..., 3:, :], point_velocity(twist, at))
    return np.asarray(acceleration[..., :3, :] + cross(acceleration[..., 3:, :], at) + turning)


@dataclass(frozen=True, slots=True, eq=False)
class Screws:
    """Screws of some of a mechanism's entries along a motion."""

    entries: NDArray[np.intp]  # (k,): rows of ``mechanism.entries``
    columns: NDArray[np.intp]  # (k,): which of the free coordinates each follows
    rates: Array  # (3, k, 6, n): the screw per unit of the coordinate, and its first and second rates
    state: LinkMotion

    def variations(self) -> Array:
        """Twists and their rates per unit of q, qdot and qddot, shape (k, 18, 3, n).

        Rows: the twist, its first rate, its second rate. Columns: q, qdot, qddot.
        """
        screw, first, second = self.rates
        result = np.zeros((len(self.entries), 3, 6, 3, screw.shape[-1]))
        result[:, 0, :, 0] = result[:, 1, :, 1] = result[:, 2, :, 2] = screw
        result[:, 1, :, 0] = first
        result[:, 2, :, 1] = 2.0 * first
        result[:, 2, :, 0] = second
        return result.reshape(len(self.entries), 18, 3, -1)


def cross_twist(twist: Array, other: Array) -> Array:
    """The rate of a twist that is carried by another, (..., 6, n)."""
    result = np.empty(np.broadcast_shapes(twist.shape, other.shape))
    omega = twist[..., 3:, :]
    result[..., :3, :] = cross(omega, other[..., :3, :]) + cross(twist[..., :3, :], other[..., 3:, :])
    result[..., 3:, :] = cross(omega, other[..., 3:, :])
    return result


def cross_wrench(twist: Array, wrench: Array) -> Array:
    """The rate of a wrench that is carried by a twist, (..., 6, n)."""
    result = np.empty(np.broadcast_shapes(twist.shape, wrench.shape))
    omega = twist[..., 3:, :]
    result[..., :3, :] = cross(omega, wrench[..., :3, :])
    result[..., 3:, :] = cross(omega, wrench[..., 3:, :]) + cross(twist[..., :3, :], wrench[..., :3, :])
    return result


def list_screws(mechanism: Mechanism, motion: Motion, p: Array, free: NDArray[np.intp]) -> Screws:
    """Screws of the entries that free coordinates drive.

    ``p``: (n_parameters,).
    ``free`` int (m,): coordinates.
    """
    state = move_links(mechanism, motion, p)
    bend = _follow_laws(mechanism, motion, p, 2)[:, :, None]
    speeds = state.screws * state.slopes[:, None]  # of all entries, for those that are locked never move
    qdot, qddot = motion.qdot[mechanism.coordinates], motion.qddot[mechanism.coordinates]
    carried = _carry(mechanism, speeds * qdot[:, None])
    first = cross_twist(carried, speeds) + state.screws * bend[0]
    carried_rate = _carry(mechanism, first * qdot[:, None] + speeds * qddot[:, None])
    screw_rate = cross_twist(carried, state.screws)
    second = (
        cross_twist(carried_rate, speeds)
        + cross_twist(carried, first)
        + screw_rate * bend[0]
        + state.screws * bend[1]
    )
    wanted = np.flatnonzero(np.isin(mechanism.coordinates, free))
    place = {int(c): k for k, c in enumerate(free)}
    columns = np.array([place[int(c)] for c in mechanism.coordinates[wanted]], dtype=np.intp)
    return Screws(wanted, columns, np.stack([speeds[wanted], first[wanted], second[wanted]]), state)


def _carry(mechanism: Mechanism, twists: Array) -> Array:
    """Of the frame that each entry starts from, (n_entries, 6, n)."""
    n = twists.shape[-1]
    return np.asarray((mechanism.before @ twists.reshape(len(twists), -1)).reshape(-1, 6, n))
