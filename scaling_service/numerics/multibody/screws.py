"""How the joints of a moving tree would carry it elsewhere: screws with their first and second rates.

A variation dq(t) of one coordinate moves every link below it by the twist ``xi = S dq`` in ground axes at the
ground origin. Along a motion ``xi' = S' dq + S dq'`` and ``xi'' = S'' dq + 2 S' dq' + S dq''``, so whatever
is known for xi and its rates is known for q, qdot and qddot.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.mechanism import Mechanism
from scaling_service.numerics.multibody.motion import LinkMotion, Motion, law_derivatives, move_links
from scaling_service.numerics.multibody.tree import cross


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


def motion_cross(twist: Array, other: Array) -> Array:
    """The rate of a twist that is carried by another, (..., 6, n)."""
    result = np.empty(np.broadcast_shapes(twist.shape, other.shape))
    spin = twist[..., 3:, :]
    result[..., :3, :] = cross(spin, other[..., :3, :]) + cross(twist[..., :3, :], other[..., 3:, :])
    result[..., 3:, :] = cross(spin, other[..., 3:, :])
    return result


def force_cross(twist: Array, wrench: Array) -> Array:
    """The rate of a wrench that is carried by a twist, (..., 6, n)."""
    result = np.empty(np.broadcast_shapes(twist.shape, wrench.shape))
    spin = twist[..., 3:, :]
    result[..., :3, :] = cross(spin, wrench[..., :3, :])
    result[..., 3:, :] = cross(spin, wrench[..., 3:, :]) + cross(twist[..., :3, :], wrench[..., :3, :])
    return result


def screws_of(mechanism: Mechanism, motion: Motion, p: Array, free: NDArray[np.intp]) -> Screws:
    """Screws of the entries that free coordinates drive.

    ``p``: (n_parameters,).
    ``free`` int (m,): coordinates.
    """
    state = move_links(mechanism, motion, p)
    curves = [law_derivatives(mechanism, motion.q, p, order) for order in (2, 3)]
    speeds = state.screws * state.slopes[:, None]  # of all entries, for those that are locked never move
    rate, pace = motion.qdot[mechanism.coordinates], motion.qddot[mechanism.coordinates]
    carried = _carried(mechanism, speeds * rate[:, None])
    first = motion_cross(carried, speeds) + state.screws * (curves[0] * rate)[:, None]
    carried_rate = _carried(mechanism, first * rate[:, None] + speeds * pace[:, None])
    bend = (curves[1] * rate**2 + curves[0] * pace)[:, None]
    screw_rate = motion_cross(carried, state.screws)
    second = (
        motion_cross(carried_rate, speeds)
        + motion_cross(carried, first)
        + screw_rate * (curves[0] * rate)[:, None]
        + state.screws * bend
    )
    wanted = np.flatnonzero(np.isin(mechanism.coordinates, free))
    place = {int(c): k for k, c in enumerate(free)}
    columns = np.array([place[int(c)] for c in mechanism.coordinates[wanted]], dtype=np.intp)
    return Screws(wanted, columns, np.stack([speeds[wanted], first[wanted], second[wanted]]), state)


def _carried(mechanism: Mechanism, twists: Array) -> Array:
    """Of the frame that each entry starts from, (n_entries, 6, n)."""
    n = twists.shape[-1]
    return np.asarray((mechanism.before @ twists.reshape(len(twists), -1)).reshape(-1, 6, n))
